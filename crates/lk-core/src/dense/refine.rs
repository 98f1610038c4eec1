//! Variational refinement: the flow of a level that fits the windows of all pixels and is smooth but for edges.
//!
//! The energy is the sum over pixels of psi(q / (trace + `ground`)) + alpha w psi(|grad u|^2 + |grad v|^2): q is the
//! mean squared difference within the window as the structure tensor predicts it for a change of the flow (combined
//! local and global, Bruhn, Weickert and Schnoerr 2005), centred, so that an offset of the light changes nothing;
//! divided by the trace it is about the square of a distance in pixels (Zimmer, Bruhn and Weickert 2011); w is small at
//! edges of the picture; psi(s^2) = sqrt(s^2 + epsilon^2). Each round fixes the weights that psi gives, then relaxes the
//! linear system red and black in turn (successive over-relaxation). A half-sweep reads rows that it does not write, so
//! that threads cannot change a bit.

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::{RowsMut, for_each_band};
use crate::simd::{Floats, LANES, LaneKernel, Simd, dispatch_lanes};

use super::grid::{self, Grid, PAD};
use super::step::{Band, Results, StepInput, StepOptions};
use crate::scratch::with_scratch;

/// How a level is refined.
///
/// The weights are those of the energy in the module's words: data against smoothness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineRecipe {
    /// Times the weights are renewed; 0: no refinement.
    pub rounds: usize,
    /// Sweeps over all pixels in each round.
    pub sweeps: usize,
    /// Half the window of the data term, 1 to 3.
    pub radius: usize,
    /// Weight of smoothness against data.
    pub alpha: f32,
    /// Added to the trace of the structure tensor, in squared grey levels of 0..255.
    pub ground: f32,
    /// Below this distance in pixels the data term is quadratic.
    pub data_epsilon: f32,
    /// Below this difference of the flow of neighbours smoothness is quadratic, in pixels.
    pub smooth_epsilon: f32,
    /// Gradient of the picture, in grey levels of 0..255 per pixel, at which smoothness counts half.
    pub edge: f32,
    /// Over-relaxation, 1 to 2.
    pub relaxation: f32,
}

/// Planes of the linear system, kept from call to call.
#[derive(Debug, Default)]
pub(super) struct System {
    /// Means over the window: gx gx, gx gy, gy gy, gx d, gy d, d d.
    tensor: [Grid; 6],
    /// The flow at which they were taken.
    start: [Grid; 2],
    /// Half the weight of smoothness at each pixel; two neighbours are joined by the sum of theirs.
    smooth: Grid,
    /// Inverse of each pixel's matrix (xx, xy, yy), then its right side.
    equations: [Grid; 5],
}

impl System {
    /// Refine `flow`; `spare` is overwritten.
    pub(super) fn refine(
        &mut self,
        (prev, next, weight): (&Plane, &Plane, Option<&Plane>),
        recipe: &RefineRecipe,
        centred: bool,
        (flow, spare): (&mut [Grid; 2], &mut [Grid; 2]),
        execution: &Execution,
    ) -> Result<()> {
        let [u, v] = &*flow;
        self.measure(
            StepInput {
                prev,
                next,
                u,
                v,
                weight,
            },
            recipe,
            centred,
            execution,
        )?;
        for (start, now) in self.start.iter_mut().zip(&*flow) {
            start.copy_from(now);
        }
        for _ in 0..recipe.rounds {
            execution.check()?;
            self.weigh(recipe, flow, execution)?;
            self.assemble(recipe, flow, execution)?;
            self.relax(recipe, flow, spare, execution)?;
            std::mem::swap(flow, spare);
        }
        Ok(())
    }

