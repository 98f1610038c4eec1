//! CPU levels and dispatch: the only files of this crate that may hold `unsafe`, which each that does says first.
//!
//! A kernel is one generic body ([`Kernel::run`], `#[inline(always)]`), written over lanes ([`Simd`]) or plain slices so
//! that the compiler vectorises it. [`dispatch`] compiles that body once per level and picks one at run time, once per
//! band of rows or chunk of points. No level fuses a multiplication with an addition, so all give the same bits.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod dispatch;
mod lanes;
mod level;
mod plain;
#[cfg(target_arch = "x86_64")]
mod sse2;

pub(crate) use dispatch::{Kernel, dispatch};
pub(crate) use lanes::{EIGHT, Eight, Floats, LANES, Packed, Simd, blocks, blocks_mut};
pub use level::SimdLevel;

#[cfg(test)]
mod tests {
    use super::plain::Plain;
    use super::*;

    /// Every operation once.
    struct Everything<'a>(&'a [f32]);

    impl Kernel for Everything<'_> {
        type Output = ([f32; EIGHT], u8, f64);

        #[inline(always)]
        fn run<S: Simd>(self, _: S) -> Self::Output {
            let (a, b) = (S::Eight::load(self.0, 0), S::Eight::load(self.0, 5));
            let mut c = (a + b) * a - b;
            c += S::Eight::splat(0.5);
            let kept = c.keep(S::Eight::first(6));
            let root = (kept * kept).sqrt();
            let mut out = [0.0; EIGHT];
            let root = a.mask_from(b).choose(root, kept);
            root.store(&mut out, 0);
            (
                out,
                a.at_least(b),
                (root + S::Eight::unpack(&Packed::STEPS) + S::Eight::zero()).sum(),
            )
        }
    }

    #[test]
    fn every_level_computes_what_plain_arrays_do() {
        let mut data: Vec<f32> = (0..13u8).map(|i| (f32::from(i) * 1.7).sin()).collect();
        for nan in [false, true] {
            if nan {
                data[7] = f32::NAN;
            }
            let want = Everything(&data).run(Plain);
            for level in SimdLevel::available() {
                let got = dispatch(level, Everything(&data));
                assert_eq!(
                    got.0.map(f32::to_bits),
                    want.0.map(f32::to_bits),
                    "{level:?}"
                );
                assert_eq!(
                    (got.1, got.2.to_bits()),
                    (want.1, want.2.to_bits()),
                    "{level:?}"
                );
            }
        }
    }
}
