//! `f32` side by side, in whatever registers a level has: sixteen, or eight.
//!
//! A kernel is written over [`Simd`], which stands for the instructions of one level. Its values and types exist only where
//! this CPU has that level: `dispatch` alone makes one, after it has looked, and outside of `simd` no code can name the
//! type that implements it, nor those of its lanes. That is what makes the operations safe to call.
//!
//! Eight is for kernels that keep many sums in registers: a sum over lanes has one order on every level, and sixteen would
//! leave more of a window's rows to padding than they gain.

use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// Elements in one [`Floats`].
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
    /// Whether the mask is true in every lane.
    fn all(mask: Self::Mask) -> bool;
    /// Whether the mask is true in any lane.
    fn any(mask: Self::Mask) -> bool;
    /// The lane that stands first.
    fn first(self) -> f32;
    /// Lanes 0, 2, 4, .. and 1, 3, 5, .. of `self` followed by `next`.
    fn deinterleave(self, next: Self) -> (Self, Self);
    /// The inverse of [`Floats::deinterleave`]: `self` has the even lanes, `odd` the odd ones.
    fn interleave(self, odd: Self) -> (Self, Self);
    /// Write to all of `to`.
    fn put(self, to: &mut [f32; LANES]);
}

/// Sixteen elements were asked for where there are fewer.
#[cold]
fn beyond(len: usize, at: usize) -> ! {
    panic!("{LANES} elements at {at} of {len}")
}

/// `count` times sixteen elements of `row` from `first` on. A loop over `0..count` then needs no check of an index.
#[inline(always)]
pub(crate) fn blocks(row: &[f32], first: usize, count: usize) -> &[[f32; LANES]] {
    &row[first..].as_chunks::<LANES>().0[..count]
}

/// [`blocks`], to write.
#[inline(always)]
pub(crate) fn blocks_mut(row: &mut [f32], first: usize, count: usize) -> &mut [[f32; LANES]] {
    &mut row[first..].as_chunks_mut::<LANES>().0[..count]
}

/// The instructions of a level.
pub(crate) trait Simd: Copy {
    /// Its sixteen floats.
    type F: Floats;
    /// Its eight floats.
    type Eight: Eight;
    /// All of `from`.
    fn get(self, from: &[f32; LANES]) -> Self::F;
    /// `from[at..at + 16]`.
    #[inline(always)]
    fn load(self, from: &[f32], at: usize) -> Self::F {
        match from[at..].first_chunk::<LANES>() {
            Some(from) => self.get(from),
            None => beyond(from.len(), at),
        }
    }
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
    /// Of the sixteen elements of `low` and then those of `high`, the one at `index`, per lane. `index` is a whole number
    /// within 0..32.
    fn lookup(self, low: Self::F, high: Self::F, index: Self::F) -> Self::F;
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
pub(super) fn last_pair(data: &[f32]) -> u32 {
    assert!(data.len() >= 2 && data.len() <= i32::MAX as usize);
    (data.len() - 2) as u32
}

/// Eight of one [`Eight`].
pub(crate) const EIGHT: usize = 8;

/// Eight values in memory.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub(crate) struct Packed(pub(crate) [f32; EIGHT]);

impl Packed {
    pub(crate) const ZERO: Self = Self([0.0; EIGHT]);

    /// 0, 1, ...
    pub(crate) const STEPS: Self = Self([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);

    /// The sum over lanes, in a fixed order.
    #[inline(always)]
    pub(crate) fn sum(self) -> f64 {
        let [a, b, c, d, e, f, g, h] = self.0;
        f64::from(((a + e) + (c + g)) + ((b + f) + (d + h)))
    }
}

/// [`Eight::first`] of any count, from one place or another on.
static FIRST: [f32; 2 * EIGHT] = {
    let mut masks = [0.0; 2 * EIGHT];
    let mut lane = 0;
    while lane < EIGHT {
        masks[lane] = f32::from_bits(u32::MAX);
        lane += 1;
    }
    masks
};

/// Eight `f32` in registers; arithmetic is element by element.
pub(crate) trait Eight:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + AddAssign
{
    /// The same value in every lane.
    fn splat(value: f32) -> Self;

    /// The values from `at` on.
    fn load(from: &[f32], at: usize) -> Self;

    /// Write to the values from `at` on.
    fn store(self, to: &mut [f32], at: usize);

    /// From memory.
    fn unpack(from: &Packed) -> Self;

    /// To memory.
    fn pack(self) -> Packed;

    /// All bits set in the first `count` lanes, none in the others: a mask for [`Eight::keep`].
    #[inline(always)]
    fn first(count: usize) -> Self {
        Self::load(&FIRST, EIGHT - count.min(EIGHT))
    }

    /// Keep the bits of `mask`: all of a lane or none, whatever it holds.
    fn keep(self, mask: Self) -> Self;

    /// All bits set in the lanes that are not less than those of `other`, none where either is NaN: a mask.
    fn mask_from(self, other: Self) -> Self;

    /// The lanes of `set` where all bits of this mask are set, of `clear` where none is.
    fn choose(self, set: Self, clear: Self) -> Self;

    /// The square roots.
    fn sqrt(self) -> Self;

    /// The larger of both; that of `other` where either is NaN.
    fn larger(self, other: Self) -> Self;

    /// Which lanes are not less than those of `other`, one bit each; none where either is NaN.
    fn at_least(self, other: Self) -> u8;

    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }

    /// The sum over lanes, in the order of [`Packed::sum`].
    #[inline(always)]
    fn sum(self) -> f64 {
        self.pack().sum()
    }

    /// [`Eight::sum`] of each. A closure given to `map` would not be compiled with the level's instructions.
    #[inline(always)]
    fn sums<const N: usize>(lanes: &[Self; N]) -> [f64; N] {
        let mut sums = [0.0; N];
        for (sum, lanes) in sums.iter_mut().zip(lanes) {
            *sum = lanes.sum();
        }
        sums
    }
}
