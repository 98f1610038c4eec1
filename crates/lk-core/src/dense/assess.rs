//! The last look at every window: how well the flow fits, and whether the pixel counts as measured.

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::{RowsMut, for_each_band};
use crate::simd::{Floats, Kernel, LaneKernel, Simd, blocks_mut, dispatch, dispatch_lanes};

use super::field::FlowField;
use super::grid::{self, PAD};
use super::scratch::with_scratch;
use super::windows::{Reader, Sums, Views, Windows};

/// Half the window.
const RADIUS: usize = 3;

/// The smaller eigenvalue of the structure tensor (mean over the window, squared grey levels) below which motion along
/// one direction is noise. Noise of one grey level alone gives 1/8: four differences of weight 1/4, in one direction,
/// twice the variance.
const TEXTURE: f32 = 1.0;

/// Mean squared differences above this share of the texture are not explained by an error of the flow of a pixel or so.
const MISFIT: f32 = 1.0;

/// Mean squared differences that noise explains, in squared grey levels.
const NOISE: f32 = 16.0;

/// Fill `field` with the flow of `input` and what its windows say. `given` is 0 at pixels of `prev` that were not to be
/// measured, `finite` where `next` is not finite; `unit` is
/// what one grey level of the planes is in those of the caller.
pub(super) fn assess(
    input: Views<'_>,
    (given, finite): (Option<&Plane>, Option<&Plane>),
    centred: bool,
    unit: f32,
    field: &mut FlowField,
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (input.prev.width(), input.prev.height());
    let level = execution.simd_level();
    let size = Windows::size(width);
    let outputs = (
        RowsMut::new(&mut field.uv, 2 * width),
        RowsMut::new(&mut field.valid, width),
        RowsMut::new(&mut field.residual, width),
    );
    for_each_band(
        execution,
        height,
        (16_384 / width).max(8),
        outputs,
        |rows, (mut uv, mut valid, mut residual)| {
            with_scratch(size + 3 * grid::stride(width), |memory| {
                let (memory, fit) = memory.split_at_mut(size);
                let (count, fit) = fit.split_at_mut(grid::stride(width));
                let (texture, energy) = fit.split_at_mut(grid::stride(width));
                let mut windows = Windows::new(level, input, RADIUS, centred, memory);
                windows.start(rows.start);
                for (local, y) in rows.enumerate() {
                    let kernel = Fit {
                        sums: windows.row(y),
                        to: [&mut *count, &mut *texture, &mut *energy],
                    };
                    dispatch_lanes(level, kernel);
                    let (u, v) = (input.u.row(y), input.v.row(y));
                    let uv = uv.row_mut(local);
                    let (valid, residual) = (valid.row_mut(local), residual.row_mut(local));
                    let kernel = Judge {
                        y: y as f32,
                        unit,
                        size: [(width - 1) as f32, (height - 1) as f32],
                        flow: [u, v],
                        fit: [&*count, &*texture, &*energy].map(|row| &row[PAD..PAD + width]),
                        uv: &mut *uv,
                        valid: &mut *valid,
                        residual: &mut *residual,
                    };
                    dispatch(level, kernel);
                    let (uv, _) = uv.as_chunks_mut::<2>();
                    if let Some(weight) = given {
                        for (x, weight) in weight.row(y).iter().enumerate() {
                            if *weight == 0.0 {
                                uv[x] = [f32::NAN; 2];
                                residual[x] = f32::NAN;
                                valid[x] = false;
                            }
                        }
                    }
                    if let Some(finite) = finite {
                        for x in 0..width {
                            valid[x] =
                                valid[x] && near_finite(finite, x as f32 + u[x], y as f32 + v[x]);
                        }
                    }
                }
            });
        },
    )
}

/// How many pixels count in each window, the smaller eigenvalue of its structure tensor, and its mean squared difference.
struct Fit<'a> {
    sums: Sums<'a>,
    to: [&'a mut [f32]; 3],
}

impl LaneKernel for Fit<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.sums.split.count;
        let reader = Reader::<S, { 2 * RADIUS + 1 }>::new(s, &self.sums);
        let [number, texture, energy] = self.to.map(|row| blocks_mut(row, PAD, 2 * count));
        let (zero, half) = (s.splat(0.0), s.splat(0.5));
        for i in 0..count {
            let mut results = [[zero; 3]; 2];
            for (result, moments) in results.iter_mut().zip(reader.moments(i)) {
                let [n, xx, xy, yy, _, _, dd] = moments;
                let difference = (xx - yy) * half;
                let root = (difference * difference + xy * xy).sqrt();
                *result = [n, ((xx + yy) * half - root).max(zero), dd.max(zero)];
            }
            let [even, odd] = results;
            let (first, second) = even[0].interleave(odd[0]);
            first.put(&mut number[2 * i]);
            second.put(&mut number[2 * i + 1]);
            let (first, second) = even[1].interleave(odd[1]);
            first.put(&mut texture[2 * i]);
            second.put(&mut texture[2 * i + 1]);
            let (first, second) = even[2].interleave(odd[2]);
            first.put(&mut energy[2 * i]);
            second.put(&mut energy[2 * i + 1]);
        }
    }
}

/// One row of the result, where nothing is masked and all is finite.
struct Judge<'a> {
    y: f32,
    unit: f32,
    /// The last column and row.
    size: [f32; 2],
    flow: [&'a [f32]; 2],
    /// How many pixels count, texture and energy.
    fit: [&'a [f32]; 3],
    uv: &'a mut [f32],
    valid: &'a mut [bool],
    residual: &'a mut [f32],
}

impl Kernel for Judge<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.valid.len();
        let ([u, v], [count, texture, energy]) = (
            self.flow.map(|row| &row[..width]),
            self.fit.map(|row| &row[..width]),
        );
        let (pairs, _) = self.uv.as_chunks_mut::<2>();
        for ((pair, u), v) in pairs.iter_mut().zip(u).zip(v) {
            *pair = [*u, *v];
        }
        for (residual, energy) in self.residual.iter_mut().zip(energy) {
            *residual = energy.sqrt() * self.unit;
        }
        let [right, bottom] = self.size;
        let (y, valid) = (self.y, &mut self.valid[..width]);
        for x in 0..width {
            let (at_x, at_y) = (x as i32 as f32 + u[x], y + v[x]);
            // Each term is negative where something is amiss: one sign to look at, which lanes can do.
            let within = (at_x.min(right - at_x)).min(at_y.min(bottom - at_y));
            let enough = 2.0 * count[x] - ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
            let textured = texture[x] - TEXTURE;
            let fits = NOISE + MISFIT * texture[x] - energy[x];
            valid[x] = within.min(enough).min(textured.min(fits)) >= 0.0;
        }
    }
}

/// Whether all pixels of the window around (x, y) are finite.
fn near_finite(finite: &Plane, x: f32, y: f32) -> bool {
    let range = |at: f32, size: usize| {
        let at = at.round().max(0.0) as usize;
        at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(size)
    };
    range(y, finite.height())
        .all(|row| range(x, finite.width()).all(|column| finite.row(row)[column] > 0.0))
}
