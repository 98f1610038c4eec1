//! CPU levels and dispatch: with `simd/lanes.rs` the only file of this crate that may hold `unsafe`.
//!
//! A kernel is one generic body ([`Kernel::run`], `#[inline(always)]`), written over lane arrays or plain slices so
//! that the compiler vectorises it. [`dispatch`] compiles that body once per level and picks one at run time, once per
//! band of rows or chunk of points. No level fuses a multiplication with an addition, so all give the same bits.
#![allow(unsafe_code)]

mod eight;
mod lanes;

use std::sync::OnceLock;

use crate::error::{Error, Result};

pub(crate) use eight::{EIGHT, Eight, EightKernel, Packed, dispatch_eight};
pub(crate) use lanes::{Floats, LANES, Simd, blocks, blocks_mut};

/// A set of vector instructions. Results do not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum SimdLevel {
    /// What every CPU of the architecture has: SSE2 on x86-64, NEON on aarch64.
    Baseline,
    /// AVX2 (x86-64).
    Avx2,
    /// AVX-512 F, BW, DQ and VL (x86-64).
    Avx512,
}

impl SimdLevel {
    /// The best level of this CPU, or less where the environment variable `RSFLOW_CPU` says
    /// `baseline`, `avx2` or `avx512`. Read once; where it says anything else, every call that follows it fails.
    #[must_use]
    pub fn detected() -> Self {
        let best = Self::of_this_cpu();
        Self::of_environment().map_or(best, |level| level.min(best))
    }

    /// What `RSFLOW_CPU` says, the best level of this CPU if it is not set or empty.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] where it says something that is no level.
    pub fn of_environment() -> Result<Self> {
        static SAID: OnceLock<Result<SimdLevel>> = OnceLock::new();
        SAID.get_or_init(|| match std::env::var_os("RSFLOW_CPU") {
            Some(name) if !name.is_empty() => Self::named(&name.to_string_lossy()),
            _ => Ok(Self::of_this_cpu()),
        })
        .clone()
    }

    /// The level of this name, or the best of this CPU if that is less.
    fn named(name: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|level| level.name() == name)
            .map(|level| level.min(Self::of_this_cpu()))
            .ok_or_else(|| {
                let names = Self::ALL.map(|level| format!("{:?}", level.name()));
                let expected = format!("one of {}, or nothing", names.join(", "));
                Error::option("RSFLOW_CPU", format!("{name:?}"), expected)
            })
    }

    const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// Every level that this CPU can run, the plainest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        Self::ALL
            .into_iter()
            .filter(|level| *level <= Self::of_this_cpu())
            .collect()
    }

    /// The level's name, as `RSFLOW_CPU` takes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Asked by every dispatch: found once.
    #[inline]
    fn of_this_cpu() -> Self {
        static FOUND: OnceLock<SimdLevel> = OnceLock::new();
        *FOUND.get_or_init(Self::detect)
    }

    fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2");
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if avx2 && avx512 {
                return Self::Avx512;
            }
            if avx2 {
                return Self::Avx2;
            }
        }
        Self::Baseline
    }
}

/// The body of a kernel, written once for all levels.
pub(crate) trait Kernel {
    /// What the kernel returns.
    type Output;

    /// Do the work. Mark the implementation `#[inline(always)]`, and what it calls too, so that each level compiles it
    /// with its own instructions.
    fn run(self) -> Self::Output;
}

/// Run `kernel` with the instructions of `level`.
pub(crate) fn dispatch<K: Kernel>(level: SimdLevel, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        match level.min(SimdLevel::of_this_cpu()) {
            // SAFETY: `of_this_cpu` has found avx512f, bw, dq, vl and avx2 on this CPU.
            SimdLevel::Avx512 => return unsafe { run_avx512(kernel) },
            // SAFETY: `of_this_cpu` has found avx2 on this CPU.
            SimdLevel::Avx2 => return unsafe { run_avx2(kernel) },
            SimdLevel::Baseline => {}
        }
    }
    let _ = level;
    kernel.run()
}

/// The body of a kernel over sixteen lanes, written once for all levels.
pub(crate) trait LaneKernel {
    /// Do the work. Mark the implementation `#[inline(always)]`, and what it calls too.
    fn run<S: Simd>(self, simd: S);
}

/// Run `kernel` with the instructions of `level`.
pub(crate) fn dispatch_lanes<K: LaneKernel>(level: SimdLevel, kernel: K) {
    #[cfg(target_arch = "x86_64")]
    {
        match level.min(SimdLevel::of_this_cpu()) {
            // SAFETY: `of_this_cpu` has found avx512f, bw, dq, vl and avx2 on this CPU.
            SimdLevel::Avx512 => return unsafe { lanes_avx512(kernel) },
            // SAFETY: `of_this_cpu` has found avx2 on this CPU.
            SimdLevel::Avx2 => return unsafe { lanes_avx2(kernel) },
            SimdLevel::Baseline => {}
        }
    }
    let _ = level;
    kernel.run(lanes::Plain);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn lanes_avx2<K: LaneKernel>(kernel: K) {
    // SAFETY: this function is only entered where the CPU has AVX2.
    kernel.run(unsafe { lanes::x86::Avx2::new() });
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn lanes_avx512<K: LaneKernel>(kernel: K) {
    // SAFETY: this function is only entered where the CPU has AVX-512 F and DQ.
    kernel.run(unsafe { lanes::x86::Avx512::new() });
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32]);

    impl Kernel for Sum<'_> {
        type Output = f32;

        #[inline(always)]
        fn run(self) -> f32 {
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
    fn levels_are_ordered_and_named() {
        let levels = SimdLevel::available();
        assert_eq!(levels[0], SimdLevel::Baseline);
        assert!(levels.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(levels.contains(&SimdLevel::detected()));
        assert_eq!(SimdLevel::Avx2.name(), "avx2");
    }

    #[test]
    fn a_level_has_one_of_the_names_or_is_an_error() {
        for level in SimdLevel::available() {
            assert_eq!(SimdLevel::named(level.name()), Ok(level));
        }
        let error = SimdLevel::named("avx1024").unwrap_err();
        let want = "RSFLOW_CPU: got \"avx1024\", expected one of \"baseline\", \"avx2\", \"avx512\", or nothing";
        assert_eq!(error.to_string(), want);
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
