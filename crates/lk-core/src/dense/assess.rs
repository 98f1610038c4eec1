//! The last look at every window: how well the flow fits, and whether the pixel counts as measured.

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::{RowsMut, for_each_band};
use crate::simd::{Kernel, dispatch};

use super::field::FlowField;
use super::grid::{self, PAD};
use super::step::{Band, Results, StepInput, StepOptions};
use crate::scratch::with_scratch;

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

/// Fill `field` with the flow of `input` and what its windows say. `finite` is 0 where `next` is not finite; `unit` is
/// what one grey level of the planes is in those of the caller.
pub(super) fn assess(
    input: StepInput<'_>,
    finite: Option<&Plane>,
    centred: bool,
    unit: f32,
    field: &mut FlowField,
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (input.prev.width(), input.prev.height());
    let options = StepOptions {
        radius: RADIUS,
        centred,
        damping: 0.0,
        longest: 0.0,
    };
    let level = execution.simd_level();
    let size = Band::size(width, RADIUS);
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
                let mut band = Band::new(level, input, &options, memory);
                band.start(rows.start);
                for (local, y) in rows.enumerate() {
                    band.row(
                        y,
                        Results::Fit {
                            count: &mut *count,
                            texture: &mut *texture,
                            energy: &mut *energy,
                        },
                    );
                    let (u, v) = (input.u.row(y), input.v.row(y));
                    let (uv, _) = uv.row_mut(local).as_chunks_mut::<2>();
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
                    if let Some(weight) = input.weight {
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

/// One row of the result, where nothing is masked and all is finite.
struct Judge<'a> {
    y: f32,
    unit: f32,
    /// The last column and row.
    size: [f32; 2],
    flow: [&'a [f32]; 2],
    /// How many pixels count, texture and energy.
    fit: [&'a [f32]; 3],
    uv: &'a mut [[f32; 2]],
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
        let (uv, residual) = (&mut self.uv[..width], &mut self.residual[..width]);
        for x in 0..width {
            uv[x] = [u[x], v[x]];
            residual[x] = energy[x].sqrt() * self.unit;
            let (at_x, at_y) = (x as f32 + u[x], self.y + v[x]);
            // Without shortcuts, so that lanes can do it.
            self.valid[x] = (at_x >= 0.0)
                & (at_x <= self.size[0])
                & (at_y >= 0.0)
                & (at_y <= self.size[1])
                & (2.0 * count[x] > ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32)
                & (texture[x] >= TEXTURE)
                & (energy[x] <= NOISE + MISFIT * texture[x]);
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
