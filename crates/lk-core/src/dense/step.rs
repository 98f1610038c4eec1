//! One Lucas-Kanade step over all pixels: windows of least squares for the displacement and, with it, an offset of
//! the light.

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::for_each_band;
use crate::simd::{Floats, LaneKernel, Simd, blocks, blocks_mut, dispatch_lanes};

use super::grid::{self, Grid, PAD};
use super::scratch::with_scratch;
use super::windows::{Reader, Sums, Views, Windows};

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

/// Write the flow after one step, and the mean squared difference of each window before it.
pub(super) fn step(
    views: Views<'_>,
    options: &StepOptions,
    (u, v, energy): (&mut Grid, &mut Grid, &mut Grid),
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (views.prev.width(), views.prev.height());
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
            with_scratch(Windows::size(width), |memory| {
                let mut windows =
                    Windows::new(level, views, options.radius, options.centred, memory);
                windows.start(rows.start);
                for (local, y) in rows.enumerate() {
                    let sums = windows.row(y);
                    let mut to = [u.row_mut(local), v.row_mut(local), energy.row_mut(local)];
                    let from = [views.u.padded(y), views.v.padded(y)];
                    match options.radius {
                        1 => dispatch_lanes(level, Solve::<3>::new(sums, options, from, &mut to)),
                        2 => dispatch_lanes(level, Solve::<5>::new(sums, options, from, &mut to)),
                        _ => dispatch_lanes(level, Solve::<7>::new(sums, options, from, &mut to)),
                    }
                    for row in to {
                        grid::extend(row, width);
                    }
                }
            });
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

impl<const N: usize> LaneKernel for Solve<'_, N> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.sums.split.count;
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
        let StepOptions {
            damping, longest, ..
        } = self.options;
        let damping = s.splat(damping);
        let (most, least) = (s.splat(longest), s.splat(-longest));
        let (zero, one, nothing) = (s.splat(0.0), s.splat(1.0), s.splat(f32::MAX));
        for i in 0..count {
            let mut results = [[zero; 3]; 2];
            for (result, moments) in results.iter_mut().zip(reader.moments(i)) {
                let [n, xx, xy, yy, xd, yd, dd] = moments;
                let (xx, yy) = (xx + damping, yy + damping);
                let scale = one / (xy * xy - xx * yy);
                let step_u = (yy * xd - xy * yd) * scale;
                let step_v = (xx * yd - xy * xd) * scale;
                *result = [
                    step_u.max(least).min(most),
                    step_v.max(least).min(most),
                    S::F::select(zero.lt(n), dd, nothing),
                ];
            }
            let [even, odd] = results;
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