    fn measure(
        &mut self,
        input: StepInput<'_>,
        recipe: &RefineRecipe,
        centred: bool,
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = (input.prev.width(), input.prev.height());
        let options = StepOptions {
            radius: recipe.radius,
            centred,
            damping: 0.0,
            longest: 0.0,
        };
        let level = execution.simd_level();
        let [a, b, c, d, e, f] = resized(&mut self.tensor, width, height);
        let outputs = ((a, b, c), (d, e, f));
        for_each_band(
            execution,
            height,
            (16_384 / width).max(8),
            outputs,
            |rows, (mut first, mut second)| {
                with_scratch(Band::size(width, recipe.radius), |memory| {
                    let mut band = Band::new(level, input, &options, memory);
                    band.start(rows.start);
                    for (local, y) in rows.enumerate() {
                        let ((a, b, c), (d, e, f)) = (&mut first, &mut second);
                        let to = [
                            a.row_mut(local),
                            b.row_mut(local),
                            c.row_mut(local),
                            d.row_mut(local),
                            e.row_mut(local),
                            f.row_mut(local),
                        ];
                        band.row(y, Results::Tensor(to));
                    }
                });
            },
        )
    }

    fn weigh(
        &mut self,
        recipe: &RefineRecipe,
        [u, v]: &[Grid; 2],
        execution: &Execution,
    ) -> Result<()> {
        let Self { tensor, smooth, .. } = self;
        let (width, height) = (u.width(), u.height());
        smooth.resize(width, height);
        let level = execution.simd_level();
        for_each_band(
            execution,
            height,
            (32_768 / width).max(1),
            smooth.rows_mut(),
            |rows, mut part| {
                for (local, y) in rows.enumerate() {
                    let to = part.row_mut(local);
                    let kernel = Smoothness {
                        width,
                        u: u.near(y),
                        v: v.near(y),
                        trace: [tensor[0].padded(y), tensor[2].padded(y)],
                        recipe,
                        to: &mut *to,
                    };
                    dispatch_lanes(level, kernel);
                    grid::extend(to, width);
                }
            },
        )
    }

    fn assemble(
        &mut self,
        recipe: &RefineRecipe,
        flow: &[Grid; 2],
        execution: &Execution,
    ) -> Result<()> {
        let Self {
            tensor,
            start,
            smooth,
            equations,
        } = self;
        let (width, height) = (smooth.width(), smooth.height());
        let level = execution.simd_level();
        let [a, b, c, d, e] = resized(equations, width, height);
        for_each_band(
            execution,
            height,
            (16_384 / width).max(1),
            (a, b, c, d, e),
            |rows, (mut a, mut b, mut c, mut d, mut e)| {
                for (local, y) in rows.enumerate() {
                    let kernel = Equations {
                        width,
                        smooth: smooth.near(y),
                        tensor: tensor.each_ref().map(|grid| grid.padded(y)),
                        start: start.each_ref().map(|grid| grid.padded(y)),
                        flow: flow.each_ref().map(|grid| grid.padded(y)),
                        recipe,
                        to: [
                            a.row_mut(local),
                            b.row_mut(local),
                            c.row_mut(local),
                            d.row_mut(local),
                            e.row_mut(local),
                        ],
                    };
                    dispatch_lanes(level, kernel);
                }
            },
        )
    }

    /// All sweeps of a round in one pass over the rows: half-sweep `k` runs one row behind half-sweep `k - 1`, so that
    /// everything between them stays in the cache. A band begins and ends its first half-sweeps beyond its own rows.
    fn relax(
        &self,
        recipe: &RefineRecipe,
        flow: &[Grid; 2],
        to: &mut [Grid; 2],
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = (self.smooth.width(), self.smooth.height());
        let (stride, halves) = (grid::stride(width), 2 * recipe.sweeps);
        if halves == 0 {
            to.iter_mut()
                .zip(flow)
                .for_each(|(to, from)| to.copy_from(from));
            return Ok(());
        }
        let [to_u, to_v] = resized(to, width, height);
        let min_rows = (65_536 / (width * halves)).max(4 * halves);
        for_each_band(
            execution,
            height,
            min_rows,
            (to_u, to_v),
            |rows, (mut to_u, mut to_v)| {
                with_scratch((halves - 1) * PASSED * 2 * stride, |memory| {
                    let mut passed: [&mut [f32]; 2] = {
                        let (u, v) = memory.split_at_mut((halves - 1) * PASSED * stride);
                        [u, v]
                    };
                    let (start, end) = (rows.start, rows.end);
                    for lead in (start + 1).saturating_sub(halves)..end + halves - 1 {
                        for half in 0..halves.min(lead + 1) {
                            let (y, margin) = (lead - half, halves - 1 - half);
                            if y + margin < start || y >= (end + margin).min(height) {
                                continue;
                            }
                            if margin == 0 {
                                let to = [to_u.row_mut(y - start), to_v.row_mut(y - start)];
                                self.half_sweep(
                                    half,
                                    y,
                                    recipe,
                                    flow,
                                    [passed[0], passed[1]],
                                    to,
                                    execution,
                                );
                            } else {
                                let at = half * PASSED * stride;
                                let [u, v] = &mut passed;
                                let ((before_u, now_u), (before_v, now_v)) =
                                    (u.split_at_mut(at), v.split_at_mut(at));
                                let slot = (y % PASSED) * stride..(y % PASSED + 1) * stride;
                                let to = [&mut now_u[slot.clone()], &mut now_v[slot]];
                                self.half_sweep(
                                    half,
                                    y,
                                    recipe,
                                    flow,
                                    [before_u, before_v],
                                    to,
                                    execution,
                                );
                            }
                        }
                    }
                });
            },
        )
    }

