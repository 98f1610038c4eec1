//! Sixteen `f32` at a time, by the instructions of a level.
//!
//! A value of a level's type exists only where this CPU has that level: all of them come from a token ([`Simd`]) that
//! `dispatch_lanes` alone makes, after it has looked. That is what makes the operations safe to call.
#![allow(clippy::needless_range_loop, reason = "lanes are counted")]

use std::ops::{Add, Div, Mul, Sub};

/// Elements in one value.
pub(crate) const LANES: usize = 16;

/// Sixteen `f32`. Minimum and maximum are `if a < b { a } else { b }` and `if a > b { a } else { b }`, so that a NaN
/// on the left gives the right side.
pub(crate) trait Floats:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Sixteen truths.
    type Mask: Copy;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// Where `self < other`; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Where `self <= other`; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// `yes` where the mask is true, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Rounded towards zero; for values within 0..2^24.
    fn trunc(self) -> Self;
    /// Write to `to[at..at + 16]`.
    fn store(self, to: &mut [f32], at: usize);
}

/// The instructions of a level.
pub(crate) trait Simd: Copy {
    /// Its sixteen floats.
    type F: Floats;
    /// `from[at..at + 16]`.
    fn load(self, from: &[f32], at: usize) -> Self::F;
    fn splat(self, value: f32) -> Self::F;
    /// `row * stride + column` and the element after it in `data`, per lane. `row` and `column` are whole numbers of
    /// at least 0; a place beyond the last pair gives the last pair.
    ///
    /// # Panics
    ///
    /// Panics if `data` has fewer than two elements or more than `i32::MAX`.
    fn pairs(
        self,
        data: &[f32],
        stride: usize,
        row: Self::F,
        column: Self::F,
    ) -> (Self::F, Self::F);
    /// 0, 1, .. 15.
    #[inline(always)]
    fn ramp(self) -> Self::F {
        self.load(
            &[
                0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0,
                15.0,
            ],
            0,
        )
    }
}

/// The place of the last pair of `data`.
#[inline(always)]
fn last_pair(data: &[f32]) -> u32 {
    assert!(data.len() >= 2 && data.len() <= i32::MAX as usize);
    (data.len() - 2) as u32
}

/// What every CPU has.
#[derive(Clone, Copy)]
pub(super) struct Plain;

/// Sixteen floats in an array, for the compiler to vectorise.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Array([f32; LANES]);

impl Array {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = [0.0; LANES];
        for lane in 0..LANES {
            out[lane] = f(self.0[lane], other.0[lane]);
        }
        Self(out)
    }

    #[inline(always)]
    fn test(self, other: Self, f: impl Fn(f32, f32) -> bool) -> [u32; LANES] {
        let mut out = [0; LANES];
        for lane in 0..LANES {
            out[lane] = if f(self.0[lane], other.0[lane]) {
                u32::MAX
            } else {
                0
            };
        }
        out
    }
}

macro_rules! array_operators {
    ($($name:ident $function:ident $sign:tt),+) => {$(
        impl $name for Array {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.zip(other, |a, b| a $sign b)
            }
        }
    )+};
}
array_operators!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Floats for Array {
    type Mask = [u32; LANES];

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.zip(self, |a, _| a.sqrt())
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a < b)
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a <= b)
    }
    #[inline(always)]
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        std::array::from_fn(|lane| a[lane] & b[lane])
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        let mut out = [0.0; LANES];
        for lane in 0..LANES {
            let bits = (yes.0[lane].to_bits() & mask[lane]) | (no.0[lane].to_bits() & !mask[lane]);
            out[lane] = f32::from_bits(bits);
        }
        Self(out)
    }
    #[inline(always)]
    fn trunc(self) -> Self {
        self.zip(self, |a, _| (a as i32) as f32)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32], at: usize) {
        to[at..at + LANES].copy_from_slice(&self.0);
    }
}

impl Simd for Plain {
    type F = Array;

    #[inline(always)]
    fn load(self, from: &[f32], at: usize) -> Array {
        let mut out = [0.0; LANES];
        out.copy_from_slice(&from[at..at + LANES]);
        Array(out)
    }
    #[inline(always)]
    fn splat(self, value: f32) -> Array {
        Array([value; LANES])
    }
    #[inline(always)]
    fn pairs(self, data: &[f32], stride: usize, row: Array, column: Array) -> (Array, Array) {
        let last = last_pair(data);
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let at = (row.0[lane] as u32)
                .wrapping_mul(stride as u32)
                .wrapping_add(column.0[lane] as u32);
            let at = at.min(last) as usize;
            first[lane] = data[at];
            second[lane] = data[at + 1];
        }
        (Array(first), Array(second))
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    use std::arch::x86_64::*;
    use std::ops::{Add, Div, Mul, Sub};

