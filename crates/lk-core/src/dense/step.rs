//! One Lucas-Kanade step over all pixels: windows of least squares for the displacement and, with it, an offset of
//! the light.
//!
//! Rows stream: `next` is warped row by row, gradients and differences stay in a ring of rows, window sums run down
//! the ring and then across the row. Every window is summed afresh, so that the division into bands cannot change a
//! bit.

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::for_each_band;
use crate::simd::{Floats, LANES, LaneKernel, Level, Simd, dispatch_lanes};

use super::grid::{self, Grid, PAD};
use super::warp::WarpRow;
use crate::scratch::with_scratch;

/// What a step needs to know besides its planes.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepOptions {
    /// Half the window: 1 to 3 for 3 x 3 to 7 x 7.
    pub(super) radius: usize,
    /// Remove the mean of the window: an offset of the light then changes nothing.
    pub(super) centred: bool,
    /// Added to the diagonal of the structure tensor (means over the window), in squared grey levels per pixel.
    pub(super) damping: f32,
    /// The longest step along each axis, in pixels.
    pub(super) longest: f32,
}

/// The planes of one level that a step reads.
#[derive(Clone, Copy)]
pub(super) struct StepInput<'a> {
    pub(super) prev: &'a Plane,
    pub(super) next: &'a Plane,
    pub(super) u: &'a Grid,
    pub(super) v: &'a Grid,
    /// 0 at pixels of `prev` that count for nothing, 1 elsewhere.
    pub(super) weight: Option<&'a Plane>,
}

/// Write the flow after one step, and the mean squared difference of each window before it.
pub(super) fn step(
    input: StepInput<'_>,
    options: &StepOptions,
    (u, v, energy): (&mut Grid, &mut Grid, &mut Grid),
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (input.prev.width(), input.prev.height());
    for plane in [&mut *u, &mut *v, &mut *energy] {
        plane.resize(width, height);
    }
    let level = execution.simd_level();
    for_each_band(
        execution,
        height,
        (16_384 / width).max(8),
        (u.rows_mut(), v.rows_mut(), energy.rows_mut()),
        |rows, (mut u, mut v, mut energy)| {
            with_scratch(Band::size(width, options.radius), |memory| {
                let mut band = Band::new(level, input, options, memory);
                band.start(rows.start);
                for (local, y) in rows.enumerate() {
                    let (u, v, energy) =
                        (u.row_mut(local), v.row_mut(local), energy.row_mut(local));
                    band.row(y, Results::Step { u, v, energy });
                }
            });
        },
    )
}

/// Quantities of a pixel in the ring: weight, gradient along x and y, difference.
const KEPT: usize = 4;
/// Sums of a window: 1, gx, gy, d, gx gx, gx gy, gy gy, gx d, gy d, d d.
const SUMS: usize = 10;
/// Rows that the gradient along y needs.
const NEAR: usize = 3;

/// Rows of window sums, made one after the other.
pub(super) struct Band<'a> {
    level: Level,
    input: StepInput<'a>,
    options: StepOptions,
    stride: usize,
    /// `NEAR` rows each of `prev`, of warped `next` and of the weight.
    near: [&'a mut [f32]; 3],
    /// `2 radius + 1` rows of `KEPT` rows.
    ring: &'a mut [f32],
    /// `SUMS` rows.
    sums: &'a mut [f32],
    /// The next row of the ring to make.
    upcoming: isize,
}

impl<'a> Band<'a> {
    pub(super) fn size(width: usize, radius: usize) -> usize {
        (3 * NEAR + (2 * radius + 1) * KEPT + SUMS) * grid::stride(width)
    }

    pub(super) fn new(
        level: Level,
        input: StepInput<'a>,
        options: &StepOptions,
        memory: &'a mut [f32],
    ) -> Self {
        let stride = grid::stride(input.prev.width());
        let (prev, memory) = memory.split_at_mut(NEAR * stride);
        let (warped, memory) = memory.split_at_mut(NEAR * stride);
        let (weight, memory) = memory.split_at_mut(NEAR * stride);
        let (ring, sums) = memory.split_at_mut((2 * options.radius + 1) * KEPT * stride);
        // The room beside the rows must be zero; the rest is written before it is read.
        for rows in [&mut *weight, &mut *ring, &mut *sums] {
            rows.fill(0.0);
        }
        Self {
            level,
            input,
            options: *options,
            stride,
            near: [prev, warped, weight],
            ring,
            sums,
            upcoming: 0,
        }
    }

