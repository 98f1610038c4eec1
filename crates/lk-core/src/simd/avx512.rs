//! `unsafe` in this file: AVX-512, for CPUs that have it.
#![allow(unsafe_code)]

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

use super::avx2::Avx;
use super::lanes::{Floats, LANES, Simd, last_pair};

/// Exists only where AVX-512 F and DQ do.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

impl Avx512 {
    /// # Safety
    ///
    /// This CPU must have AVX-512 F and DQ.
    pub(super) unsafe fn new() -> Self {
        Self(())
    }
}

/// Sixteen floats; made by [`Avx512`] only.
#[derive(Clone, Copy)]
pub(super) struct F512(__m512);

macro_rules! operators {
    ($($name:ident $function:ident $wide:ident),+) => {$(
        impl $name for F512 {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                // SAFETY: the CPU has AVX-512 F, for `self` exists.
                Self(unsafe { $wide(self.0, other.0) })
            }
        }
    )+};
}
operators!(
    Add add _mm512_add_ps,
    Sub sub _mm512_sub_ps,
    Mul mul _mm512_mul_ps,
    Div div _mm512_div_ps
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
    fn all(mask: Self::Mask) -> bool {
        mask == __mmask16::MAX
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        mask != 0
    }
    #[inline(always)]
    fn first(self) -> f32 {
        // SAFETY: as above.
        unsafe { _mm512_cvtss_f32(self.0) }
    }
    #[inline(always)]
    fn deinterleave(self, next: Self) -> (Self, Self) {
        // SAFETY: as above.
        unsafe {
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
            (
                Self(_mm512_permutex2var_ps(self.0, even, next.0)),
                Self(_mm512_permutex2var_ps(self.0, odd, next.0)),
            )
        }
    }
    #[inline(always)]
    fn interleave(self, odd: Self) -> (Self, Self) {
        // SAFETY: as above.
        unsafe {
            let low = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
            let high =
                _mm512_setr_epi32(8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
            (
                Self(_mm512_permutex2var_ps(self.0, low, odd.0)),
                Self(_mm512_permutex2var_ps(self.0, high, odd.0)),
            )
        }
    }
    #[inline(always)]
    fn put(self, to: &mut [f32; LANES]) {
        // SAFETY: as above; an unaligned store over the whole of an array of 16 elements.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }
}

impl Simd for Avx512 {
    type F = F512;
    /// Eight lanes here too: what AVX-512 adds is twice the registers.
    type Eight = Avx;

    #[inline(always)]
    fn get(self, from: &[f32; LANES]) -> F512 {
        // SAFETY: the CPU has AVX-512 F, for `self` exists; an unaligned load of an array of 16 elements.
        F512(unsafe { _mm512_loadu_ps(from.as_ptr()) })
    }
    #[inline(always)]
    fn splat(self, value: f32) -> F512 {
        // SAFETY: the CPU has AVX-512 F, for `self` exists.
        F512(unsafe { _mm512_set1_ps(value) })
    }
    #[inline(always)]
    fn lookup(self, low: F512, high: F512, index: F512) -> F512 {
        // SAFETY: the CPU has AVX-512 F, for `self` exists.
        F512(unsafe { _mm512_permutex2var_ps(low.0, _mm512_cvttps_epi32(index.0), high.0) })
    }
    #[inline(always)]
    fn pairs(self, data: &[f32], stride: usize, row: F512, column: F512) -> (F512, F512) {
        let last = last_pair(data);
        // SAFETY: the CPU has AVX-512 F and DQ, for `self` exists. Every place read is at most `last`, so that the
        // eight bytes there are inside `data`; `last` fits an i32.
        unsafe {
            let row =
                _mm512_mullo_epi32(_mm512_cvttps_epi32(row.0), _mm512_set1_epi32(stride as i32));
            let places = _mm512_add_epi32(row, _mm512_cvttps_epi32(column.0));
            let places = _mm512_min_epu32(places, _mm512_set1_epi32(last as i32));
            let base = data.as_ptr().cast();
            let low = _mm512_i32gather_epi64::<4>(_mm512_castsi512_si256(places), base);
            let high = _mm512_i32gather_epi64::<4>(_mm512_extracti32x8_epi32::<1>(places), base);
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
            let first = _mm512_permutex2var_epi32(low, even, high);
            let second = _mm512_permutex2var_epi32(low, odd, high);
            (
                F512(_mm512_castsi512_ps(first)),
                F512(_mm512_castsi512_ps(second)),
            )
        }
    }
}
