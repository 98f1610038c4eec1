//! One Lucas-Kanade step over all pixels: windows of least squares for the displacement and, with it, an offset of
//! the light.
//!
//! `docs/explanation/algorithms.md`, section "A step".

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::for_each_band;
use crate::scratch::with_scratch;
use crate::simd::{Floats, Kernel, LANES, Simd, blocks, blocks_mut, dispatch};

use super::padded_plane::{self, PAD, PaddedPlane};
use super::tiles::Columns;

use super::confidence::{Judge, Judged};
use super::moments::{Moments, Reader, Sums};
use super::windows::{Made, Views, Windows};

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
    pub(super) max_step: f32,
    /// Whether windows are not judged, but what they would be judged by is written.
    pub(super) measures: bool,
}

impl StepOptions {
    /// How the windows of the step are made.
    pub(super) fn windows(&self) -> Made {
        Made {
            radius: self.radius,
            centred: self.centred,
            rephased: false,
        }
    }
}

/// Write the flow after one step, and the mean squared difference of each window before it.
pub(super) fn step(
    views: Views<'_>,
    options: &StepOptions,
    (u, v, energy): (&mut PaddedPlane, &mut PaddedPlane, &mut PaddedPlane),
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (views.prev.width(), views.prev.height());
    for plane in [&mut *u, &mut *v, &mut *energy] {
        plane.resize(width, height)?;
    }
    let level = execution.simd_level();
    let strips = Columns::strips(width, Windows::FLOATS, options.radius + 1);
    let size = Windows::most(strips.clone());
    for_each_band(
        execution,
        height,
        Windows::rows_of_bands(execution, height),
        (u.rows_mut(), v.rows_mut(), energy.rows_mut()),
        |rows, (mut u, mut v, mut energy)| {
            with_scratch(size, |memory| {
                for columns in strips.clone() {
                    let mut windows =
                        Windows::new(level, views, columns, options.windows(), &mut *memory);
                    windows.start(rows.start);
                    for (local, y) in rows.clone().enumerate() {
                        let sums = windows.row(y).of(columns);
                        let mut to = [u.row_mut(local), v.row_mut(local), energy.row_mut(local)]
                            .map(|row| &mut row[columns.start..]);
                        let from = [views.u, views.v].map(|grid| &grid.padded(y)[columns.start..]);
                        by_radius!(options.radius, SIZE => dispatch(
                            level,
                            Solve::<SIZE>::new(sums, options, from, &mut to)
                        ));
                    }
                }
            })?;
            for local in 0..rows.len() {
                for grid in [&mut u, &mut v, &mut energy] {
                    padded_plane::extend(grid.row_mut(local), width);
                }
            }
            Ok(())
        },
    )
}

/// The same at one pixel in each 2 x 2, (2x, 2y), into grids of half the size; `judged` becomes what the windows say of the
/// flow afterwards.
pub(super) fn sparse_step(
    views: Views<'_>,
    options: &StepOptions,
    (u, v, energy): (&mut PaddedPlane, &mut PaddedPlane, &mut PaddedPlane),
    judged: Option<&mut Judged>,
    execution: &Execution,
) -> Result<()> {
    let (full_width, full_height) = (views.prev.width(), views.prev.height());
    let (width, height) = (full_width.div_ceil(2), full_height.div_ceil(2));
    for plane in [&mut *u, &mut *v, &mut *energy] {
        plane.resize(width, height)?;
    }
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
    let level = execution.simd_level();
    let strips = Columns::strips(full_width, Windows::FLOATS, options.radius + 1);
    let size = Windows::most(strips.clone());
    for_each_band(
        execution,
        height,
        Windows::rows_of_bands(execution, full_height).div_ceil(2),
        (u.rows_mut(), v.rows_mut(), energy.rows_mut(), judged),
        |rows, (mut u, mut v, mut energy, mut judged)| {
            with_scratch(size, |memory| {
                for columns in strips.clone() {
                    let mut windows =
                        Windows::new(level, views, columns, options.windows(), &mut *memory);
                    windows.start(2 * rows.start);
                    let half = columns.start / 2;
                    for (local, y) in rows.clone().enumerate() {
                        let sums = windows.upper_row(2 * y).of(columns);
                        let mut to = [u.row_mut(local), v.row_mut(local), energy.row_mut(local)]
                            .map(|row| &mut row[half..]);
                        let halved = views.halved;
                        let (row, first) = if halved.is_some() {
                            (y, half)
                        } else {
                            (2 * y, columns.start)
                        };
                        let from = [views.u, views.v].map(|grid| &grid.padded(row)[first..]);
                        let judged = judged.as_mut().map(|(fit, bearable, misfit)| {
                            [fit, bearable, misfit].map(|grid| &mut grid.row_mut(local)[half..])
                        });
                        by_radius!(options.radius, SIZE => {
                            let solve = Solve::<SIZE>::new(sums, options, from, &mut to);
                            dispatch(level, Sparse { solve, halved, judged });
                        });
                    }
                }
            })?;
            for local in 0..rows.len() {
                for grid in [&mut u, &mut v, &mut energy] {
                    padded_plane::extend(grid.row_mut(local), width);
                }
            }
            Ok(())
        },
    )
}

