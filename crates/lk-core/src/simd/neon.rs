//! `unsafe` in this file: NEON, which every aarch64 CPU has.
#![allow(unsafe_code)]

use std::arch::aarch64::*;
use std::ops::{Add, Div, Mul, Sub};

use super::lanes::{EIGHT, Eight, Floats, LANES, Packed, Simd, last_pair};
use super::plain::eight_operators;

/// The instructions of every aarch64 CPU.
#[derive(Clone, Copy)]
pub(super) struct Neon;

/// Sixteen floats in four registers.
#[derive(Clone, Copy)]
pub(super) struct F128x4([float32x4_t; 4]);

/// An operation on each of the four registers of its arguments.
macro_rules! each {
    ($operation:ident($($from:expr),+)) => {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe {
            [
                $operation($($from[0]),+),
                $operation($($from[1]),+),
                $operation($($from[2]),+),
                $operation($($from[3]),+),
            ]
        }
    };
}

macro_rules! operators {
    ($($name:ident $function:ident $operation:ident),+) => {$(
        impl $name for F128x4 {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(each!($operation(self.0, other.0)))
            }
        }
    )+};
}
operators!(
    Add add vaddq_f32,
    Sub sub vsubq_f32,
    Mul mul vmulq_f32,
    Div div vdivq_f32
);

impl Floats for F128x4 {
    type Mask = [uint32x4_t; 4];

    // Those of the architecture give a NaN where either side is one.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(self.lt(other), self, other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(other.lt(self), self, other)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(each!(vsqrtq_f32(self.0)))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        each!(vcltq_f32(self.0, other.0))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        each!(vcleq_f32(self.0, other.0))
    }
    #[inline(always)]
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        each!(vandq_u32(a, b))
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(each!(vbslq_f32(mask, yes.0, no.0)))
    }
    #[inline(always)]
    fn trunc(self) -> Self {
        let whole = each!(vcvtq_s32_f32(self.0));
        Self(each!(vcvtq_f32_s32(whole)))
    }
    #[inline(always)]
    fn all(mask: Self::Mask) -> bool {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe {
            let halves = (vandq_u32(mask[0], mask[1]), vandq_u32(mask[2], mask[3]));
            vminvq_u32(vandq_u32(halves.0, halves.1)) != 0
        }
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe {
            let halves = (vorrq_u32(mask[0], mask[1]), vorrq_u32(mask[2], mask[3]));
            vmaxvq_u32(vorrq_u32(halves.0, halves.1)) != 0
        }
    }
    #[inline(always)]
    fn first(self) -> f32 {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe { vgetq_lane_f32::<0>(self.0[0]) }
    }
    #[inline(always)]
    fn deinterleave(self, next: Self) -> (Self, Self) {
        let first = [self.0[0], self.0[2], next.0[0], next.0[2]];
        let second = [self.0[1], self.0[3], next.0[1], next.0[3]];
        (
            Self(each!(vuzp1q_f32(first, second))),
            Self(each!(vuzp2q_f32(first, second))),
        )
    }
    #[inline(always)]
    fn interleave(self, odd: Self) -> (Self, Self) {
        let low = each!(vzip1q_f32(self.0, odd.0));
        let high = each!(vzip2q_f32(self.0, odd.0));
        (
            Self([low[0], high[0], low[1], high[1]]),
            Self([low[2], high[2], low[3], high[3]]),
        )
    }
    #[inline(always)]
    fn put(self, to: &mut [f32; LANES]) {
        // SAFETY: every aarch64 CPU has NEON; the four stores cover an array of 16 elements.
        unsafe { vst1q_f32_x4(to.as_mut_ptr(), self.all_four()) }
    }
}

impl F128x4 {
    #[inline(always)]
    fn all_four(self) -> float32x4x4_t {
        let [a, b, c, d] = self.0;
        float32x4x4_t(a, b, c, d)
    }