    use super::{Floats, LANES, Simd, last_pair};

    /// Exists only where AVX2 does.
    #[derive(Clone, Copy)]
    pub(in crate::simd) struct Avx2(());

    /// Exists only where AVX-512 F and DQ do.
    #[derive(Clone, Copy)]
    pub(in crate::simd) struct Avx512(());

    impl Avx2 {
        /// # Safety
        ///
        /// This CPU must have AVX2.
        pub(in crate::simd) unsafe fn new() -> Self {
            Self(())
        }
    }

    impl Avx512 {
        /// # Safety
        ///
        /// This CPU must have AVX-512 F and DQ.
        pub(in crate::simd) unsafe fn new() -> Self {
            Self(())
        }
    }

    /// Sixteen floats; made by [`Avx2`] only.
    #[derive(Clone, Copy)]
    pub(crate) struct F256(__m256, __m256);

    /// Sixteen floats; made by [`Avx512`] only.
    #[derive(Clone, Copy)]
    pub(crate) struct F512(__m512);

    macro_rules! operators {
        ($($name:ident $function:ident $wide:ident $half:ident),+) => {$(
            impl $name for F512 {
                type Output = Self;
                #[inline(always)]
                fn $function(self, other: Self) -> Self {
                    // SAFETY: the CPU has AVX-512 F, for `self` exists.
                    Self(unsafe { $wide(self.0, other.0) })
                }
            }
            impl $name for F256 {
                type Output = Self;
                #[inline(always)]
                fn $function(self, other: Self) -> Self {
                    // SAFETY: the CPU has AVX2, for `self` exists.
                    unsafe { Self($half(self.0, other.0), $half(self.1, other.1)) }
                }
            }
        )+};
    }
    operators!(
        Add add _mm512_add_ps _mm256_add_ps,
        Sub sub _mm512_sub_ps _mm256_sub_ps,
        Mul mul _mm512_mul_ps _mm256_mul_ps,
        Div div _mm512_div_ps _mm256_div_ps
    );

