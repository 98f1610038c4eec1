//! Variational refinement: the flow of a level that fits the windows of all pixels and is smooth but for edges.
//!
//! The energy is the sum over pixels of phi(q / (trace + floor)) + alpha w psi(|grad u|^2 + |grad v|^2): q is the
//! mean squared difference within the window as the structure tensor predicts it for a change of the flow (combined
//! local and global, Bruhn, Weickert and Schnoerr 2005), centred, so that an offset of the light changes nothing;
//! divided by the trace it is about the square of a distance in pixels (Zimmer, Bruhn and Weickert 2011); w is small at
//! edges of the picture; phi(s^2) = log(s^2 + epsilon^2) / 2, so that noise counts by its inverse variance, and
//! psi(s^2) = sqrt(s^2 + epsilon^2). The gradients of u and v are taken relative to the slopes of
//! most of the flow ([`trend`](super::trend)), so that a turn or a zoom is smooth. A round warps `next` anew, fixes the
//! weights that psi gives, and relaxes the linear system ([`relax`](super::relax)), all in one pass over the rows: nothing
//! but the flow itself is as large as the picture. [`half_round`](super::half_round) does the same for one pixel in 2 x 2.
//!
//! `docs/explanation/algorithms.md`, section "Refinement".
#![allow(clippy::needless_range_loop, reason = "several arrays run along")]

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{EvenRows, RowsMut, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Floats, Kernel, LANES, Simd, SimdLevel, blocks, blocks_mut, dispatch};

use super::padded_plane::{self, PAD, PaddedPlane};
use super::relax::Rows;
use super::tiles::Columns;
use super::trend::Slopes;

use super::confidence::{Judge, Judged};
use super::moments::{Moments, Reader, Sums};
use super::windows::{Made, Views, Windows};

/// How a level is refined.
///
/// The weights are those of the energy in the module's words: data against smoothness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RefineRecipe {
    /// Half the window of the data term, 1 to 3.
    pub(crate) radius: usize,
    /// Weight of smoothness against data.
    pub(crate) alpha: f32,
    /// Added to the trace of the structure tensor, in squared grey levels of 0..255.
    pub(crate) trace_floor: f32,
    /// Below this distance in pixels the data term is quadratic: its weight does not grow any more.
    pub(crate) data_epsilon: f32,
    /// Below this difference of the flow of neighbours smoothness is quadratic, in pixels.
    pub(crate) smooth_epsilon: f32,
    /// Gradient of the picture, in grey levels of 0..255 per pixel, at which smoothness counts half.
    pub(crate) edge_scale: f32,
    /// Over-relaxation, 1 to 2: with little of it hundreds of sweeps would be needed where there is no texture.
    pub(crate) relaxation: f32,
}

/// What a round needs to know besides its planes.
#[derive(Debug, Clone, Copy)]
pub(super) struct RoundOptions {
    pub(super) recipe: RefineRecipe,
    /// Sweeps over all pixels.
    pub(super) sweeps: usize,
    /// Remove the mean of each window: an offset of the light then changes nothing.
    pub(super) centred: bool,
    /// Slopes of u and v that are smooth, per pixel.
    pub(super) slopes: Slopes,
}

impl RoundOptions {
    /// How the windows of the round are made.
    pub(super) fn windows(&self) -> Made {
        Made {
            radius: self.recipe.radius,
            centred: self.centred,
            rephased: true,
        }
    }
}

/// Rows of [`Judged`] that belong to a band.
type JudgedRows<'a> = (EvenRows<'a, f32>, EvenRows<'a, f32>, EvenRows<'a, f32>);

