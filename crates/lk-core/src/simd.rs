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
#[cfg(all(target_arch = "aarch64", target_endian = "little"))]
mod neon;
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

    /// Every operation on sixteen lanes, over values that may be NaN or infinite, and over whole numbers.
    struct Sixteens<'a>(&'a [f32; 2 * LANES], &'a [f32; 2 * LANES]);

    impl Kernel for Sixteens<'_> {
        type Output = ([[f32; LANES]; 20], [bool; 4]);

        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> Self::Output {
            let (a, b) = (s.load(self.0, 0), s.load(self.0, LANES));
            let (row, index) = (s.load(self.1, 0), s.load(self.1, LANES));
            let (less, most) = (a.lt(b), a.le(b));
            let (even, odd) = a.deinterleave(b);
            let (first, second) = a.interleave(b);
            // From within the data to far beyond its end.
            let near = s.pairs(self.0, 1, row, index);
            let far = s.pairs(self.0, 9, row, index * s.splat(1e6));
            let lanes = [
                a + b,
                a - b,
                a * b,
                a / b,
                a.min(b),
                a.max(b),
                (a * a).sqrt(),
                (row * s.splat(0.37)).trunc(),
                S::F::select(less, a, b),
                S::F::select(S::F::both(less, most), b, a),
                even,
                odd,
                first,
                second,
                near.0,
                near.1,
                far.0,
                far.1,
                s.lookup(a, b, index),
                s.ramp() + s.splat(a.first()),
            ];
            let mut out = [[0.0; LANES]; 20];
            for (out, lanes) in out.iter_mut().zip(lanes) {
                lanes.put(out);
            }
            let equal = row.le(row);
            let truths = [
                S::F::all(most),
                S::F::any(less),
                S::F::all(equal),
                S::F::any(row.lt(row)),
            ];
            (out, truths)
        }
    }

    #[test]
    fn every_level_computes_sixteen_lanes_as_plain_arrays_do() {
        let whole = |i: usize| {
            if i < LANES {
                i % 5
            } else {
                31 * (i - LANES) % 32
            }
        };
        let whole: [f32; 2 * LANES] = std::array::from_fn(|i| whole(i) as f32);
        let mut data: [f32; 2 * LANES] = std::array::from_fn(|i| (i as f32 * 2.3).sin());
        for odd in [
            None,
            Some(0.0),
            Some(-0.0),
            Some(f32::NAN),
            Some(f32::INFINITY),
        ] {
            // On the left, on the right, and on both sides of a comparison.
            for at in [3, LANES + 6, 9, LANES + 9] {
                data[at] = odd.unwrap_or(data[at]);
                let want = Sixteens(&data, &whole).run(Plain);
                for level in SimdLevel::available() {
                    let got = dispatch(level, Sixteens(&data, &whole));
                    for (operation, (got, want)) in got.0.iter().zip(&want.0).enumerate() {
                        let same = |(got, want): (&f32, &f32)| {
                            got.to_bits() == want.to_bits() || got.is_nan() && want.is_nan()
                        };
                        let same = got.iter().zip(want).all(same);
                        assert!(same, "{level:?}, {operation}: {got:?}, not {want:?}");
                    }
                    assert_eq!(got.1, want.1, "{level:?}");
                }
            }
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
