//! A round of refinement on a grid of half the size: the data of one pixel in each 2 x 2, relaxed there.
//!
//! It costs about half of a round at all pixels ([`refine`](super::refine)), and smoothness reaches twice as far in as
//! many sweeps.
#![allow(clippy::needless_range_loop, reason = "several arrays run along")]

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{RowsMut, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Floats, Kernel, LANES, Simd, SimdLevel, blocks, dispatch};

use super::confidence::{Judge, Judged};
use super::moments::{Reader, Sums};
use super::padded_plane::{self, PAD, PaddedPlane};
use super::refine::{RoundOptions, Weights, groups};
use super::relax::{Row, Rows};
use super::tiles::Columns;
use super::windows::{Views, Windows};

/// Rows of [`Judged`] that belong to a band.
type JudgedRows<'a> = (RowsMut<'a, f32>, RowsMut<'a, f32>, RowsMut<'a, f32>);

/// Write to `to`, of half the size, the flow of `views`, which is of half the size, after one round; `judged` becomes what
/// the windows say of the flow before it.
pub(super) fn half_round(
    views: Views<'_>,
    options: &RoundOptions,
    to: (&mut PaddedPlane, &mut PaddedPlane),
    judged: Option<&mut Judged>,
    execution: &Execution,
) -> Result<()> {
    let recipe = &options.recipe;
    let (full_width, full_height) = (views.prev.width(), views.prev.height());
    let (width, height) = (views.u.width(), views.u.height());
    to.0.resize(width, height)?;
    to.1.resize(width, height)?;
    let judged = match judged {
        Some(judged) => {
            judged.resize(full_width, full_height)?;
            let Judged {
                fit,
                bearable,
                misfit,
            } = judged;
            Some((fit.rows_mut(), bearable.rows_mut(), misfit.rows_mut()))
        }
        None => None,
    };
    let halves = 2 * options.sweeps;
    // As for a round at all pixels: a band begins its sweeps beyond its own rows.
    let min_rows = height.div_ceil(execution.num_threads()).max(2 * halves);
    let level = execution.simd_level();
    let floats = 2 * Windows::FLOATS + Rows::floats(halves);
    let reach = halves + (recipe.radius + 1).div_ceil(2) + 1;
    let strips = Columns::strips(width, floats, reach);
    let size = Windows::most(strips.clone().map(|columns| columns.doubled(full_width)));
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
    let (height, halves) = (views.u.height(), 2 * options.sweeps);
    let doubled = columns.doubled(views.prev.width());
    let mut windows = Windows::new(level, views, doubled, options.windows(), memory);
    let size = (columns.computed(), height);
    let slopes = options.slopes.map(|axis| axis.map(|slope| 2.0 * slope));
    let mut rows = Rows::new(level, size, halves, (recipe.relaxation, slopes), system);
    let first = band.start.saturating_sub(halves);
    let last = (band.end + halves).min(height);
    windows.start(2 * first);
    for lead in first..last + halves + 1 {
        if lead < last {
            let sums = windows.upper_row(2 * lead);
            let near = [lead.saturating_sub(1), lead, (lead + 1).min(height - 1)];
            let flow = [views.u, views.v].map(|grid| near.map(|y| &grid.padded(y)[columns.from..]));
            let to = rows.next(lead);
            let judged =
                judged
                    .as_mut()
                    .filter(|_| band.contains(&lead))
                    .map(|(fit, bearable, misfit)| {
                        [fit, bearable, misfit]
                            .map(|grid| &mut grid.row_mut(lead - band.start)[columns.start..])
                    });
            by_radius!(recipe.radius, SIZE => dispatch(level, Prepare::<SIZE> {
                sums,
                flow,
                scale: views.halved.unwrap_or(1.0),
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

/// The parts of the equations of a row that do not depend on its neighbours, at even pixels alone.
struct Prepare<'a, const N: usize> {
    /// Of the level: twice as many columns.
    sums: Sums<'a>,
    /// The rows above, at and below of u and v.
    flow: [[&'a [f32]; 3]; 2],
    /// What the values of the flow are multiplied by.
    scale: f32,
    options: &'a RoundOptions,
    to: Row<'a>,
    columns: Columns,
    judged: Option<[&'a mut [f32]; 3]>,
}

impl<const N: usize> Kernel for Prepare<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        // Each pair of groups of the grid takes the even pixels of two pairs of groups of the level, if both are there.
        let level_groups = self.sums.split.count;
        let count = self.columns.computed().div_ceil(2 * LANES);
        let reader = Reader::<S, N>::new(s, &self.sums);
        let weights = Weights::new(s, &self.options.recipe, 2);
        let slopes_of = self
            .options
            .slopes
            .map(|axis| axis.map(|slope| s.splat(slope)));
        // The difference of two neighbours, two pixels away each.
        let quarter = s.splat(0.25 * self.scale);
        let scale = s.splat(self.scale);
        let zero = s.splat(0.0);
        let near = |row, offset: usize| blocks(row, PAD + offset - 1, 2 * count);
        let [[ua, u, ub], [va, v, vb]] = self.flow;
        let across = [[near(u, 0), near(u, 2)], [near(v, 0), near(v, 2)]];
        let down = [[near(ua, 1), near(ub, 1)], [near(va, 1), near(vb, 1)]];
        let here = [near(u, 1), near(v, 1)];
        let [to_u, to_v, to_smooth, to_xx, to_xy, to_yy, to_bu, to_bv] = self.to;
        let to = [
            groups(to_u, count),
            groups(to_v, count),
            groups(to_smooth, count),
            groups(to_xx, count),
            groups(to_xy, count),
            groups(to_yy, count),
            groups(to_bu, count),
            groups(to_bv, count),
        ];
        let first = (self.columns.start - self.columns.from) / LANES;
        let wanted = (self.columns.end - self.columns.start).div_ceil(LANES);
        let mut judge = self.judged.map(|rows| Judge::new(s, N, wanted, rows));
        for i in 0..count {
            let mut both = [[zero; 8]; 2];
            for k in 0..2 {
                let j = 2 * i + k;
                let [moments, _] = reader.moments(j.min(level_groups - 1));
                if let Some(judge) = &mut judge
                    && (first..first + wanted).contains(&j)
                {
                    judge.put(j - first, moments, [zero; 2]);
                }
                let mut slopes = zero;
                for axis in 0..2 {
                    let [along_x, along_y] = slopes_of[axis];
                    let x = (s.get(&across[axis][1][j]) - s.get(&across[axis][0][j])) * quarter;
                    let y = (s.get(&down[axis][1][j]) - s.get(&down[axis][0][j])) * quarter;
                    let (x, y) = (x - along_x, y - along_y);
                    slopes = slopes + (x * x + y * y);
                }
                let (u, v) = (s.get(&here[0][j]) * scale, s.get(&here[1][j]) * scale);
                let [smooth, xx, xy, yy, bu, bv] = weights.equations(moments, slopes, [u, v]);
                both[k] = [u, v, smooth, xx, xy, yy, bu, bv];
            }
            let [first, second] = both;
            macro_rules! each {
                ($($q:literal)+) => {$(
                    let (even, odd) = first[$q].deinterleave(second[$q]);
                    even.put(&mut to[$q][0][i]);
                    odd.put(&mut to[$q][1][i]);
                )+};
            }
            each!(0 1 2 3 4 5 6 7);
        }
    }
}
