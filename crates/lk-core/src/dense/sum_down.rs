//! From rows of differences to sums down the columns of windows.
//!
//! Rows are split: even pixels first, then odd ones, so that two neighbours share all but one column of their windows.
#![allow(clippy::needless_range_loop, reason = "several arrays run along")]

use crate::simd::{Floats, Kernel, LANES, Simd, blocks, blocks_mut};

use super::padded_plane::PAD;

/// Quantities of a pixel in the ring: weight, gradient along x and y, difference.
pub(super) const KEPT: usize = 4;
/// Quantities that are summed: gx, gy, d, gx gx, gx gy, gy gy, gx d, gy d, d d, and the weight as the last.
pub(super) const SUMS: usize = 10;
/// Elements of half a split row, its room on both sides included, and the groups of lanes in it.
#[derive(Clone, Copy)]
pub(super) struct Split {
    pub(super) half: usize,
    pub(super) count: usize,
}

impl Split {
    pub(super) fn of(width: usize) -> Self {
        let count = width.div_ceil(2 * LANES);
        Self {
            half: count * LANES + 2 * PAD,
            count,
        }
    }
}

/// Room for rows of the ring.
pub(super) fn as_kept(memory: &mut [f32]) -> &mut [Kept] {
    let (lanes, _) = memory.as_chunks_mut::<LANES>();
    let (pixels, _) = lanes.as_chunks_mut::<KEPT>();
    pixels.as_chunks_mut::<2>().0
}

/// A group of pixels of a row of the ring, the even ones and the odd ones: weight, gradient along x and y, difference.
pub(super) type Kept = [[[f32; LANES]; KEPT]; 2];

/// Gradients and difference of a row of pixels.
pub(super) struct Differences<'a> {
    /// `prev` plus `next` in the rows above, at and below.
    pub(super) sum: [&'a [f32]; 3],
    /// `next` minus `prev`.
    pub(super) difference: &'a [f32],
    pub(super) weight: &'a [f32],
    pub(super) kept: &'a mut [Kept],
}

/// Pairs of groups of lanes of a padded row, from pixel `offset - 1` on.
#[inline(always)]
fn pairs(row: &[f32], offset: usize, count: usize) -> &[[[f32; LANES]; 2]] {
    &blocks(row, PAD + offset - 1, 2 * count).as_chunks::<2>().0[..count]
}

impl Kernel for Differences<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.kept.len();
        let (zero, quarter) = (s.splat(0.0), s.splat(0.25));
        let [above, here, below] = self.sum;
        let (left, right) = (pairs(here, 0, count), pairs(here, 2, count));
        let (above, below) = (pairs(above, 1, count), pairs(below, 1, count));
        let difference = pairs(self.difference, 1, count);
        let weight = pairs(self.weight, 1, count);
        for i in 0..count {
            let mut both = [[zero; KEPT]; 2];
            for k in 0..2 {
                let weight = s.get(&weight[i][k]);
                let on = zero.lt(weight);
                let along_x = s.get(&right[i][k]) - s.get(&left[i][k]);
                let along_y = s.get(&below[i][k]) - s.get(&above[i][k]);
                both[k] = [
                    weight,
                    S::F::select(on, along_x * quarter, zero),
                    S::F::select(on, along_y * quarter, zero),
                    S::F::select(on, s.get(&difference[i][k]), zero),
                ];
            }
            let [first, second] = both;
            let [even_row, odd_row] = &mut self.kept[i];
            for kept in 0..KEPT {
                let (even, odd) = first[kept].deinterleave(second[kept]);
                even.put(&mut even_row[kept]);
                odd.put(&mut odd_row[kept]);
            }
        }
    }
}

/// Do the same for each quantity that is summed; an index that is known when this is compiled keeps sums in registers.
macro_rules! each_sum {
    ($q:ident => $body:expr) => {
        each_sum!(@ $q $body; 0 1 2 3 4 5 6 7 8)
    };
    (@ $q:ident $body:expr; $($index:literal)+) => {$({
        const $q: usize = $index;
        $body
    })+};
}

