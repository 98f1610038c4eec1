//! Sums over the windows of all pixels, row by row: what a Lucas-Kanade step, a refinement and the last look share.
//!
//! Rows stream: `next` is warped row by row, gradients and differences stay in a ring of rows, and window sums run down
//! the ring for two rows at a time, which share all but one row of their windows, and then across. Rows of the ring and
//! of sums are split: even pixels first, then odd ones. Two neighbours then share all but one column as two rows do.
//! Every window is summed afresh, in an order that depends on the place of the pixel alone, so that the division into
//! bands cannot change a bit.
#![allow(clippy::needless_range_loop, reason = "several arrays run along")]

use crate::frame::Plane;
use crate::simd::{Floats, LANES, LaneKernel, Level, Simd, blocks, blocks_mut, dispatch_lanes};

use super::grid::{self, Grid, PAD};
use super::upsample;
use super::warp::WarpRow;

/// The planes of one level, with the flow between them.
#[derive(Clone, Copy)]
pub(super) struct Views<'a> {
    pub(super) prev: &'a Plane,
    pub(super) next: &'a Plane,
    pub(super) u: &'a Grid,
    pub(super) v: &'a Grid,
    /// If `u` and `v` are of half the size: what their values are multiplied by.
    pub(super) halved: Option<f32>,
    /// 0 at pixels of `prev` that count for nothing, 1 elsewhere.
    pub(super) weight: Option<&'a Plane>,
}

impl<'a> Views<'a> {
    /// Row `y` of u and of v, padded; made in `memory`, of two rows, where they are of half the size.
    pub(super) fn flow<'b>(&self, y: usize, memory: &'b mut [f32]) -> [&'b [f32]; 2]
    where
        'a: 'b,
    {
        let Some(scale) = self.halved else {
            return [self.u.padded(y), self.v.padded(y)];
        };
        let width = self.prev.width();
        let (u, v) = memory.split_at_mut(grid::stride(width));
        upsample::row(self.u, y, width, scale, u);
        upsample::row(self.v, y, width, scale, v);
        [u, v]
    }
}

/// Rows that the gradient along y needs.
const NEAR: usize = 3;
/// Rows of the ring: those of the windows of two rows of pixels, 7 high, and a power of two.
const RING: usize = 8;
/// Quantities of a pixel in the ring: weight, gradient along x and y, difference.
const KEPT: usize = 4;
/// Quantities that are summed: gx, gy, d, gx gx, gx gy, gy gy, gx d, gy d, d d, and the weight as the last.
const SUMS: usize = 10;

/// What is known of the weights of a row of the ring.
#[derive(Clone, Copy, PartialEq)]
enum Counts {
    /// Above or below the picture: 0.
    Nothing,
    /// 1 in the whole picture.
    All,
    /// Anything.
    Some,
}

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

/// Rows of window sums, made one after the other.
pub(super) struct Windows<'a> {
    level: Level,
    views: Views<'a>,
    radius: usize,
    centred: bool,
    stride: usize,
    split: Split,
    /// `NEAR` rows each of the sum of `prev` and warped `next`, of their difference, and of the weight.
    near: [&'a mut [f32]; 3],
    /// A row of u and of v, where they are of half the size.
    flow: &'a mut [f32],
    /// Whether the weights of those rows are all 1.
    whole: [bool; NEAR],
    /// `RING` rows.
    ring: &'a mut [Kept],
    counts: [Counts; RING],
    /// Two rows of sums: of each quantity the even pixels, the odd ones, and the sums of a pair.
    sums: &'a mut [f32],
    /// The even one of the two rows that `sums` holds.
    summed: Option<usize>,
    /// Split rows: pixels of each window, and the inverse of that number.
    number: &'a mut [f32],
    /// How many rows of pixels `number` was made for, where no weight is in question.
    numbered: Option<usize>,
    /// The next row of the ring to make.
    upcoming: isize,
}

