//! `unsafe` in this file: SSE2, which every x86-64 CPU has.
#![allow(unsafe_code)]

use std::arch::x86_64::*;

use super::lanes::{EIGHT, Eight, Packed, Simd};
use super::plain::{eight_operators, sixteen_in_array};

/// The instructions of every x86-64 CPU.
#[derive(Clone, Copy)]
pub(super) struct Sse2;

impl Simd for Sse2 {
    type Eight = Sse;

    sixteen_in_array!();
}

/// The sum of a, b, c, d as (a + c) + (b + d).
#[inline(always)]
pub(super) fn sum_of_four(four: __m128) -> f32 {
    // SAFETY: every x86-64 CPU has SSE.
    unsafe {
        let pairs = _mm_add_ps(four, _mm_movehl_ps(four, four));
        _mm_cvtss_f32(_mm_add_ss(pairs, _mm_shuffle_ps::<1>(pairs, pairs)))
    }
}

/// The lanes in two SSE registers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sse(__m128, __m128);

impl Sse {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe { Self(_mm_add_ps(self.0, other.0), _mm_add_ps(self.1, other.1)) }
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe { Self(_mm_sub_ps(self.0, other.0), _mm_sub_ps(self.1, other.1)) }
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe { Self(_mm_mul_ps(self.0, other.0), _mm_mul_ps(self.1, other.1)) }
    }
}

eight_operators!(Sse);

impl Eight for Sse {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe { Self(_mm_set1_ps(value), _mm_set1_ps(value)) }
    }

    #[inline(always)]
    fn load(from: &[f32], at: usize) -> Self {
        let from = &from[at..at + EIGHT];
        // SAFETY: the slice holds eight values.
        unsafe {
            Self(
                _mm_loadu_ps(from.as_ptr()),
                _mm_loadu_ps(from.as_ptr().add(4)),
            )
        }
    }

    #[inline(always)]
    fn store(self, to: &mut [f32], at: usize) {
        let to = &mut to[at..at + EIGHT];
        // SAFETY: the slice holds eight values.
        unsafe {
            _mm_storeu_ps(to.as_mut_ptr(), self.0);
            _mm_storeu_ps(to.as_mut_ptr().add(4), self.1);
        }
    }

    #[inline(always)]
    fn unpack(from: &Packed) -> Self {
        // SAFETY: `Packed` holds eight values and is aligned to 32 bytes.
        unsafe {
            Self(
                _mm_load_ps(from.0.as_ptr()),
                _mm_load_ps(from.0.as_ptr().add(4)),
            )
        }
    }

    #[inline(always)]
    fn pack(self) -> Packed {
        let mut to = Packed::ZERO;
        // SAFETY: `Packed` holds eight values and is aligned to 32 bytes.
        unsafe {
            _mm_store_ps(to.0.as_mut_ptr(), self.0);
            _mm_store_ps(to.0.as_mut_ptr().add(4), self.1);
        }
        to
    }

    #[inline(always)]
    fn keep(self, mask: Self) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe { Self(_mm_and_ps(self.0, mask.0), _mm_and_ps(self.1, mask.1)) }
    }

    #[inline(always)]
    fn mask_from(self, other: Self) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe { Self(_mm_cmpge_ps(self.0, other.0), _mm_cmpge_ps(self.1, other.1)) }
    }

    #[inline(always)]
    fn choose(self, set: Self, clear: Self) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe {
            Self(
                _mm_or_ps(_mm_and_ps(self.0, set.0), _mm_andnot_ps(self.0, clear.0)),
                _mm_or_ps(_mm_and_ps(self.1, set.1), _mm_andnot_ps(self.1, clear.1)),
            )
        }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe { Self(_mm_sqrt_ps(self.0), _mm_sqrt_ps(self.1)) }
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        // SAFETY: every x86-64 CPU has SSE.
        unsafe { Self(_mm_max_ps(self.0, other.0), _mm_max_ps(self.1, other.1)) }
    }

    #[inline(always)]
    fn sum(self) -> f64 {
        // SAFETY: every x86-64 CPU has SSE.
        f64::from(sum_of_four(unsafe { _mm_add_ps(self.0, self.1) }))
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> u8 {
        // SAFETY: every x86-64 CPU has SSE.
        let (low, high) = unsafe {
            (
                _mm_movemask_ps(_mm_cmpge_ps(self.0, other.0)),
                _mm_movemask_ps(_mm_cmpge_ps(self.1, other.1)),
            )
        };
        (low | high << 4) as u8
    }
}
