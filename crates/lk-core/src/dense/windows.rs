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
use super::warp::WarpRow;

/// The planes of one level, with the flow between them.
#[derive(Clone, Copy)]
pub(super) struct Views<'a> {
    pub(super) prev: &'a Plane,
    pub(super) next: &'a Plane,
    pub(super) u: &'a Grid,
    pub(super) v: &'a Grid,
    /// 0 at pixels of `prev` that count for nothing, 1 elsewhere.
    pub(super) weight: Option<&'a Plane>,
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
    /// `NEAR` rows each of `prev`, of warped `next` and of the weight.
    near: [&'a mut [f32]; 3],
    /// Whether the weights of those rows are all 1.
    whole: [bool; NEAR],
    ring: &'a mut [f32],
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
        3 * NEAR * grid::stride(width) + RING * KEPT * 2 * half + 2 * SUMS * 3 * half + 4 * half
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
        let (prev, memory) = memory.split_at_mut(NEAR * stride);
        let (warped, memory) = memory.split_at_mut(NEAR * stride);
        let (weight, memory) = memory.split_at_mut(NEAR * stride);
        let (ring, memory) = memory.split_at_mut(RING * KEPT * 2 * split.half);
        let (sums, number) = memory.split_at_mut(2 * SUMS * 3 * split.half);
        // The room beside the rows must be zero; the rest is written before it is read.
        for rows in [&mut *weight, &mut *ring, &mut *sums] {
            rows.fill(0.0);
        }
        Self {
            level,
            views,
            radius,
            centred,
            stride,
            split,
            near: [prev, warped, weight],
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
        let upper = y - y % 2;
        if self.summed != Some(upper) {
            while self.upcoming <= (upper + 1 + self.radius) as isize {
                self.warp(self.upcoming + 1);
                self.differences(self.upcoming);
                self.upcoming += 1;
            }
            match self.radius {
                1 => self.sum::<3>(upper),
                2 => self.sum::<5>(upper),
                _ => self.sum::<7>(upper),
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
        let [prev, warped, inside] = &mut self.near;
        let (prev, warped, inside) = (
            &mut prev[slot.clone()],
            &mut warped[slot.clone()],
            &mut inside[slot],
        );
        prev[PAD..PAD + width].copy_from_slice(self.views.prev.row(y));
        let full = &mut self.whole[y % NEAR];
        let kernel = WarpRow {
            next: self.views.next,
            y,
            u: self.views.u.padded(y),
            v: self.views.v.padded(y),
            warped: &mut *warped,
            inside: &mut *inside,
            full: &mut *full,
        };
        dispatch_lanes(self.level, kernel);
        grid::extend(prev, width);
        grid::extend(warped, width);
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
        let (stride, row) = (self.stride, 2 * self.split.half);
        let slot = y.rem_euclid(RING as isize) as usize;
        let kept = &mut self.ring[slot * KEPT * row..(slot + 1) * KEPT * row];
        if y < 0 || y >= height as isize {
            kept.fill(0.0);
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
        let [prev, warped, weight] = &self.near;
        let near = |y: usize| (y % NEAR) * stride..(y % NEAR + 1) * stride;
        let (m, kept) = kept.split_at_mut(row);
        let (gx, kept) = kept.split_at_mut(row);
        let (gy, d) = kept.split_at_mut(row);
        dispatch_lanes(
            self.level,
            Differences {
                split: self.split,
                prev: rows.map(|y| &prev[near(y)]),
                next: rows.map(|y| &warped[near(y)]),
                weight: &weight[near(y)],
                kept: [m, gx, gy, d],
            },
        );
    }

    /// The rows of the windows of row `y`, the uppermost first.
    fn window<const N: usize>(y: usize) -> [usize; N] {
        std::array::from_fn(|k| (y + RING + k - N / 2) % RING)
    }

    fn sum<const N: usize>(&mut self, upper: usize) {
        let (ring, row) = (&*self.ring, 2 * self.split.half);
        let of_slot = |slot: usize| &ring[slot * KEPT * row..][..KEPT * row];
        let (above, below) = (Self::window::<N>(upper), Self::window::<N>(upper + 1));
        let plain = above
            .iter()
            .chain(&below)
            .all(|slot| self.counts[*slot] != Counts::Some);
        let (first, second) = self.sums.split_at_mut(SUMS * 3 * self.split.half);
        dispatch_lanes(
            self.level,
            SumDown::<N> {
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
            let sums = &self.sums[((y % 2) * SUMS + SUMS - 1) * 3 * half..][..3 * half];
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
                let columns = (x + N / 2 + 1).min(width).saturating_sub(x.saturating_sub(N / 2));
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

/// Gradients and difference of a row of pixels.
struct Differences<'a> {
    split: Split,
    prev: [&'a [f32]; 3],
    next: [&'a [f32]; 3],
    weight: &'a [f32],
    kept: [&'a mut [f32]; KEPT],
}

impl LaneKernel for Differences<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Split { half, count } = self.split;
        let (zero, quarter) = (s.splat(0.0), s.splat(0.25));
        let near = |row, offset: usize| blocks(row, PAD + offset - 1, 2 * count);
        let [pa, p, pb] = self.prev;
        let [na, n, nb] = self.next;
        let (pl, pr, nl, nr) = (near(p, 0), near(p, 2), near(n, 0), near(n, 2));
        let (pa, p, pb) = (near(pa, 1), near(p, 1), near(pb, 1));
        let (na, n, nb) = (near(na, 1), near(n, 1), near(nb, 1));
        let weight = near(self.weight, 1);
        let [m, gx, gy, d] = self.kept.map(|row| {
            let (even, odd) = row.split_at_mut(half);
            (blocks_mut(even, PAD, count), blocks_mut(odd, PAD, count))
        });
        for i in 0..count {
            let mut both = [[zero; KEPT]; 2];
            for k in 0..2 {
                let j = 2 * i + k;
                let weight = s.get(&weight[j]);
                let on = zero.lt(weight);
                let along_x = (s.get(&pr[j]) - s.get(&pl[j])) + (s.get(&nr[j]) - s.get(&nl[j]));
                let along_y = (s.get(&pb[j]) - s.get(&pa[j])) + (s.get(&nb[j]) - s.get(&na[j]));
                let difference = s.get(&n[j]) - s.get(&p[j]);
                both[k] = [
                    weight,
                    S::F::select(on, along_x * quarter, zero),
                    S::F::select(on, along_y * quarter, zero),
                    S::F::select(on, difference, zero),
                ];
            }
            let [first, second] = both;
            let (even, odd) = first[0].deinterleave(second[0]);
            even.put(&mut m.0[i]);
            odd.put(&mut m.1[i]);
            let (even, odd) = first[1].deinterleave(second[1]);
            even.put(&mut gx.0[i]);
            odd.put(&mut gx.1[i]);
            let (even, odd) = first[2].deinterleave(second[2]);
            even.put(&mut gy.0[i]);
            odd.put(&mut gy.1[i]);
            let (even, odd) = first[3].deinterleave(second[3]);
            even.put(&mut d.0[i]);
            odd.put(&mut d.1[i]);
        }
    }
}

/// Sums down the columns of the windows of two rows of pixels.
struct SumDown<'a, const N: usize> {
    split: Split,
    /// Whether the weights are summed too.
    counted: bool,
    /// The row that only the windows of the upper row of pixels reach.
    above: &'a [f32],
    /// The `N - 1` rows that both reach; the last one stands twice.
    shared: [&'a [f32]; N],
    /// The row that only the windows of the lower row of pixels reach.
    below: &'a [f32],
    sums: [&'a mut [f32]; 2],
}

impl<const N: usize> LaneKernel for SumDown<'_, N> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Split { half, count } = self.split;
        let [first, second] = self.sums;
        for odd in 0..2 {
            let from = odd * half + PAD;
            let of = |row| -> [&[[f32; LANES]]; 3] {
                [1, 2, 3].map(|kept| blocks(row, kept * 2 * half + from, count))
            };
            let (above, shared, below) = (of(self.above), self.shared.map(of), of(self.below));
            let mut first = quantities(first, half, count);
            let mut second = quantities(second, half, count);
            for i in 0..count {
                let mut both = products(s, &shared[0], i);
                for rows in &shared[1..N - 1] {
                    let more = products(s, rows, i);
                    for q in 0..SUMS - 1 {
                        both[q] = both[q] + more[q];
                    }
                }
                let (above, below) = (products(s, &above, i), products(s, &below, i));
                for q in 0..SUMS - 1 {
                    put(s, both[q] + above[q], &mut first[q], odd, i);
                    put(s, both[q] + below[q], &mut second[q], odd, i);
                }
            }
        }
        if !self.counted {
            return;
        }
        for odd in 0..2 {
            let of = |row| -> &[[f32; LANES]] { blocks(row, odd * half + PAD, count) };
            let (above, shared, below) = (of(self.above), self.shared.map(of), of(self.below));
            let first = &mut quantities(first, half, count)[SUMS - 1];
            let second = &mut quantities(second, half, count)[SUMS - 1];
            for i in 0..count {
                let mut both = s.get(&shared[0][i]);
                for row in &shared[1..N - 1] {
                    both = both + s.get(&row[i]);
                }
                put(s, both + s.get(&above[i]), first, odd, i);
                put(s, both + s.get(&below[i]), second, odd, i);
            }
        }
    }
}

/// Even pixels, odd ones, and pairs of both of one quantity.
type Quantity<'a> = [&'a mut [[f32; LANES]]; 3];

#[inline(always)]
fn quantities(row: &mut [f32], half: usize, count: usize) -> [Quantity<'_>; SUMS] {
    let mut rest = row;
    std::array::from_fn(|_| {
        std::array::from_fn(|_| {
            let (part, after) = std::mem::take(&mut rest).split_at_mut(half);
            rest = after;
            blocks_mut(part, PAD, count)
        })
    })
}

/// Write a sum; with that of an odd pixel, that of the pair.
#[inline(always)]
fn put<S: Simd>(s: S, sum: S::F, to: &mut Quantity<'_>, odd: usize, i: usize) {
    if odd == 0 {
        sum.put(&mut to[0][i]);
    } else {
        sum.put(&mut to[1][i]);
        (s.get(&to[0][i]) + sum).put(&mut to[2][i]);
    }
}

#[inline(always)]
fn products<S: Simd>(s: S, rows: &[&[[f32; LANES]]; 3], i: usize) -> [S::F; SUMS - 1] {
    let (gx, gy, d) = (s.get(&rows[0][i]), s.get(&rows[1][i]), s.get(&rows[2][i]));
    [
        gx,
        gy,
        d,
        gx * gx,
        gx * gy,
        gy * gy,
        gx * d,
        gy * d,
        d * d,
    ]
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

#[inline(always)]
fn parts<const N: usize>(sums: &[f32], Split { half, count }: Split) -> Parts<'_> {
    let at = |part: usize, offset: isize| {
        blocks(sums, (part * half + PAD).wrapping_add_signed(offset), count)
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
        let parts = parts::<N>(self.sums, self.split);
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
        let halves = |row: &'a [f32]| [0, split.half].map(|at| blocks(row, at + PAD, split.count));
        let (mut rest, row_sums) = (0, row.sums);
        Self {
            s,
            centre: s.splat(row.centre),
            parts: std::array::from_fn(|_| {
                let sums = &row_sums[rest..rest + 3 * split.half];
                rest += 3 * split.half;
                parts::<N>(sums, split)
            }),
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