    /// Make ready for row `y`.
    pub(super) fn start(&mut self, y: usize) {
        self.upcoming = y as isize - self.options.radius as isize;
        self.warp(self.upcoming - 1);
        self.warp(self.upcoming);
    }

    /// Row `y` of `prev` and of warped `next`, if there is one.
    fn warp(&mut self, y: isize) {
        let (width, height) = (self.input.prev.width(), self.input.prev.height());
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
        prev[PAD..PAD + width].copy_from_slice(self.input.prev.row(y));
        let kernel = WarpRow {
            next: self.input.next,
            y,
            u: self.input.u.padded(y),
            v: self.input.v.padded(y),
            warped: &mut *warped,
            inside: &mut *inside,
        };
        dispatch_lanes(self.level, kernel);
        grid::extend(prev, width);
        grid::extend(warped, width);
        inside[PAD + width..].fill(0.0);
        if let Some(weight) = self.input.weight {
            for (inside, weight) in inside[PAD..].iter_mut().zip(weight.row(y)) {
                *inside *= weight;
            }
        }
    }

    /// Make row `y` of the ring; rows outside of the picture weigh nothing.
    fn differences(&mut self, y: isize) {
        let height = self.input.prev.height();
        let stride = self.stride;
        let slot = y.rem_euclid(2 * self.options.radius as isize + 1) as usize;
        let kept = &mut self.ring[slot * KEPT * stride..(slot + 1) * KEPT * stride];
        if y < 0 || y >= height as isize {
            kept.fill(0.0);
            return;
        }
        let y = y as usize;
        let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)];
        let [prev, warped, weight] = &self.near;
        let near = |plane: &'_ [f32], y: usize| {
            (y % NEAR) * stride..(y % NEAR) * stride + plane.len().min(stride)
        };
        let (m, kept) = kept.split_at_mut(stride);
        let (gx, kept) = kept.split_at_mut(stride);
        let (gy, d) = kept.split_at_mut(stride);
        dispatch_lanes(
            self.level,
            Differences {
                width: self.input.prev.width(),
                prev: rows.map(|y| &prev[near(prev, y)]),
                next: rows.map(|y| &warped[near(warped, y)]),
                weight: &weight[near(weight, y)],
                kept: [m, gx, gy, d],
            },
        );
    }

    /// One row of results; rows must follow each other from the one given to `start`.
    pub(super) fn row(&mut self, y: usize, to: Results<'_>) {
        let radius = self.options.radius as isize;
        while self.upcoming <= y as isize + radius {
            self.warp(self.upcoming + 1);
            self.differences(self.upcoming);
            self.upcoming += 1;
        }
        match self.options.radius {
            1 => self.window::<3>(y, to),
            2 => self.window::<5>(y, to),
            _ => self.window::<7>(y, to),
        }
    }

    fn window<const N: usize>(&mut self, y: usize, to: Results<'_>) {
        let width = self.input.prev.width();
        let ring = &*self.ring;
        let rows = std::array::from_fn(|k| {
            let slot = (y as isize - (N / 2) as isize + k as isize).rem_euclid(N as isize) as usize;
            &ring[slot * KEPT * self.stride..][..KEPT * self.stride]
        });
        dispatch_lanes(
            self.level,
            SumDown::<N> {
                width,
                stride: self.stride,
                rows,
                sums: &mut *self.sums,
            },
        );
        let (stride, sums, options) = (self.stride, &*self.sums, self.options);
        match to {
            Results::Step { u, v, energy } => {
                let from = [self.input.u.padded(y), self.input.v.padded(y)];
                let to = [&mut *u, &mut *v, &mut *energy];
                dispatch_lanes(
                    self.level,
                    Solve::<N> {
                        width,
                        stride,
                        sums,
                        options,
                        from,
                        to,
                    },
                );
                for row in [u, v, energy] {
                    grid::extend(row, width);
                }
            }
            Results::Tensor(to) => {
                dispatch_lanes(
                    self.level,
                    Tensor::<N> {
                        width,
                        stride,
                        sums,
                        options,
                        to,
                    },
                );
            }
            Results::Fit {
                count,
                texture,
                energy,
            } => {
                let to = [count, texture, energy];
                dispatch_lanes(
                    self.level,
                    Fit::<N> {
                        width,
                        stride,
                        sums,
                        options,
                        to,
                    },
                );
            }
        }
    }
}