impl<'a> Windows<'a> {
    /// Elements of memory for pictures of this width.
    pub(super) fn size(width: usize) -> usize {
        let half = Split::of(width).half;
        RING * KEPT * 2 * half
            + (3 * NEAR + 2) * grid::stride(width)
            + 2 * SUMS * 3 * half
            + 4 * half
    }

    /// Windows of `2 radius + 1` pixels; with `centred`, their means do not count.
    pub(super) fn new(
        level: Level,
        views: Views<'a>,
        radius: usize,
        centred: bool,
        memory: &'a mut [f32],
    ) -> Self {
        let width = views.prev.width();
        let (stride, split) = (grid::stride(width), Split::of(width));
        let (sum, memory) = memory.split_at_mut(NEAR * stride);
        let (difference, memory) = memory.split_at_mut(NEAR * stride);
        let (weight, memory) = memory.split_at_mut(NEAR * stride);
        let (flow, memory) = memory.split_at_mut(2 * stride);
        let (ring, memory) = memory.split_at_mut(RING * split.count * KEPT * 2 * LANES);
        let (sums, number) = memory.split_at_mut(2 * SUMS * 3 * split.half);
        // The room beside the rows must be zero; the rest is written before it is read.
        for rows in [&mut *weight, &mut *ring, &mut *sums] {
            rows.fill(0.0);
        }
        let ring = as_kept(ring);
        Self {
            level,
            views,
            radius,
            centred,
            stride,
            split,
            near: [sum, difference, weight],
            flow,
            whole: [false; NEAR],
            ring,
            counts: [Counts::Nothing; RING],
            sums,
            summed: None,
            number: &mut number[..4 * split.half],
            numbered: None,
            upcoming: 0,
        }
    }

    /// Make ready for row `y`.
    pub(super) fn start(&mut self, y: usize) {
        self.summed = None;
        self.upcoming = (y - y % 2) as isize - self.radius as isize;
        self.warp(self.upcoming - 1);
        self.warp(self.upcoming);
    }