/// Sums down the columns of the windows of two rows of pixels, or of the upper one alone.
pub(super) struct SumDown<'a, const N: usize, const BOTH: bool> {
    pub(super) split: Split,
    /// Whether the weights are summed too.
    pub(super) counted: bool,
    /// The row that only the windows of the upper row of pixels reach.
    pub(super) above: &'a [Kept],
    /// The `N - 1` rows that both reach; the last one stands twice.
    pub(super) shared: [&'a [Kept]; N],
    /// The row that only the windows of the lower row of pixels reach.
    pub(super) below: &'a [Kept],
    pub(super) sums: [&'a mut [f32]; 2],
}

impl<const N: usize, const BOTH: bool> Kernel for SumDown<'_, N, BOTH> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        self.even_or_odd::<S, 0>(s);
        self.even_or_odd::<S, 1>(s);
        if self.counted {
            self.weights::<S, 0>(s);
            self.weights::<S, 1>(s);
        }
    }
}

impl<const N: usize, const BOTH: bool> SumDown<'_, N, BOTH> {
    #[inline(always)]
    fn even_or_odd<S: Simd, const ODD: usize>(&mut self, s: S) {
        let Split { half, count } = self.split;
        let (above, below) = (&self.above[..count], &self.below[..count]);
        let mut shared = self.shared;
        for row in &mut shared {
            *row = &row[..count];
        }
        let [first, second] = &mut self.sums;
        let (mut first, _) = quantities(first, half, count);
        let (mut second, _) = quantities(second, half, count);
        for i in 0..count {
            let mut both = products(s, &shared[0][i][ODD]);
            for row in &shared[1..N - 1] {
                let more = products(s, &row[i][ODD]);
                each_sum!(Q => both[Q] = both[Q] + more[Q]);
            }
            let more = products(s, &above[i][ODD]);
            each_sum!(Q => put::<S, ODD>(s, both[Q] + more[Q], &mut first[Q], i));
            if BOTH {
                let more = products(s, &below[i][ODD]);
                each_sum!(Q => put::<S, ODD>(s, both[Q] + more[Q], &mut second[Q], i));
            }
        }
    }

    /// The same for the weights.
    #[inline(always)]
    fn weights<S: Simd, const ODD: usize>(&mut self, s: S) {
        let Split { half, count } = self.split;
        let [first, second] = &mut self.sums;
        let (_, mut first) = quantities(first, half, count);
        let (_, mut second) = quantities(second, half, count);
        for i in 0..count {
            let mut both = s.get(&self.shared[0][i][ODD][0]);
            for row in &self.shared[1..N - 1] {
                both = both + s.get(&row[i][ODD][0]);
            }
            let (above, below) = (s.get(&self.above[i][ODD][0]), s.get(&self.below[i][ODD][0]));
            put::<S, ODD>(s, both + above, &mut first, i);
            put::<S, ODD>(s, both + below, &mut second, i);
        }
    }
}

/// Even pixels, odd ones, and pairs of both of one quantity.
type Quantity<'a> = [&'a mut [[f32; LANES]]; 3];

/// The quantities of a row of sums, and the weights.
#[inline(always)]
fn quantities(
    row: &mut [f32],
    half: usize,
    count: usize,
) -> ([Quantity<'_>; SUMS - 1], Quantity<'_>) {
    let mut rest = row;
    macro_rules! next {
        () => {
            [
                part(&mut rest, half, count),
                part(&mut rest, half, count),
                part(&mut rest, half, count),
            ]
        };
    }
    let first = [
        next!(),
        next!(),
        next!(),
        next!(),
        next!(),
        next!(),
        next!(),
        next!(),
        next!(),
    ];
    (first, next!())
}

#[inline(always)]
fn part<'a>(rest: &mut &'a mut [f32], half: usize, count: usize) -> &'a mut [[f32; LANES]] {
    let (part, after) = std::mem::take(rest).split_at_mut(half);
    *rest = after;
    blocks_mut(part, PAD, count)
}

/// Write a sum; with that of an odd pixel, that of the pair.
#[inline(always)]
fn put<S: Simd, const ODD: usize>(s: S, sum: S::F, to: &mut Quantity<'_>, i: usize) {
    sum.put(&mut to[ODD][i]);
    if ODD == 1 {
        (s.get(&to[0][i]) + sum).put(&mut to[2][i]);
    }
}

#[inline(always)]
fn products<S: Simd>(s: S, kept: &[[f32; LANES]; KEPT]) -> [S::F; SUMS - 1] {
    let (gx, gy, d) = (s.get(&kept[1]), s.get(&kept[2]), s.get(&kept[3]));
    [gx, gy, d, gx * gx, gx * gy, gy * gy, gx * d, gy * d, d * d]
}