    /// The bytes, for a table of them.
    #[inline(always)]
    fn bytes(self) -> uint8x16x4_t {
        let [a, b, c, d] = each!(vreinterpretq_u8_f32(self.0));
        uint8x16x4_t(a, b, c, d)
    }
}

/// Elements `at[0]`, .. `at[3]` of `data`, and the element after each.
///
/// # Safety
///
/// `data` must have two elements at each of these places.
#[inline(always)]
unsafe fn four_pairs(data: &[f32], at: uint32x4_t) -> (float32x4_t, float32x4_t) {
    // SAFETY: every aarch64 CPU has NEON; the caller vouches for the places.
    unsafe {
        let data = data.as_ptr();
        let low = vcombine_f32(
            vld1_f32(data.add(vgetq_lane_u32::<0>(at) as usize)),
            vld1_f32(data.add(vgetq_lane_u32::<1>(at) as usize)),
        );
        let high = vcombine_f32(
            vld1_f32(data.add(vgetq_lane_u32::<2>(at) as usize)),
            vld1_f32(data.add(vgetq_lane_u32::<3>(at) as usize)),
        );
        (vuzp1q_f32(low, high), vuzp2q_f32(low, high))
    }
}

impl Simd for Neon {
    type F = F128x4;
    type Eight = Eight128x2;

    #[inline(always)]
    fn get(self, from: &[f32; LANES]) -> F128x4 {
        // SAFETY: every aarch64 CPU has NEON; the four loads are inside an array of 16 elements.
        let float32x4x4_t(a, b, c, d) = unsafe { vld1q_f32_x4(from.as_ptr()) };
        F128x4([a, b, c, d])
    }
    #[inline(always)]
    fn splat(self, value: f32) -> F128x4 {
        // SAFETY: every aarch64 CPU has NEON.
        F128x4([unsafe { vdupq_n_f32(value) }; 4])
    }
    #[inline(always)]
    fn lookup(self, low: F128x4, high: F128x4, index: F128x4) -> F128x4 {
        /// Of the bytes of `low` and then those of `high`, the four of each element whose place is in `index`.
        #[inline(always)]
        unsafe fn pick(low: uint8x16x4_t, high: uint8x16x4_t, index: float32x4_t) -> float32x4_t {
            // SAFETY: every aarch64 CPU has NEON.
            unsafe {
                let (four, bytes) = (vdupq_n_u32(0x0404_0404), vdupq_n_u32(0x0302_0100));
                let at = vreinterpretq_u8_u32(vmlaq_u32(bytes, vcvtq_u32_f32(index), four));
                // A place beyond its table gives 0 from the first, and leaves what is there from the second.
                let found = vqtbl4q_u8(low, at);
                let found = vqtbx4q_u8(found, high, vsubq_u8(at, vdupq_n_u8(64)));
                vreinterpretq_f32_u8(found)
            }
        }
        let (low, high) = ([low.bytes(); 4], [high.bytes(); 4]);
        F128x4(each!(pick(low, high, index.0)))
    }
    #[inline(always)]
    fn pairs(self, data: &[f32], stride: usize, row: F128x4, column: F128x4) -> (F128x4, F128x4) {
        let (last, stride) = ([last_pair(data); 4], [stride as u32; 4]);
        let (last, stride) = (each!(vdupq_n_u32(last)), each!(vdupq_n_u32(stride)));
        let (row, column) = (each!(vcvtq_u32_f32(row.0)), each!(vcvtq_u32_f32(column.0)));
        let places = each!(vmlaq_u32(column, row, stride));
        let places = each!(vminq_u32(places, last));
        // SAFETY: every place is at most `last`, so that it and the one after are inside `data`.
        let [a, b, c, d] = unsafe {
            [
                four_pairs(data, places[0]),
                four_pairs(data, places[1]),
                four_pairs(data, places[2]),
                four_pairs(data, places[3]),
            ]
        };
        (F128x4([a.0, b.0, c.0, d.0]), F128x4([a.1, b.1, c.1, d.1]))
    }
}