/// Write to `to` the flow of `views` after one round; `judged` becomes what the windows say of it.
pub(super) fn round(
    views: Views<'_>,
    options: &RoundOptions,
    to: (&mut PaddedPlane, &mut PaddedPlane),
    judged: Option<&mut Judged>,
    execution: &Execution,
) -> Result<()> {
    let recipe = &options.recipe;
    let (width, height) = (views.prev.width(), views.prev.height());
    to.0.resize(width, height)?;
    to.1.resize(width, height)?;
    let judged = match judged {
        Some(judged) => {
            judged.resize(width, height)?;
            let Judged {
                fit,
                bearable,
                misfit,
            } = judged;
            Some((
                EvenRows::new(fit.rows_mut()),
                EvenRows::new(bearable.rows_mut()),
                EvenRows::new(misfit.rows_mut()),
            ))
        }
        None => None,
    };
    let halves = 2 * options.sweeps;
    // A band begins its sweeps beyond its own rows, which costs most of what as many rows more would: as few bands as
    // there are threads.
    let min_rows = height.div_ceil(execution.num_threads()).max(2 * halves);
    let level = execution.simd_level();
    let floats = Windows::FLOATS + Rows::floats(halves);
    let strips = Columns::strips(width, floats, halves + recipe.radius + 1);
    let size = Windows::most(strips.clone());
    let widest = strips.clone().map(|columns| columns.computed()).max();
    let size_of_rows = Rows::size(widest.unwrap_or(0), halves);
    for_each_band(
        execution,
        height,
        min_rows,
        (to.0.rows_mut(), to.1.rows_mut(), judged),
        |band, (mut to_u, mut to_v, mut judged)| {
            with_scratch(size + size_of_rows, |memory| {
                let (memory, system) = memory.split_at_mut(size);
                for columns in strips.clone() {
                    relax_strip(
                        level,
                        (views, options),
                        (&band, columns),
                        [&mut *memory, &mut *system],
                        [&mut to_u, &mut to_v],
                        judged.as_mut(),
                    );
                }
            })?;
            for local in 0..band.len() {
                for grid in [&mut to_u, &mut to_v] {
                    padded_plane::extend(grid.row_mut(local), width);
                }
            }
            Ok(())
        },
    )
}