    impl Floats for F512 {
        type Mask = __mmask16;

        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: the CPU has AVX-512 F, for `self` exists.
            Self(unsafe { _mm512_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm512_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm512_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Self::Mask {
            // SAFETY: as above.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
        }
        #[inline(always)]
        fn le(self, other: Self) -> Self::Mask {
            // SAFETY: as above.
            unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) }
        }
        #[inline(always)]
        fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
            a & b
        }
        #[inline(always)]
        fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm512_mask_blend_ps(mask, no.0, yes.0) })
        }
        #[inline(always)]
        fn trunc(self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm512_cvtepi32_ps(_mm512_cvttps_epi32(self.0)) })
        }
        #[inline(always)]
        fn store(self, to: &mut [f32], at: usize) {
            let to = &mut to[at..at + LANES];
            // SAFETY: as above; an unaligned store over the whole of a slice of 16 elements.
            unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
        }
    }

    impl Simd for Avx512 {
        type F = F512;

        #[inline(always)]
        fn load(self, from: &[f32], at: usize) -> F512 {
            let from = &from[at..at + LANES];
            // SAFETY: the CPU has AVX-512 F, for `self` exists; an unaligned load of a slice of 16 elements.
            F512(unsafe { _mm512_loadu_ps(from.as_ptr()) })
        }
        #[inline(always)]
        fn splat(self, value: f32) -> F512 {
            // SAFETY: the CPU has AVX-512 F, for `self` exists.
            F512(unsafe { _mm512_set1_ps(value) })
        }
        #[inline(always)]
        fn pairs(self, data: &[f32], stride: usize, row: F512, column: F512) -> (F512, F512) {
            let last = last_pair(data);
            // SAFETY: the CPU has AVX-512 F and DQ, for `self` exists. Every place read is at most `last`, so that the
            // eight bytes there are inside `data`; `last` fits an i32.
            unsafe {
                let row = _mm512_mullo_epi32(
                    _mm512_cvttps_epi32(row.0),
                    _mm512_set1_epi32(stride as i32),
                );
                let places = _mm512_add_epi32(row, _mm512_cvttps_epi32(column.0));
                let places = _mm512_min_epu32(places, _mm512_set1_epi32(last as i32));
                let base = data.as_ptr().cast();
                let low = _mm512_i32gather_epi64::<4>(_mm512_castsi512_si256(places), base);
                let high =
                    _mm512_i32gather_epi64::<4>(_mm512_extracti32x8_epi32::<1>(places), base);
                let even =
                    _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
                let odd =
                    _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
                let first = _mm512_permutex2var_epi32(low, even, high);
                let second = _mm512_permutex2var_epi32(low, odd, high);
                (
                    F512(_mm512_castsi512_ps(first)),
                    F512(_mm512_castsi512_ps(second)),
                )
            }
        }
    }

    impl Floats for F256 {
        type Mask = (__m256, __m256);

        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe {
                Self(
                    _mm256_min_ps(self.0, other.0),
                    _mm256_min_ps(self.1, other.1),
                )
            }
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: as above.
            unsafe {
                Self(
                    _mm256_max_ps(self.0, other.0),
                    _mm256_max_ps(self.1, other.1),
                )
            }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: as above.
            unsafe { Self(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1)) }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> Self::Mask {
            // SAFETY: as above.
            unsafe {
                (
                    _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0),
                    _mm256_cmp_ps::<_CMP_LT_OQ>(self.1, other.1),
                )
            }
        }
        #[inline(always)]
        fn le(self, other: Self) -> Self::Mask {
            // SAFETY: as above.
            unsafe {
                (
                    _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0),
                    _mm256_cmp_ps::<_CMP_LE_OQ>(self.1, other.1),
                )
            }
        }
        #[inline(always)]
        fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
            // SAFETY: a mask comes from a comparison of values, which exist only where AVX2 does.
            unsafe { (_mm256_and_ps(a.0, b.0), _mm256_and_ps(a.1, b.1)) }
        }
        #[inline(always)]
        fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
            // SAFETY: as above.
            unsafe {
                Self(
                    _mm256_blendv_ps(no.0, yes.0, mask.0),
                    _mm256_blendv_ps(no.1, yes.1, mask.1),
                )
            }
        }
        #[inline(always)]
        fn trunc(self) -> Self {
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe {
                Self(
                    _mm256_cvtepi32_ps(_mm256_cvttps_epi32(self.0)),
                    _mm256_cvtepi32_ps(_mm256_cvttps_epi32(self.1)),
                )
            }
        }
        #[inline(always)]
        fn store(self, to: &mut [f32], at: usize) {
            let to = &mut to[at..at + LANES];
            // SAFETY: as above; two unaligned stores that together cover a slice of 16 elements.
            unsafe {
                _mm256_storeu_ps(to.as_mut_ptr(), self.0);
                _mm256_storeu_ps(to.as_mut_ptr().add(8), self.1);
            }
        }
    }

    impl Simd for Avx2 {
        type F = F256;

        #[inline(always)]
        fn load(self, from: &[f32], at: usize) -> F256 {
            let from = &from[at..at + LANES];
            // SAFETY: the CPU has AVX2, for `self` exists; two unaligned loads inside a slice of 16 elements.
            unsafe {
                F256(
                    _mm256_loadu_ps(from.as_ptr()),
                    _mm256_loadu_ps(from.as_ptr().add(8)),
                )
            }
        }
        #[inline(always)]
        fn splat(self, value: f32) -> F256 {
            // SAFETY: the CPU has AVX2, for `self` exists.
            unsafe { F256(_mm256_set1_ps(value), _mm256_set1_ps(value)) }
        }
        #[inline(always)]
        fn pairs(self, data: &[f32], stride: usize, row: F256, column: F256) -> (F256, F256) {
            let last = last_pair(data);
            // SAFETY: the CPU has AVX2, for `self` exists. Every place read is at most `last`, so that it and the one
            // after are inside `data`; `last` fits an i32.
            unsafe {
                let limit = _mm256_set1_epi32(last as i32);
                let stride = _mm256_set1_epi32(stride as i32);
                let places = |row, column| {
                    let row = _mm256_mullo_epi32(_mm256_cvttps_epi32(row), stride);
                    _mm256_min_epu32(_mm256_add_epi32(row, _mm256_cvttps_epi32(column)), limit)
                };
                let (low, high) = (places(row.0, column.0), places(row.1, column.1));
                let (base, after) = (data.as_ptr(), data.as_ptr().add(1));
                (
                    F256(
                        _mm256_i32gather_ps::<4>(base, low),
                        _mm256_i32gather_ps::<4>(base, high),
                    ),
                    F256(
                        _mm256_i32gather_ps::<4>(after, low),
                        _mm256_i32gather_ps::<4>(after, high),
                    ),
                )
            }
        }
    }
}