    /// One row of one half-sweep. `passed` holds rows of the half-sweeps before it.
    #[allow(clippy::too_many_arguments, reason = "an inner step of relax")]
    fn half_sweep(
        &self,
        half: usize,
        y: usize,
        recipe: &RefineRecipe,
        flow: &[Grid; 2],
        passed: [&[f32]; 2],
        [to_u, to_v]: [&mut [f32]; 2],
        execution: &Execution,
    ) {
        let (width, height) = (self.smooth.width(), self.smooth.height());
        let stride = grid::stride(width);
        let near = |axis: usize| {
            [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|row| match half.checked_sub(1) {
                None => flow[axis].padded(row),
                Some(before) => {
                    &passed[axis][(before * PASSED + row % PASSED) * stride..][..stride]
                }
            })
        };
        let kernel = HalfSweep {
            width,
            first: (y + half) % 2,
            smooth: self.smooth.near(y),
            u: near(0),
            v: near(1),
            equations: self.equations.each_ref().map(|grid| grid.padded(y)),
            relaxation: recipe.relaxation,
            to: [&mut *to_u, &mut *to_v],
        };
        dispatch_lanes(execution.simd_level(), kernel);
        grid::extend(to_u, width);
        grid::extend(to_v, width);
    }
}

/// Rows that one half-sweep keeps for the next.
const PASSED: usize = 3;

fn resized<const N: usize>(
    grids: &mut [Grid; N],
    width: usize,
    height: usize,
) -> [RowsMut<'_, f32>; N] {
    grids.each_mut().map(|grid| {
        grid.resize(width, height);
        grid.rows_mut()
    })
}

/// Half the weight of smoothness at each pixel of a row.
struct Smoothness<'a> {
    width: usize,
    u: [&'a [f32]; 3],
    v: [&'a [f32]; 3],
    trace: [&'a [f32]; 2],
    recipe: &'a RefineRecipe,
    to: &'a mut [f32],
}

impl LaneKernel for Smoothness<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let half = s.splat(0.5);
        let epsilon = s.splat(self.recipe.smooth_epsilon * self.recipe.smooth_epsilon);
        let edge = s.splat(self.recipe.edge * self.recipe.edge);
        let strength = s.splat(0.5 * self.recipe.alpha * self.recipe.edge * self.recipe.edge);
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let mut sum = epsilon;
            for flow in [self.u, self.v] {
                let across = (s.load(flow[1], at + 1) - s.load(flow[1], at - 1)) * half;
                let down = (s.load(flow[2], at) - s.load(flow[0], at)) * half;
                sum = sum + (across * across + down * down);
            }
            let trace = s.load(self.trace[0], at) + s.load(self.trace[1], at);
            (strength / ((edge + trace) * sum.sqrt())).store(self.to, at);
        }
    }
}