/// What a row of windows is asked for; all rows are padded.
pub(super) enum Results<'a> {
    /// The flow after a step, and the mean squared difference before it.
    Step {
        u: &'a mut [f32],
        v: &'a mut [f32],
        energy: &'a mut [f32],
    },
    /// Means over the window: gx gx, gx gy, gy gy, gx d, gy d, d d.
    Tensor([&'a mut [f32]; 6]),
    /// How many pixels count, the smaller eigenvalue of the structure tensor, and the mean squared difference.
    Fit {
        count: &'a mut [f32],
        texture: &'a mut [f32],
        energy: &'a mut [f32],
    },
}

/// Gradients (the mean of those of both pictures) and differences of one row.
struct Differences<'a> {
    width: usize,
    prev: [&'a [f32]; 3],
    next: [&'a [f32]; 3],
    weight: &'a [f32],
    kept: [&'a mut [f32]; KEPT],
}

impl LaneKernel for Differences<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let [pa, p, pb] = self.prev;
        let [na, n, nb] = self.next;
        let [m, gx, gy, d] = self.kept;
        let (zero, quarter) = (s.splat(0.0), s.splat(0.25));
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let weight = s.load(self.weight, at);
            let on = zero.lt(weight);
            let along_x =
                (s.load(p, at + 1) - s.load(p, at - 1)) + (s.load(n, at + 1) - s.load(n, at - 1));
            let along_y = (s.load(pb, at) - s.load(pa, at)) + (s.load(nb, at) - s.load(na, at));
            let difference = s.load(n, at) - s.load(p, at);
            weight.store(m, at);
            S::F::select(on, along_x * quarter, zero).store(gx, at);
            S::F::select(on, along_y * quarter, zero).store(gy, at);
            S::F::select(on, difference, zero).store(d, at);
        }
    }
}

/// Sums of the products down the columns of the window.
struct SumDown<'a, const N: usize> {
    width: usize,
    stride: usize,
    rows: [&'a [f32]; N],
    sums: &'a mut [f32],
}

impl<const N: usize> LaneKernel for SumDown<'_, N> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let mut total = [s.splat(0.0); SUMS];
            for k in 0..N {
                let (row, stride) = (self.rows[k], self.stride);
                let (m, gx) = (s.load(row, at), s.load(row, stride + at));
                let (gy, d) = (s.load(row, 2 * stride + at), s.load(row, 3 * stride + at));
                let products = [
                    m,
                    gx,
                    gy,
                    d,
                    gx * gx,
                    gx * gy,
                    gy * gy,
                    gx * d,
                    gy * d,
                    d * d,
                ];
                for q in 0..SUMS {
                    total[q] = if k == 0 {
                        products[q]
                    } else {
                        total[q] + products[q]
                    };
                }
            }
            for (q, total) in total.into_iter().enumerate() {
                total.store(self.sums, q * self.stride + at);
            }
        }
    }
}