/// Write rows `band` of the columns that are wanted of a strip; `memory` is of its windows and of its system.
fn relax_strip(
    level: SimdLevel,
    (views, options): (Views<'_>, &RoundOptions),
    (band, columns): (&Range<usize>, Columns),
    [memory, system]: [&mut [f32]; 2],
    [to_u, to_v]: [&mut RowsMut<'_, f32>; 2],
    mut judged: Option<&mut JudgedRows<'_>>,
) {
    let recipe = &options.recipe;
    let (height, halves) = (views.prev.height(), 2 * options.sweeps);
    let mut windows = Windows::new(level, views, columns, options.windows(), memory);
    let size = (columns.computed(), height);
    let relaxed = (recipe.relaxation, options.slopes);
    let mut rows = Rows::new(level, size, halves, relaxed, system);
    let first = band.start.saturating_sub(halves);
    let last = (band.end + halves).min(height);
    windows.start(first);
    for lead in first..last + halves + 1 {
        if lead < last {
            let sums = windows.row(lead);
            let near = [lead.saturating_sub(1), lead, (lead + 1).min(height - 1)];
            let flow = [views.u, views.v].map(|grid| near.map(|y| &grid.padded(y)[columns.from..]));
            let to = rows.next(lead);
            let judged = judged
                .as_mut()
                .filter(|_| lead % 2 == 0 && band.contains(&lead))
                .map(|(fit, bearable, misfit)| {
                    [fit, bearable, misfit].map(|grid| &mut grid.row_mut(lead)[columns.start / 2..])
                });
            by_radius!(recipe.radius, SIZE => dispatch(level, Prepare::<SIZE> {
                sums,
                flow,
                options,
                to,
                columns,
                judged,
            }));
            rows.border(lead);
        }
        if let Some(done) = rows.follow(lead, band, halves) {
            let local = done - band.start;
            let to = [to_u.row_mut(local), to_v.row_mut(local)];
            rows.write(done, columns, to.map(|row| &mut row[columns.start..]));
        }
    }
}

/// The parts of the equations of a row that do not depend on its neighbours.
struct Prepare<'a, const N: usize> {
    sums: Sums<'a>,
    /// The rows above, at and below of u and v.
    flow: [[&'a [f32]; 3]; 2],
    options: &'a RoundOptions,
    to: super::relax::Row<'a>,
    columns: Columns,
    judged: Option<[&'a mut [f32]; 3]>,
}

impl<const N: usize> Kernel for Prepare<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.sums.split.count;
        let reader = Reader::<S, N>::new(s, &self.sums);
        let weights = Weights::new(s, &self.options.recipe, 1);
        let slopes_of = self
            .options
            .slopes
            .map(|axis| axis.map(|slope| s.splat(slope)));
        let half = s.splat(0.5);
        let zero = s.splat(0.0);
        let near = |row, offset: usize| blocks(row, PAD + offset - 1, 2 * count);
        let [[ua, u, ub], [va, v, vb]] = self.flow;
        let across = [[near(u, 0), near(u, 2)], [near(v, 0), near(v, 2)]];
        let down = [[near(ua, 1), near(ub, 1)], [near(va, 1), near(vb, 1)]];
        let here = [near(u, 1), near(v, 1)];
        let [to_u, to_v, to_smooth, to_xx, to_xy, to_yy, to_bu, to_bv] = self.to;
        let (to_u, to_v) = (&mut groups(to_u, count), &mut groups(to_v, count));
        let to_smooth = &mut groups(to_smooth, count);
        let (to_xx, to_xy) = (&mut groups(to_xx, count), &mut groups(to_xy, count));
        let to_yy = &mut groups(to_yy, count);
        let (first, wanted) = (self.columns.skipped() / LANES, self.columns.groups());
        let mut judge = self.judged.map(|rows| Judge::new(s, N, wanted, rows));
        let (to_bu, to_bv) = (&mut groups(to_bu, count), &mut groups(to_bv, count));
        for i in 0..count {
            let mut slopes = [zero; 2];
            for k in 0..2 {
                for axis in 0..2 {
                    let j = 2 * i + k;
                    let [along_x, along_y] = slopes_of[axis];
                    let x = (s.get(&across[axis][1][j]) - s.get(&across[axis][0][j])) * half;
                    let y = (s.get(&down[axis][1][j]) - s.get(&down[axis][0][j])) * half;
                    let (x, y) = (x - along_x, y - along_y);
                    slopes[k] = slopes[k] + (x * x + y * y);
                }
            }
            let slopes = slopes[0].deinterleave(slopes[1]);
            let u = s
                .get(&here[0][2 * i])
                .deinterleave(s.get(&here[0][2 * i + 1]));
            let v = s
                .get(&here[1][2 * i])
                .deinterleave(s.get(&here[1][2 * i + 1]));
            let (slopes, u, v) = ([slopes.0, slopes.1], [u.0, u.1], [v.0, v.1]);
            let moments = reader.moments(i);
            if let Some(judge) = &mut judge
                && (first..first + wanted).contains(&i)
            {
                judge.put(i - first, moments[0], [zero; 2]);
            }
            for k in 0..2 {
                let equations = weights.equations(moments[k], slopes[k], [u[k], v[k]]);
                let [smooth, xx, xy, yy, bu, bv] = equations;
                u[k].put(&mut to_u[k][i]);
                v[k].put(&mut to_v[k][i]);
                smooth.put(&mut to_smooth[k][i]);
                xx.put(&mut to_xx[k][i]);
                xy.put(&mut to_xy[k][i]);
                yy.put(&mut to_yy[k][i]);
                bu.put(&mut to_bu[k][i]);
                bv.put(&mut to_bv[k][i]);
            }
        }
    }
}

/// The weights of data and smoothness.
pub(super) struct Weights<F> {
    smooth_epsilon: F,
    data_epsilon: F,
    trace_floor: F,
    edge: F,
    strength: F,
    zero: F,
    one: F,
}

impl<F: Floats> Weights<F> {
    /// For pixels that are `apart` pixels from each other: as many times fewer along each axis speak for the data, and
    /// their differences are as many times larger.
    #[inline(always)]
    pub(super) fn new<S: Simd<F = F>>(s: S, recipe: &RefineRecipe, apart: usize) -> Self {
        let square = |value: f32| value * value;
        let share = 0.5 / square(apart as f32);
        Self {
            smooth_epsilon: s.splat(square(recipe.smooth_epsilon)),
            data_epsilon: s.splat(square(recipe.data_epsilon)),
            trace_floor: s.splat(recipe.trace_floor),
            edge: s.splat(square(recipe.edge_scale)),
            strength: s.splat(share * recipe.alpha * square(recipe.edge_scale)),
            zero: s.splat(0.0),
            one: s.splat(1.0),
        }
    }

    /// Half the weight of smoothness, the matrix of the data (xx, xy, yy) and its right side, for squared slopes of the flow
    /// and the flow itself.
    #[inline(always)]
    pub(super) fn equations(
        &self,
        [_, xx, xy, yy, xd, yd, dd]: Moments<F>,
        slopes: F,
        [u, v]: [F; 2],
    ) -> [F; 6] {
        let trace = xx + yy;
        let smooth = self.strength / ((self.edge + trace) * (slopes + self.smooth_epsilon).sqrt());
        // 1 / (t (dd / t + epsilon^2)) with t = trace + floor.
        let spread = trace + self.trace_floor;
        let data = self.one / (dd.max(self.zero) + self.data_epsilon * spread);
        [
            smooth,
            xx * data,
            xy * data,
            yy * data,
            (xx * u + xy * v - xd) * data,
            (xy * u + yy * v - yd) * data,
        ]
    }
}

/// Both halves of a split row, in groups of lanes.
#[inline(always)]
pub(super) fn groups([even, odd]: [&mut [f32]; 2], count: usize) -> [&mut [[f32; LANES]]; 2] {
    [blocks_mut(even, PAD, count), blocks_mut(odd, PAD, count)]
}