    /// The sums of row `y`; rows must follow each other from the one given to `start`.
    pub(super) fn row(&mut self, y: usize) -> Sums<'_> {
        self.either_row::<true>(y)
    }

    /// The same for every second row, the even ones.
    pub(super) fn upper_row(&mut self, y: usize) -> Sums<'_> {
        self.either_row::<false>(y)
    }

    fn either_row<const BOTH: bool>(&mut self, y: usize) -> Sums<'_> {
        let upper = y - y % 2;
        if self.summed != Some(upper) {
            while self.upcoming <= (upper + 1 + self.radius) as isize {
                self.warp(self.upcoming + 1);
                self.differences(self.upcoming);
                self.upcoming += 1;
            }
            match self.radius {
                1 => self.sum::<3, BOTH>(upper),
                2 => self.sum::<5, BOTH>(upper),
                _ => self.sum::<7, BOTH>(upper),
            }
            self.summed = Some(upper);
        }
        match self.radius {
            1 => self.count::<3>(y),
            2 => self.count::<5>(y),
            _ => self.count::<7>(y),
        }
        let (number, inverse) = self.number.split_at(2 * self.split.half);
        Sums {
            split: self.split,
            centre: if self.centred { 1.0 } else { 0.0 },
            number,
            inverse,
            sums: &self.sums[(y % 2) * SUMS * 3 * self.split.half..][..SUMS * 3 * self.split.half],
        }
    }

    /// Row `y` of `prev` and of warped `next`, if there is one.
    fn warp(&mut self, y: isize) {
        let (width, height) = (self.views.prev.width(), self.views.prev.height());
        if y < 0 || y >= height as isize {
            return;
        }
        let y = y as usize;
        let slot = (y % NEAR) * self.stride..(y % NEAR + 1) * self.stride;
        let [sum, difference, inside] = &mut self.near;
        let (sum, difference, inside) = (
            &mut sum[slot.clone()],
            &mut difference[slot.clone()],
            &mut inside[slot],
        );
        let full = &mut self.whole[y % NEAR];
        let [u, v] = self.views.flow(y, self.flow);
        let kernel = WarpRow {
            prev: self.views.prev.row(y),
            next: self.views.next,
            y,
            u,
            v,
            sum: &mut *sum,
            difference,
            inside: &mut *inside,
            full: &mut *full,
        };
        dispatch_lanes(self.level, kernel);
        grid::extend(sum, width);
        inside[PAD + width..].fill(0.0);
        if let Some(weight) = self.views.weight {
            *full = false;
            for (inside, weight) in inside[PAD..].iter_mut().zip(weight.row(y)) {
                *inside *= weight;
            }
        }
    }

    /// Make row `y` of the ring; rows outside of the picture weigh nothing.
    fn differences(&mut self, y: isize) {
        let height = self.views.prev.height();
        let (stride, count) = (self.stride, self.split.count);
        let slot = y.rem_euclid(RING as isize) as usize;
        let kept = &mut self.ring[slot * count..(slot + 1) * count];
        if y < 0 || y >= height as isize {
            kept.as_flattened_mut()
                .as_flattened_mut()
                .as_flattened_mut()
                .fill(0.0);
            self.counts[slot] = Counts::Nothing;
            return;
        }
        let y = y as usize;
        self.counts[slot] = if self.whole[y % NEAR] {
            Counts::All
        } else {
            Counts::Some
        };
        let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)];
        let [sum, difference, weight] = &self.near;
        let near = |y: usize| (y % NEAR) * stride..(y % NEAR + 1) * stride;
        dispatch_lanes(
            self.level,
            Differences {
                sum: rows.map(|y| &sum[near(y)]),
                difference: &difference[near(y)],
                weight: &weight[near(y)],
                kept,
            },
        );
    }

    /// The rows of the windows of row `y`, the uppermost first.
    fn window<const N: usize>(y: usize) -> [usize; N] {
        std::array::from_fn(|k| (y + RING + k - N / 2) % RING)
    }

    fn sum<const N: usize, const BOTH: bool>(&mut self, upper: usize) {
        let (ring, count) = (&*self.ring, self.split.count);
        let of_slot = |slot: usize| &ring[slot * count..][..count];
        let (above, below) = (Self::window::<N>(upper), Self::window::<N>(upper + 1));
        let plain = above
            .iter()
            .chain(&below)
            .all(|slot| self.counts[*slot] != Counts::Some);
        let (first, second) = self.sums.split_at_mut(SUMS * 3 * self.split.half);
        dispatch_lanes(
            self.level,
            SumDown::<N, BOTH> {
                split: self.split,
                counted: !plain,
                above: of_slot(above[0]),
                shared: std::array::from_fn(|k| of_slot(above[(k + 1).min(N - 1)])),
                below: of_slot(below[N - 1]),
                sums: [first, second],
            },
        );
    }

    /// The number of pixels in each window of row `y`.
    fn count<const N: usize>(&mut self, y: usize) {
        let half = self.split.half;
        let slots = Self::window::<N>(y);
        let of = |counts| {
            slots
                .iter()
                .filter(|slot| self.counts[**slot] == counts)
                .count()
        };
        let (number, inverse) = self.number.split_at_mut(2 * half);
        let (even, odd) = number.split_at_mut(half);
        // Both rows of a pair have their weights summed if one of them needs it.
        if of(Counts::Some) > 0 {
            self.numbered = None;
            let sums = &self.sums[(y % 2) * SUMS * 3 * half..][..SUMS * 3 * half];
            let kernel = Count::<N> {
                split: self.split,
                sums,
                number: [&mut *even, &mut *odd],
            };
            dispatch_lanes(self.level, kernel);
        } else {
            let rows = of(Counts::All);
            if self.numbered == Some(rows) {
                return;
            }
            self.numbered = Some(rows);
            let width = self.views.prev.width();
            for x in 0..2 * self.split.count * LANES {
                let columns = (x + N / 2 + 1)
                    .min(width)
                    .saturating_sub(x.saturating_sub(N / 2));
                let to = if x % 2 == 0 { &mut *even } else { &mut *odd };
                to[PAD + x / 2] = (rows * columns) as f32;
            }
        }
        let (even_inverse, odd_inverse) = inverse.split_at_mut(half);
        for (number, inverse) in [(&*even, even_inverse), (&*odd, odd_inverse)] {
            let (number, inverse) = (&number[PAD..half - PAD], &mut inverse[PAD..half - PAD]);
            for (number, inverse) in number.iter().zip(inverse) {
                *inverse = 1.0 / number.max(1.0);
            }
        }
    }
}

