//! `unsafe` in this file: a body is entered with the instructions of a level after the CPU was asked for them.
#![allow(unsafe_code)]

use super::lanes::Simd;
use super::level::SimdLevel;
#[cfg(all(target_arch = "aarch64", target_endian = "little"))]
use super::neon::Neon;
#[cfg(not(target_arch = "x86_64"))]
use super::plain::Plain;
#[cfg(target_arch = "x86_64")]
use super::{avx2::Avx2, avx512::Avx512, sse2::Sse2};

/// The body of a kernel, written once for all levels.
pub(crate) trait Kernel {
    /// What the kernel returns.
    type Output;

    /// Do the work, over the lanes of `simd` or over plain slices. Mark the implementation `#[inline(always)]`, and what
    /// it calls too, so that each level compiles it with its own instructions.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Run `kernel` with the instructions of `level`, or the best below it that this CPU has.
pub(crate) fn dispatch<K: Kernel>(level: SimdLevel, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        match level.min(SimdLevel::of_this_cpu()) {
            // SAFETY: `of_this_cpu` has found avx512f, bw, dq, vl and avx2 on this CPU.
            SimdLevel::Avx512 => unsafe { with_avx512(kernel) },
            // SAFETY: `of_this_cpu` has found avx2 on this CPU.
            SimdLevel::Avx2 => unsafe { with_avx2(kernel) },
            SimdLevel::Baseline | SimdLevel::Neon => kernel.run(Sse2),
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        match level.min(SimdLevel::of_this_cpu()) {
            #[cfg(all(target_arch = "aarch64", target_endian = "little"))]
            SimdLevel::Neon => kernel.run(Neon),
            _ => kernel.run(Plain),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
    // SAFETY: this function is only entered where the CPU has AVX2.
    kernel.run(unsafe { Avx2::new() })
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
    // SAFETY: this function is only entered where the CPU has AVX2 and AVX-512 F, BW, DQ and VL.
    kernel.run(unsafe { Avx512::new() })
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32]);

    impl Kernel for Sum<'_> {
        type Output = f32;

        #[inline(always)]
        fn run<S: Simd>(self, _: S) -> f32 {
            let mut lanes = [0.0f32; 8];
            for chunk in self.0.chunks_exact(8) {
                for (lane, value) in lanes.iter_mut().zip(chunk) {
                    *lane += value * value;
                }
            }
            lanes.iter().sum()
        }
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        let data: Vec<f32> = (0..4096u16).map(|i| (f32::from(i) * 0.37).sin()).collect();
        let want = dispatch(SimdLevel::Baseline, Sum(&data));
        for level in SimdLevel::available() {
            assert_eq!(
                dispatch(level, Sum(&data)).to_bits(),
                want.to_bits(),
                "{level:?}"
            );
        }
    }
}
