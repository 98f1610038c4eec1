//! `unsafe` in this file: AVX2, for CPUs that have it.
#![allow(unsafe_code)]

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

use super::lanes::{EIGHT, Eight, Floats, LANES, Packed, Simd, last_pair};
use super::plain::eight_operators;
use super::sse2::sum_of_four;

/// Exists only where AVX2 does.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

impl Avx2 {
    /// # Safety
    ///
    /// This CPU must have AVX2.
    pub(super) unsafe fn new() -> Self {
        Self(())
    }
}

/// Sixteen floats; made by [`Avx2`] only.
#[derive(Clone, Copy)]
pub(super) struct F256(__m256, __m256);

macro_rules! operators {
    ($($name:ident $function:ident $half:ident),+) => {$(
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
    Add add _mm256_add_ps,
    Sub sub _mm256_sub_ps,
    Mul mul _mm256_mul_ps,
    Div div _mm256_div_ps
);

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
    fn all(mask: Self::Mask) -> bool {
        // SAFETY: as for `both`.
        unsafe { _mm256_movemask_ps(_mm256_and_ps(mask.0, mask.1)) == 0xff }
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        // SAFETY: as for `both`.
        unsafe { _mm256_movemask_ps(_mm256_or_ps(mask.0, mask.1)) != 0 }
    }
    #[inline(always)]
    fn first(self) -> f32 {
        // SAFETY: the CPU has AVX2, for `self` exists.
        unsafe { _mm256_cvtss_f32(self.0) }
    }
    #[inline(always)]
    fn deinterleave(self, next: Self) -> (Self, Self) {
        /// The even (0x88) or odd (0xdd) elements of two registers.
        #[inline(always)]
        unsafe fn half<const PICK: i32>(a: __m256, b: __m256) -> __m256 {
            // SAFETY: the caller has AVX2.
            unsafe {
                let mixed = _mm256_castps_pd(_mm256_shuffle_ps::<PICK>(a, b));
                _mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(mixed))
            }
        }
        // SAFETY: the CPU has AVX2, for `self` exists.
        unsafe {
            (
                Self(half::<0x88>(self.0, self.1), half::<0x88>(next.0, next.1)),
                Self(half::<0xdd>(self.0, self.1), half::<0xdd>(next.0, next.1)),
            )
        }
    }
    #[inline(always)]
    fn interleave(self, odd: Self) -> (Self, Self) {
        /// The elements of two registers in turn.
        #[inline(always)]
        unsafe fn zip(even: __m256, odd: __m256) -> F256 {
            // SAFETY: the caller has AVX2.
            unsafe {
                let (low, high) = (_mm256_unpacklo_ps(even, odd), _mm256_unpackhi_ps(even, odd));
                F256(
                    _mm256_permute2f128_ps::<0x20>(low, high),
                    _mm256_permute2f128_ps::<0x31>(low, high),
                )
            }
        }
        // SAFETY: the CPU has AVX2, for `self` exists.
        unsafe { (zip(self.0, odd.0), zip(self.1, odd.1)) }
    }
    #[inline(always)]
    fn put(self, to: &mut [f32; LANES]) {
        // SAFETY: as above; two unaligned stores that together cover an array of 16 elements.
        unsafe {
            _mm256_storeu_ps(to.as_mut_ptr(), self.0);
            _mm256_storeu_ps(to.as_mut_ptr().add(8), self.1);
        }
    }
}

impl Simd for Avx2 {
    type F = F256;
    type Eight = Avx;

    #[inline(always)]
    fn get(self, from: &[f32; LANES]) -> F256 {
        // SAFETY: the CPU has AVX2, for `self` exists; two unaligned loads inside an array of 16 elements.
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
    fn lookup(self, low: F256, high: F256, index: F256) -> F256 {
        /// The elements of four registers of eight at the places in `index`, modulo 32.
        #[inline(always)]
        unsafe fn pick(from: [__m256; 4], index: __m256i) -> __m256 {
            // SAFETY: the caller has AVX2.
            unsafe {
                let [a, b, c, d] = [
                    _mm256_permutevar8x32_ps(from[0], index),
                    _mm256_permutevar8x32_ps(from[1], index),
                    _mm256_permutevar8x32_ps(from[2], index),
                    _mm256_permutevar8x32_ps(from[3], index),
                ];
                // The bits worth 8 and 16, as the signs that a blend looks at.
                let eight = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index));
                let sixteen = _mm256_castsi256_ps(_mm256_slli_epi32::<27>(index));
                let (lower, upper) = (_mm256_blendv_ps(a, b, eight), _mm256_blendv_ps(c, d, eight));
                _mm256_blendv_ps(lower, upper, sixteen)
            }
        }
        // SAFETY: the CPU has AVX2, for `self` exists.
        unsafe {
            let from = [low.0, low.1, high.0, high.1];
            F256(
                pick(from, _mm256_cvttps_epi32(index.0)),
                pick(from, _mm256_cvttps_epi32(index.1)),
            )
        }
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

/// The lanes in one AVX register.
///
/// Outside of `simd` this type is had as that of [`Avx2`] or of [`Avx512`](super::avx512::Avx512) alone, which exist only
/// where the CPU has AVX2. All calls of intrinsics below rely on that.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx(__m256);

impl Avx {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_add_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_sub_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_mul_ps(self.0, other.0) })
    }
}

eight_operators!(Avx);

impl Eight for Avx {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn load(from: &[f32], at: usize) -> Self {
        let from = &from[at..at + EIGHT];
        // SAFETY: the slice holds eight values; this CPU has AVX, see the type.
        Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f32], at: usize) {
        let to = &mut to[at..at + EIGHT];
        // SAFETY: the slice holds eight values; this CPU has AVX, see the type.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn unpack(from: &Packed) -> Self {
        // SAFETY: `Packed` holds eight values aligned to 32 bytes; this CPU has AVX, see the type.
        Self(unsafe { _mm256_load_ps(from.0.as_ptr()) })
    }

    #[inline(always)]
    fn pack(self) -> Packed {
        let mut to = Packed::ZERO;
        // SAFETY: `Packed` holds eight values aligned to 32 bytes; this CPU has AVX, see the type.
        unsafe { _mm256_store_ps(to.0.as_mut_ptr(), self.0) };
        to
    }

    #[inline(always)]
    fn keep(self, mask: Self) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_and_ps(self.0, mask.0) })
    }

    #[inline(always)]
    fn mask_from(self, other: Self) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn choose(self, set: Self, clear: Self) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_blendv_ps(clear.0, set.0, self.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        // SAFETY: this CPU has AVX, see the type.
        Self(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sum(self) -> f64 {
        // SAFETY: this CPU has AVX, see the type.
        let four = unsafe {
            _mm_add_ps(
                _mm256_castps256_ps128(self.0),
                _mm256_extractf128_ps::<1>(self.0),
            )
        };
        f64::from(sum_of_four(four))
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> u8 {
        // SAFETY: this CPU has AVX, see the type.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0)) as u8 }
    }
}