/// Sums across the window, the least squares of each pixel, and its step.
struct Solve<'a, const N: usize> {
    width: usize,
    stride: usize,
    sums: &'a [f32],
    options: StepOptions,
    from: [&'a [f32]; 2],
    to: [&'a mut [f32]; 3],
}

impl<const N: usize> LaneKernel for Solve<'_, N> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let [to_u, to_v, to_energy] = self.to;
        let StepOptions {
            centred,
            damping,
            longest,
            ..
        } = self.options;
        let centre = s.splat(if centred { 1.0 } else { 0.0 });
        let damping = s.splat(damping);
        let (most, least) = (s.splat(longest), s.splat(-longest));
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let [n, gx, gy, d, xx, xy, yy, xd, yd, dd] =
                across::<S, N>(s, self.sums, self.stride, at);
            let per = one / n.max(one);
            let scaled = per * centre;
            let (mx, my, md) = (gx * scaled, gy * scaled, d * scaled);
            let xx = (xx - gx * mx) * per + damping;
            let xy = (xy - gx * my) * per;
            let yy = (yy - gy * my) * per + damping;
            let xd = (xd - d * mx) * per;
            let yd = (yd - d * my) * per;
            let dd = (dd - d * md) * per;
            let scale = one / (xy * xy - xx * yy);
            let step_u = (yy * xd - xy * yd) * scale;
            let step_v = (xx * yd - xy * xd) * scale;
            (s.load(self.from[0], at) + step_u.max(least).min(most)).store(to_u, at);
            (s.load(self.from[1], at) + step_v.max(least).min(most)).store(to_v, at);
            S::F::select(zero.lt(n), dd, s.splat(f32::MAX)).store(to_energy, at);
        }
    }
}

/// The sums of the window around `at`.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "two arrays run along")]
fn across<S: Simd, const N: usize>(s: S, from: &[f32], stride: usize, at: usize) -> [S::F; SUMS] {
    // A closure for `array::from_fn` would not be compiled with the level's instructions.
    let mut sums = [s.splat(0.0); SUMS];
    for q in 0..SUMS {
        let first = q * stride + at - N / 2;
        let mut sum = s.load(from, first);
        for k in 1..N {
            sum = sum + s.load(from, first + k);
        }
        sums[q] = sum;
    }
    sums
}

/// Sums across the window, and how well the flow fits there.
struct Fit<'a, const N: usize> {
    width: usize,
    stride: usize,
    sums: &'a [f32],
    options: StepOptions,
    to: [&'a mut [f32]; 3],
}

impl<const N: usize> LaneKernel for Fit<'_, N> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let [count, texture, energy] = self.to;
        let centre = s.splat(if self.options.centred { 1.0 } else { 0.0 });
        let (zero, one, half) = (s.splat(0.0), s.splat(1.0), s.splat(0.5));
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let [n, gx, gy, d, xx, xy, yy, _, _, dd] =
                across::<S, N>(s, self.sums, self.stride, at);
            let per = one / n.max(one);
            let scaled = per * centre;
            let (mx, my, md) = (gx * scaled, gy * scaled, d * scaled);
            let xx = (xx - gx * mx) * per;
            let xy = (xy - gx * my) * per;
            let yy = (yy - gy * my) * per;
            let difference = (xx - yy) * half;
            let root = (difference * difference + xy * xy).sqrt();
            n.store(count, at);
            ((xx + yy) * half - root).max(zero).store(texture, at);
            ((dd - d * md) * per).max(zero).store(energy, at);
        }
    }
}

/// Sums across the window, as means.
struct Tensor<'a, const N: usize> {
    width: usize,
    stride: usize,
    sums: &'a [f32],
    options: StepOptions,
    to: [&'a mut [f32]; 6],
}

impl<const N: usize> LaneKernel for Tensor<'_, N> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let [to_xx, to_xy, to_yy, to_xd, to_yd, to_dd] = self.to;
        let centre = s.splat(if self.options.centred { 1.0 } else { 0.0 });
        let one = s.splat(1.0);
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let [n, gx, gy, d, xx, xy, yy, xd, yd, dd] =
                across::<S, N>(s, self.sums, self.stride, at);
            let per = one / n.max(one);
            let scaled = per * centre;
            let (mx, my, md) = (gx * scaled, gy * scaled, d * scaled);
            ((xx - gx * mx) * per).store(to_xx, at);
            ((xy - gx * my) * per).store(to_xy, at);
            ((yy - gy * my) * per).store(to_yy, at);
            ((xd - d * mx) * per).store(to_xd, at);
            ((yd - d * my) * per).store(to_yd, at);
            ((dd - d * md) * per).store(to_dd, at);
        }
    }
}