/// The least squares of each pixel of a row, and its step.
struct Solve<'a, const N: usize> {
    sums: Sums<'a>,
    options: StepOptions,
    from: [&'a [f32]; 2],
    to: [&'a mut [f32]; 3],
}

impl<'a, const N: usize> Solve<'a, N> {
    fn new(
        sums: Sums<'a>,
        options: &StepOptions,
        from: [&'a [f32]; 2],
        to: &'a mut [&mut [f32]; 3],
    ) -> Self {
        Self {
            sums,
            options: *options,
            from,
            to: to.each_mut().map(|row| &mut **row),
        }
    }
}

/// What the least squares of one group of lanes need besides their moments.
struct Limits<F> {
    damping: F,
    most: F,
    least: F,
    zero: F,
    one: F,
    nothing: F,
}

impl<F: Floats> Limits<F> {
    #[inline(always)]
    fn new<S: Simd<F = F>>(s: S, options: &StepOptions) -> Self {
        Self {
            damping: s.splat(options.damping),
            most: s.splat(options.max_step),
            least: s.splat(-options.max_step),
            zero: s.splat(0.0),
            one: s.splat(1.0),
            nothing: s.splat(f32::MAX),
        }
    }

    /// The step along x and y, and the energy before it.
    #[inline(always)]
    fn solve(&self, [n, xx, xy, yy, xd, yd, dd]: Moments<F>) -> [F; 3] {
        let (xx, yy) = (xx + self.damping, yy + self.damping);
        let scale = self.one / (xy * xy - xx * yy);
        let step_u = (yy * xd - xy * yd) * scale;
        let step_v = (xx * yd - xy * xd) * scale;
        [
            step_u.max(self.least).min(self.most),
            step_v.max(self.least).min(self.most),
            F::select(self.zero.lt(n), dd, self.nothing),
        ]
    }
}

/// A row of even pixels alone.
struct Sparse<'a, const N: usize> {
    solve: Solve<'a, N>,
    /// If the flow before the step is of half the size: what its values are multiplied by.
    halved: Option<f32>,
    judged: Option<[&'a mut [f32]; 3]>,
}

impl<const N: usize> Kernel for Sparse<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Solve {
            sums,
            options,
            from: [from_u, from_v],
            to: [to_u, to_v, to_energy],
        } = self.solve;
        let count = sums.count;
        let reader = Reader::<S, N>::new(s, &sums);
        let limits = Limits::new(s, &options);
        let to_u = blocks_mut(to_u, PAD, count);
        let to_v = blocks_mut(to_v, PAD, count);
        let to_energy = blocks_mut(to_energy, PAD, count);
        let scale = s.splat(self.halved.unwrap_or(1.0));
        let mut judge = self.judged.map(|rows| Judge::new(s, N, count, rows));
        for i in 0..count {
            let [even, _] = reader.moments(i);
            let [u, v, energy] = limits.solve(even);
            if let Some(judge) = &mut judge {
                if options.measures {
                    judge.put_measures(i, even, [u, v]);
                } else {
                    judge.put(i, even, [u, v]);
                }
            }
            let (before_u, before_v) = if self.halved.is_some() {
                let at = PAD + i * LANES;
                (s.load(from_u, at) * scale, s.load(from_v, at) * scale)
            } else {
                let at = PAD + 2 * i * LANES;
                let (u, _) = s.load(from_u, at).deinterleave(s.load(from_u, at + LANES));
                let (v, _) = s.load(from_v, at).deinterleave(s.load(from_v, at + LANES));
                (u, v)
            };
            (before_u + u).put(&mut to_u[i]);
            (before_v + v).put(&mut to_v[i]);
            energy.put(&mut to_energy[i]);
        }
    }
}

impl<const N: usize> Kernel for Solve<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.sums.count;
        let reader = Reader::<S, N>::new(s, &self.sums);
        let [from_u, from_v] = self.from;
        let (from_u, from_v) = (
            blocks(from_u, PAD, 2 * count),
            blocks(from_v, PAD, 2 * count),
        );
        let [to_u, to_v, to_energy] = self.to;
        let (to_u, to_v) = (
            blocks_mut(to_u, PAD, 2 * count),
            blocks_mut(to_v, PAD, 2 * count),
        );
        let to_energy = blocks_mut(to_energy, PAD, 2 * count);
        let limits = Limits::new(s, &self.options);
        for i in 0..count {
            let [even, odd] = reader.moments(i);
            let (even, odd) = (limits.solve(even), limits.solve(odd));
            let (u, next_u) = even[0].interleave(odd[0]);
            let (v, next_v) = even[1].interleave(odd[1]);
            let (energy, next_energy) = even[2].interleave(odd[2]);
            (s.get(&from_u[2 * i]) + u).put(&mut to_u[2 * i]);
            (s.get(&from_u[2 * i + 1]) + next_u).put(&mut to_u[2 * i + 1]);
            (s.get(&from_v[2 * i]) + v).put(&mut to_v[2 * i]);
            (s.get(&from_v[2 * i + 1]) + next_v).put(&mut to_v[2 * i + 1]);
            energy.put(&mut to_energy[2 * i]);
            next_energy.put(&mut to_energy[2 * i + 1]);
        }
    }
}