/// The weights that join a pixel to its neighbours: left, right, above, below.
#[inline(always)]
fn joints<S: Simd>(s: S, smooth: [&[f32]; 3], at: usize) -> [S::F; 4] {
    let here = s.load(smooth[1], at);
    [
        here + s.load(smooth[1], at - 1),
        here + s.load(smooth[1], at + 1),
        here + s.load(smooth[0], at),
        here + s.load(smooth[2], at),
    ]
}

/// Each pixel's inverse matrix and right side.
struct Equations<'a> {
    width: usize,
    smooth: [&'a [f32]; 3],
    tensor: [&'a [f32]; 6],
    start: [&'a [f32]; 2],
    flow: [&'a [f32]; 2],
    recipe: &'a RefineRecipe,
    to: [&'a mut [f32]; 5],
}

impl LaneKernel for Equations<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let [to_xx, to_xy, to_yy, to_u, to_v] = self.to;
        let epsilon = s.splat(self.recipe.data_epsilon * self.recipe.data_epsilon);
        let (zero, one, two) = (s.splat(0.0), s.splat(1.0), s.splat(2.0));
        let ground = s.splat(self.recipe.ground);
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let (xx, xy, yy) = (
                s.load(self.tensor[0], at),
                s.load(self.tensor[1], at),
                s.load(self.tensor[2], at),
            );
            let (xd, yd, dd) = (
                s.load(self.tensor[3], at),
                s.load(self.tensor[4], at),
                s.load(self.tensor[5], at),
            );
            let (u, v) = (s.load(self.start[0], at), s.load(self.start[1], at));
            let (du, dv) = (s.load(self.flow[0], at) - u, s.load(self.flow[1], at) - v);
            let quadratic = xx * du * du + yy * dv * dv + two * (xy * du * dv);
            let misfit = dd + two * (xd * du + yd * dv) + quadratic;
            let share = one / (xx + yy + ground);
            let data = share / (misfit.max(zero) * share + epsilon).sqrt();
            let [left, right, above, below] = joints(s, self.smooth, at);
            let joined = (left + right) + (above + below);
            let (a, b, c) = (xx * data + joined, xy * data, yy * data + joined);
            let scale = one / (a * c - b * b);
            (c * scale).store(to_xx, at);
            ((zero - b) * scale).store(to_xy, at);
            (a * scale).store(to_yy, at);
            ((xx * u + xy * v - xd) * data).store(to_u, at);
            ((xy * u + yy * v - yd) * data).store(to_v, at);
        }
    }
}

/// Relax every second pixel of a row.
struct HalfSweep<'a> {
    width: usize,
    /// 0 or 1: the first pixel to relax.
    first: usize,
    smooth: [&'a [f32]; 3],
    u: [&'a [f32]; 3],
    v: [&'a [f32]; 3],
    equations: [&'a [f32]; 5],
    relaxation: f32,
    to: [&'a mut [f32]; 2],
}

impl LaneKernel for HalfSweep<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        const TURNS: [f32; LANES + 1] = [
            1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0,
        ];
        let turn = s.splat(0.0).lt(s.load(&TURNS, self.first));
        let [to_u, to_v] = self.to;
        let [xx, xy, yy, bu, bv] = self.equations;
        let relaxation = s.splat(self.relaxation);
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let [left, right, above, below] = joints(s, self.smooth, at);
            let bu = s.load(bu, at)
                + (left * s.load(self.u[1], at - 1) + right * s.load(self.u[1], at + 1))
                + (above * s.load(self.u[0], at) + below * s.load(self.u[2], at));
            let bv = s.load(bv, at)
                + (left * s.load(self.v[1], at - 1) + right * s.load(self.v[1], at + 1))
                + (above * s.load(self.v[0], at) + below * s.load(self.v[2], at));
            let (xx, xy, yy) = (s.load(xx, at), s.load(xy, at), s.load(yy, at));
            let (u, v) = (s.load(self.u[1], at), s.load(self.v[1], at));
            let new_u = u + relaxation * ((xx * bu + xy * bv) - u);
            let new_v = v + relaxation * ((xy * bu + yy * bv) - v);
            S::F::select(turn, new_u, u).store(to_u, at);
            S::F::select(turn, new_v, v).store(to_v, at);
        }
    }
}