/// Room for rows of the ring.
fn as_kept(memory: &mut [f32]) -> &mut [Kept] {
    let (lanes, _) = memory.as_chunks_mut::<LANES>();
    let (pixels, _) = lanes.as_chunks_mut::<KEPT>();
    pixels.as_chunks_mut::<2>().0
}

/// A group of pixels of a row of the ring, the even ones and the odd ones: weight, gradient along x and y, difference.
type Kept = [[[f32; LANES]; KEPT]; 2];

/// Gradients and difference of a row of pixels.
struct Differences<'a> {
    /// `prev` plus `next` in the rows above, at and below.
    sum: [&'a [f32]; 3],
    /// `next` minus `prev`.
    difference: &'a [f32],
    weight: &'a [f32],
    kept: &'a mut [Kept],
}

/// Pairs of groups of lanes of a padded row, from pixel `offset - 1` on.
#[inline(always)]
fn pairs(row: &[f32], offset: usize, count: usize) -> &[[[f32; LANES]; 2]] {
    &blocks(row, PAD + offset - 1, 2 * count).as_chunks::<2>().0[..count]
}

impl LaneKernel for Differences<'_> {
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
struct SumDown<'a, const N: usize, const BOTH: bool> {
    split: Split,
    /// Whether the weights are summed too.
    counted: bool,
    /// The row that only the windows of the upper row of pixels reach.
    above: &'a [Kept],
    /// The `N - 1` rows that both reach; the last one stands twice.
    shared: [&'a [Kept]; N],
    /// The row that only the windows of the lower row of pixels reach.
    below: &'a [Kept],
    sums: [&'a mut [f32]; 2],
}

impl<const N: usize, const BOTH: bool> LaneKernel for SumDown<'_, N, BOTH> {
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

/// A row of sums, with those down the columns.
pub(super) struct Sums<'a> {
    pub(super) split: Split,
    centre: f32,
    /// Split rows.
    number: &'a [f32],
    inverse: &'a [f32],
    sums: &'a [f32],
}

/// What one quantity's sums across are made of: groups of lanes that begin a little to the left or right.
type Parts<'a> = [&'a [[f32; LANES]]; 5];

/// The parts of the `q`-th quantity.
#[inline(always)]
fn parts<const N: usize>(sums: &[f32], Split { half, count }: Split, q: usize) -> Parts<'_> {
    let at = |part: usize, offset: isize| {
        blocks(
            sums,
            ((3 * q + part) * half + PAD).wrapping_add_signed(offset),
            count,
        )
    };
    let (even, odd, pair) = (0, 1, 2);
    match N {
        7 => [
            at(pair, -1),
            at(pair, 0),
            at(pair, 1),
            at(odd, -2),
            at(even, 2),
        ],
        5 => [
            at(odd, -1),
            at(pair, 0),
            at(even, 1),
            at(even, -1),
            at(odd, 1),
        ],
        _ => [
            at(pair, 0),
            at(pair, 0),
            at(pair, 0),
            at(odd, -1),
            at(even, 1),
        ],
    }
}

