//! Sums over the windows of all pixels, row by row: what a Lucas-Kanade step and a refinement share.
//!
//! Rows stream: `next` is warped row by row, gradients and differences stay in a ring of rows, and window sums run down
//! the ring for two rows at a time, which share all but one row of their windows, and then across. Rows of the ring and
//! of sums are split: even pixels first, then odd ones. Two neighbours then share all but one column as two rows do.
//! Every window is summed afresh, in an order that depends on the place of the pixel alone, so that the division into
//! bands cannot change a bit.
//!
//! `docs/explanation/algorithms.md`, section "Windows and sums".

use std::ops::Range;

use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::even_bands;
use crate::simd::{LANES, SimdLevel, dispatch};

use super::moments::{Count, Sums};
use super::padded_plane::{self, PAD, PaddedPlane};
use super::sum_down::{Differences, KEPT, Kept, SUMS, Split, SumDown, as_kept};
use super::tiles::Columns;
use super::upsample;
use super::warp::{Rephase, WarpRow};

/// The planes of one level, with the flow between them.
#[derive(Clone, Copy)]
pub(super) struct Views<'a> {
    pub(super) prev: &'a Plane,
    pub(super) next: &'a Plane,
    pub(super) u: &'a PaddedPlane,
    pub(super) v: &'a PaddedPlane,
    /// If `u` and `v` are of half the size: what their values are multiplied by.
    pub(super) halved: Option<f32>,
    /// 0 at pixels of `prev` that count for nothing, 1 elsewhere.
    pub(super) weight: Option<&'a Plane>,
}

impl<'a> Views<'a> {
    /// Columns of row `y` of u and of v, from an even one on, padded; made in `memory`, of two rows, where they are of half
    /// the size.
    pub(super) fn flow<'b>(
        &self,
        level: SimdLevel,
        y: usize,
        columns: Range<usize>,
        memory: &'b mut [f32],
    ) -> [&'b [f32]; 2]
    where
        'a: 'b,
    {
        let Some(scale) = self.halved else {
            return [self.u, self.v].map(|grid| &grid.padded(y)[columns.start..]);
        };
        let (u, v) = memory.split_at_mut(padded_plane::stride(columns.len()));
        upsample::row(level, self.u, y, columns.clone(), scale, u);
        upsample::row(level, self.v, y, columns, scale, v);
        [u, v]
    }
}

/// Rows that the gradient along y needs.
const NEAR: usize = 3;
/// Rows of the ring: those of the windows of two rows of pixels, 7 high, and a power of two.
const RING: usize = 8;
/// Rows of a band beside which those that it begins with hardly count, and of the shortest that is worth them.
const BAND: [usize; 2] = [64, 16];
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
/// How windows are made.
#[derive(Debug, Clone, Copy)]
pub(super) struct Made {
    /// Half their size, 1 to 3.
    pub(super) radius: usize,
    /// Remove the mean of each: an offset of the light then changes nothing.
    pub(super) centred: bool,
    /// Give samples the phase of cubic ones ([`Rephase`]).
    pub(super) rephased: bool,
}

/// Rows of window sums, made one after the other.
pub(super) struct Windows<'a> {
    level: SimdLevel,
    views: Views<'a>,
    columns: Columns,
    made: Made,
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
    /// Elements that are under way for each column, about.
    pub(super) const FLOATS: usize = RING * KEPT + 3 * NEAR + 2 + 2 * SUMS * 3 / 2 + 2;

    /// Elements of memory for any of the strips.
    pub(super) fn most(strips: impl Iterator<Item = Columns>) -> usize {
        strips
            .map(|columns| Self::size(columns.computed()))
            .max()
            .unwrap_or(0)
    }

    /// Elements of memory for as many columns.
    pub(super) fn size(width: usize) -> usize {
        let half = Split::of(width).half;
        RING * KEPT * 2 * half
            + (3 * NEAR + 2) * padded_plane::stride(width)
            + 2 * SUMS * 3 * half
            + 4 * half
    }

    /// The rows of pixels of bands: each begins with some rows beyond its own, so that shorter ones cost more than it gains
    /// to level them out.
    pub(super) fn rows_of_bands(execution: &Execution, height: usize) -> usize {
        even_bands(execution, height, BAND)
    }

    /// Windows of `2 radius + 1` pixels; with `centred`, their means do not count.
    pub(super) fn new(
        level: SimdLevel,
        views: Views<'a>,
        columns: Columns,
        made: Made,
        memory: &'a mut [f32],
    ) -> Self {
        let width = columns.computed();
        let (stride, split) = (padded_plane::stride(width), Split::of(width));
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
            columns,
            made,
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
        self.upcoming = (y - y % 2) as isize - self.made.radius as isize;
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
            while self.upcoming <= (upper + 1 + self.made.radius) as isize {
                self.warp(self.upcoming + 1);
                self.differences(self.upcoming);
                self.upcoming += 1;
            }
            by_radius!(self.made.radius, SIZE => self.sum::<SIZE, BOTH>(upper));
            self.summed = Some(upper);
        }
        by_radius!(self.made.radius, SIZE => self.count::<SIZE>(y));
        let (number, inverse) = self.number.split_at(2 * self.split.half);
        Sums {
            split: self.split,
            skipped: 0,
            count: self.split.count,
            centre: if self.made.centred { 1.0 } else { 0.0 },
            number,
            inverse,
            sums: &self.sums[(y % 2) * SUMS * 3 * self.split.half..][..SUMS * 3 * self.split.half],
        }
    }

    /// Row `y` of `prev` and of warped `next`, if there is one.
    fn warp(&mut self, y: isize) {
        let (width, height) = (self.columns.computed(), self.views.prev.height());
        let columns = self.columns.from..self.columns.to;
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
        let [u, v] = self.views.flow(self.level, y, columns.clone(), self.flow);
        let kernel = WarpRow {
            from: columns.start,
            prev: &self.views.prev.row(y)[columns.clone()],
            next: self.views.next,
            y,
            u,
            v,
            sum: &mut *sum,
            difference: &mut *difference,
            inside: &mut *inside,
            full: &mut *full,
        };
        dispatch(self.level, kernel);
        if self.made.rephased {
            let beside = y >= 2 && y + 2 < height;
            let kernel = Rephase {
                rows: [0, 1, 2, 3, 4].map(|k| {
                    let row = if beside { y + k - 2 } else { y };
                    self.views.prev.row(row)
                }),
                from: columns.start,
                flow: [u, v].map(|row| &row[PAD..PAD + width]),
                sum: &mut sum[PAD..PAD + width],
                difference: &mut difference[PAD..PAD + width],
            };
            dispatch(self.level, kernel);
        }
        padded_plane::extend(sum, width);
        inside[PAD + width..].fill(0.0);
        if let Some(weight) = self.views.weight {
            *full = false;
            for (inside, weight) in inside[PAD..].iter_mut().zip(&weight.row(y)[columns]) {
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
        dispatch(
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
        dispatch(
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
            let kernel = Count::<N> {
                sums: Sums {
                    split: self.split,
                    skipped: 0,
                    count: self.split.count,
                    centre: 0.0,
                    number: &[],
                    inverse: &[],
                    sums: &self.sums[(y % 2) * SUMS * 3 * half..][..SUMS * 3 * half],
                },
                number: [&mut *even, &mut *odd],
            };
            dispatch(self.level, kernel);
        } else {
            let rows = of(Counts::All);
            if self.numbered == Some(rows) {
                return;
            }
            self.numbered = Some(rows);
            let width = self.columns.computed();
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