/// Eight floats in two registers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eight128x2(float32x4_t, float32x4_t);

/// An operation on both registers of its arguments.
macro_rules! halves {
    ($operation:ident($($from:expr),+)) => {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe { Eight128x2($operation($($from.0),+), $operation($($from.1),+)) }
    };
}

impl Eight128x2 {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        halves!(vaddq_f32(self, other))
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        halves!(vsubq_f32(self, other))
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        halves!(vmulq_f32(self, other))
    }

    /// The bits, as whole numbers.
    #[inline(always)]
    fn bits(self) -> (uint32x4_t, uint32x4_t) {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe { (vreinterpretq_u32_f32(self.0), vreinterpretq_u32_f32(self.1)) }
    }

    #[inline(always)]
    fn of_bits(low: uint32x4_t, high: uint32x4_t) -> Self {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe { Self(vreinterpretq_f32_u32(low), vreinterpretq_f32_u32(high)) }
    }
}

eight_operators!(Eight128x2);

impl Eight for Eight128x2 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe { Self(vdupq_n_f32(value), vdupq_n_f32(value)) }
    }

    #[inline(always)]
    fn load(from: &[f32], at: usize) -> Self {
        let from = &from[at..at + EIGHT];
        // SAFETY: the slice holds eight values.
        unsafe { Self(vld1q_f32(from.as_ptr()), vld1q_f32(from.as_ptr().add(4))) }
    }

    #[inline(always)]
    fn store(self, to: &mut [f32], at: usize) {
        let to = &mut to[at..at + EIGHT];
        // SAFETY: the slice holds eight values.
        unsafe {
            vst1q_f32(to.as_mut_ptr(), self.0);
            vst1q_f32(to.as_mut_ptr().add(4), self.1);
        }
    }

    #[inline(always)]
    fn unpack(from: &Packed) -> Self {
        Self::load(&from.0, 0)
    }

    #[inline(always)]
    fn pack(self) -> Packed {
        let mut to = Packed::ZERO;
        self.store(&mut to.0, 0);
        to
    }

    #[inline(always)]
    fn keep(self, mask: Self) -> Self {
        let (bits, mask) = (self.bits(), mask.bits());
        // SAFETY: every aarch64 CPU has NEON.
        unsafe { Self::of_bits(vandq_u32(bits.0, mask.0), vandq_u32(bits.1, mask.1)) }
    }

    #[inline(always)]
    fn mask_from(self, other: Self) -> Self {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe { Self::of_bits(vcgeq_f32(self.0, other.0), vcgeq_f32(self.1, other.1)) }
    }

    #[inline(always)]
    fn choose(self, set: Self, clear: Self) -> Self {
        halves!(vbslq_f32(self.bits(), set, clear))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        halves!(vsqrtq_f32(self))
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        // SAFETY: every aarch64 CPU has NEON.
        let more = unsafe { (vcgtq_f32(self.0, other.0), vcgtq_f32(self.1, other.1)) };
        halves!(vbslq_f32(more, self, other))
    }

    #[inline(always)]
    fn sum(self) -> f64 {
        // SAFETY: every aarch64 CPU has NEON.
        unsafe {
            let four = vaddq_f32(self.0, self.1);
            let two = vadd_f32(vget_low_f32(four), vget_high_f32(four));
            f64::from(vpadds_f32(two))
        }
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> u8 {
        const BITS: [u32; EIGHT] = [1, 2, 4, 8, 16, 32, 64, 128];
        // SAFETY: every aarch64 CPU has NEON; the loads are inside an array of 8 elements.
        unsafe {
            let low = vandq_u32(vcgeq_f32(self.0, other.0), vld1q_u32(BITS.as_ptr()));
            let high = vandq_u32(vcgeq_f32(self.1, other.1), vld1q_u32(BITS.as_ptr().add(4)));
            vaddvq_u32(vorrq_u32(low, high)) as u8
        }
    }
}
