//! Lanes in arrays, for the compiler to vectorise.
#![allow(clippy::needless_range_loop, reason = "lanes are counted")]

use std::ops::{Add, Div, Mul, Sub};

#[cfg(any(test, not(target_arch = "x86_64")))]
use super::lanes::{EIGHT, Eight, Packed, Simd};
use super::lanes::{Floats, LANES, last_pair};

/// Sixteen floats in an array, for the compiler to vectorise.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Array16([f32; LANES]);

impl Array16 {
    #[inline(always)]
    pub(super) fn new(lanes: [f32; LANES]) -> Self {
        Self(lanes)
    }

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
        impl $name for Array16 {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.zip(other, |a, b| a $sign b)
            }
        }
    )+};
}
array_operators!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Floats for Array16 {
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
    fn all(mask: Self::Mask) -> bool {
        mask.iter().fold(u32::MAX, |all, lane| all & lane) != 0
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        mask.iter().fold(0, |any, lane| any | lane) != 0
    }
    #[inline(always)]
    fn first(self) -> f32 {
        self.0[0]
    }
    #[inline(always)]
    fn deinterleave(self, next: Self) -> (Self, Self) {
        let (mut even, mut odd) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES / 2 {
            even[lane] = self.0[2 * lane];
            odd[lane] = self.0[2 * lane + 1];
            even[LANES / 2 + lane] = next.0[2 * lane];
            odd[LANES / 2 + lane] = next.0[2 * lane + 1];
        }
        (Self(even), Self(odd))
    }
    #[inline(always)]
    fn interleave(self, odd: Self) -> (Self, Self) {
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES / 2 {
            first[2 * lane] = self.0[lane];
            first[2 * lane + 1] = odd.0[lane];
            second[2 * lane] = self.0[LANES / 2 + lane];
            second[2 * lane + 1] = odd.0[LANES / 2 + lane];
        }
        (Self(first), Self(second))
    }
    #[inline(always)]
    fn put(self, to: &mut [f32; LANES]) {
        *to = self.0;
    }
}

/// [`Simd::lookup`](super::Simd::lookup) of arrays.
#[inline(always)]
pub(super) fn lookup(low: Array16, high: Array16, index: Array16) -> Array16 {
    let mut out = [0.0; LANES];
    for lane in 0..LANES {
        let at = index.0[lane] as u32 as usize % (2 * LANES);
        out[lane] = if at < LANES {
            low.0[at]
        } else {
            high.0[at - LANES]
        };
    }
    Array16(out)
}

/// [`Simd::pairs`](super::Simd::pairs) of arrays.
#[inline(always)]
pub(super) fn pairs(
    data: &[f32],
    stride: usize,
    row: Array16,
    column: Array16,
) -> (Array16, Array16) {
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
    (Array16(first), Array16(second))
}

/// The sixteen floats of a level that has them in an array.
macro_rules! sixteen_in_array {
    () => {
        type F = $crate::simd::plain::Array16;

        #[inline(always)]
        fn get(self, from: &[f32; $crate::simd::LANES]) -> Self::F {
            $crate::simd::plain::Array16::new(*from)
        }
        #[inline(always)]
        fn splat(self, value: f32) -> Self::F {
            $crate::simd::plain::Array16::new([value; $crate::simd::LANES])
        }
        #[inline(always)]
        fn lookup(self, low: Self::F, high: Self::F, index: Self::F) -> Self::F {
            $crate::simd::plain::lookup(low, high, index)
        }
        #[inline(always)]
        fn pairs(
            self,
            data: &[f32],
            stride: usize,
            row: Self::F,
            column: Self::F,
        ) -> (Self::F, Self::F) {
            $crate::simd::plain::pairs(data, stride, row, column)
        }
    };
}
#[cfg(target_arch = "x86_64")]
pub(super) use sixteen_in_array;

/// Implement the operators by a method of the same name on a newtype.
macro_rules! eight_operators {
    ($lanes:ty) => {
        impl std::ops::Add for $lanes {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                self.plus(other)
            }
        }
        impl std::ops::Sub for $lanes {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.minus(other)
            }
        }
        impl std::ops::Mul for $lanes {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                self.times(other)
            }
        }
        impl std::ops::AddAssign for $lanes {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = self.plus(other);
            }
        }
    };
}
pub(super) use eight_operators;

/// No instructions in particular.
#[cfg(any(test, not(target_arch = "x86_64")))]
#[derive(Clone, Copy)]
pub(super) struct Plain;

#[cfg(any(test, not(target_arch = "x86_64")))]
impl Simd for Plain {
    type Eight = Array8;

    sixteen_in_array!();
}

/// Eight floats in an array, for architectures without intrinsics here, and to test the others against.
#[cfg(any(test, not(target_arch = "x86_64")))]
#[derive(Debug, Clone, Copy)]
pub(super) struct Array8([f32; EIGHT]);

#[cfg(any(test, not(target_arch = "x86_64")))]
impl Array8 {
    #[inline(always)]
    fn zip(mut self, other: Self, operator: impl Fn(f32, f32) -> f32) -> Self {
        for (lane, other) in self.0.iter_mut().zip(other.0) {
            *lane = operator(*lane, other);
        }
        self
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

#[cfg(any(test, not(target_arch = "x86_64")))]
eight_operators!(Array8);

#[cfg(any(test, not(target_arch = "x86_64")))]
impl Eight for Array8 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; EIGHT])
    }

    #[inline(always)]
    fn load(from: &[f32], at: usize) -> Self {
        let mut lanes = [0.0; EIGHT];
        lanes.copy_from_slice(&from[at..at + EIGHT]);
        Self(lanes)
    }

    #[inline(always)]
    fn store(self, to: &mut [f32], at: usize) {
        to[at..at + EIGHT].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn unpack(from: &Packed) -> Self {
        Self(from.0)
    }

    #[inline(always)]
    fn pack(self) -> Packed {
        Packed(self.0)
    }

    #[inline(always)]
    fn keep(self, mask: Self) -> Self {
        self.zip(mask, |value, mask| {
            f32::from_bits(value.to_bits() & mask.to_bits())
        })
    }

    #[inline(always)]
    fn mask_from(self, other: Self) -> Self {
        self.zip(other, |a, b| {
            f32::from_bits(if a >= b { u32::MAX } else { 0 })
        })
    }

    #[inline(always)]
    fn choose(mut self, set: Self, clear: Self) -> Self {
        for (lane, (set, clear)) in self.0.iter_mut().zip(set.0.into_iter().zip(clear.0)) {
            let mask = lane.to_bits();
            *lane = f32::from_bits(set.to_bits() & mask | clear.to_bits() & !mask);
        }
        self
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for lane in &mut self.0 {
            *lane = lane.sqrt();
        }
        self
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> u8 {
        let mut bits = 0;
        for (lane, (a, b)) in self.0.into_iter().zip(other.0).enumerate() {
            bits |= u8::from(a >= b) << lane;
        }
        bits
    }
}