/// The sums over the windows of sixteen even pixels and of the sixteen odd ones right of them.
#[inline(always)]
fn across<S: Simd, const N: usize>(s: S, parts: &Parts<'_>, i: usize) -> [S::F; 2] {
    let [a, b, c, left, right] = parts;
    let shared = if N == 3 {
        s.get(&b[i])
    } else {
        (s.get(&a[i]) + s.get(&b[i])) + s.get(&c[i])
    };
    [shared + s.get(&left[i]), shared + s.get(&right[i])]
}

struct Count<'a, const N: usize> {
    split: Split,
    sums: &'a [f32],
    number: [&'a mut [f32]; 2],
}

impl<const N: usize> LaneKernel for Count<'_, N> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.split.count;
        let parts = parts::<N>(self.sums, self.split, SUMS - 1);
        let [even, odd] = self.number.map(|row| blocks_mut(row, PAD, count));
        for i in 0..count {
            let [e, o] = across::<S, N>(s, &parts, i);
            e.put(&mut even[i]);
            o.put(&mut odd[i]);
        }
    }
}

/// Means over windows: pixels that count, then gx gx, gx gy, gy gy, gx d, gy d, d d, without the product of the means
/// where windows are centred.
pub(super) type Moments<F> = [F; 7];

/// A row of windows, to read in groups of lanes.
pub(super) struct Reader<'a, S: Simd, const N: usize> {
    s: S,
    centre: S::F,
    parts: [Parts<'a>; SUMS - 1],
    number: [&'a [[f32; LANES]]; 2],
    inverse: [&'a [[f32; LANES]]; 2],
}

impl<'a, S: Simd, const N: usize> Reader<'a, S, N> {
    #[inline(always)]
    pub(super) fn new(s: S, row: &Sums<'a>) -> Self {
        let split = row.split;
        let halves = |row: &'a [f32]| {
            [
                blocks(row, PAD, split.count),
                blocks(row, split.half + PAD, split.count),
            ]
        };
        Self {
            s,
            centre: s.splat(row.centre),
            parts: [
                parts::<N>(row.sums, split, 0),
                parts::<N>(row.sums, split, 1),
                parts::<N>(row.sums, split, 2),
                parts::<N>(row.sums, split, 3),
                parts::<N>(row.sums, split, 4),
                parts::<N>(row.sums, split, 5),
                parts::<N>(row.sums, split, 6),
                parts::<N>(row.sums, split, 7),
                parts::<N>(row.sums, split, 8),
            ],
            number: halves(row.number),
            inverse: halves(row.inverse),
        }
    }

    /// The moments of sixteen even pixels and of the sixteen odd ones right of them.
    #[inline(always)]
    pub(super) fn moments(&self, i: usize) -> [Moments<S::F>; 2] {
        let s = self.s;
        let p = &self.parts;
        let gx = across::<S, N>(s, &p[0], i);
        let gy = across::<S, N>(s, &p[1], i);
        let d = across::<S, N>(s, &p[2], i);
        let xx = across::<S, N>(s, &p[3], i);
        let xy = across::<S, N>(s, &p[4], i);
        let yy = across::<S, N>(s, &p[5], i);
        let xd = across::<S, N>(s, &p[6], i);
        let yd = across::<S, N>(s, &p[7], i);
        let dd = across::<S, N>(s, &p[8], i);
        let mut both = [[self.centre; 7]; 2];
        for half in 0..2 {
            let per = s.get(&self.inverse[half][i]);
            let scaled = per * self.centre;
            let (mx, my, md) = (gx[half] * scaled, gy[half] * scaled, d[half] * scaled);
            both[half] = [
                s.get(&self.number[half][i]),
                (xx[half] - gx[half] * mx) * per,
                (xy[half] - gx[half] * my) * per,
                (yy[half] - gy[half] * my) * per,
                (xd[half] - d[half] * mx) * per,
                (yd[half] - d[half] * my) * per,
                (dd[half] - d[half] * md) * per,
            ];
        }
        both
    }
}
