//! A picture in the light of another: gain and offset, as [`light`](super::light) found them, at each pixel of a level.
//!
//! `docs/explanation/algorithms.md`, section "Slow light".

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::{even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, dispatch};

use super::light::Light;

impl Light {
    /// Give `plane`, the level of the estimate, the light of `next`.
    pub(super) fn apply(&self, plane: &mut Plane) {
        for y in 0..plane.height() {
            let light = self.gain.row(y).iter().zip(self.offset.row(y));
            for (pixel, (gain, offset)) in plane.row_mut(y).iter_mut().zip(light) {
                *pixel = gain * *pixel + offset;
            }
        }
    }

    /// The same for a level `times` halvings finer, where what is at the limits of `prev` and what comes to those of `next`
    /// gets a weight of 0, all else one of 1.
    pub(super) fn apply_clipped(
        &self,
        plane: &mut Plane,
        times: usize,
        [prev, next]: [Option<[f32; 2]>; 2],
        unclipped: &mut Plane,
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = (plane.width(), plane.height());
        let level = execution.simd_level();
        let scale = 1.0 / (1usize << times) as f32;
        let cells = self.gain.width();
        let limits = |range: Option<[f32; 2]>| range.unwrap_or([f32::NEG_INFINITY, f32::INFINITY]);
        let limits = [limits(prev), limits(next)];
        for_each_band(
            execution,
            height,
            even_bands(execution, height, [16_384 / width, 4_096 / width]),
            (plane.rows_mut(), unclipped.rows_mut()),
            |rows, (mut plane, mut unclipped)| {
                with_scratch(2 * cells, |memory| {
                    let (gain, offset) = memory.split_at_mut(cells);
                    for (local, y) in rows.enumerate() {
                        let at = y as f32 * scale;
                        let above = (at as usize).min(self.gain.height() - 1);
                        let below = (above + 1).min(self.gain.height() - 1);
                        let down = at - above as f32;
                        for (plane, row) in [(&self.gain, &mut *gain), (&self.offset, &mut *offset)]
                        {
                            let (above, below) = (plane.row(above), plane.row(below));
                            for (to, (above, below)) in row.iter_mut().zip(above.iter().zip(below))
                            {
                                *to = above + down * (below - above);
                            }
                        }
                        let (pixels, weights) = (plane.row_mut(local), unclipped.row_mut(local));
                        let step = 1usize << times;
                        for cell in 0..width.div_ceil(step).min(cells) {
                            let columns = cell * step..((cell + 1) * step).min(width);
                            let right = (cell + 1).min(cells - 1);
                            let kernel = Relight {
                                gain: [gain[cell], scale * (gain[right] - gain[cell])],
                                offset: [offset[cell], scale * (offset[right] - offset[cell])],
                                limits,
                                pixels: &mut pixels[columns.clone()],
                                weights: &mut weights[columns],
                            };
                            dispatch(level, kernel);
                        }
                    }
                })
            },
        )
    }
}

/// Pixels between two of the grid of the light.
struct Relight<'a> {
    /// At the first one, and what it changes by from pixel to pixel.
    gain: [f32; 2],
    offset: [f32; 2],
    /// The least and the largest grey level of `prev` and of `next`.
    limits: [[f32; 2]; 2],
    pixels: &'a mut [f32],
    weights: &'a mut [f32],
}

impl Kernel for Relight<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [[prev_low, prev_high], [low, high]] = self.limits;
        let ([gain, more_gain], [offset, more_offset]) = (self.gain, self.offset);
        for (k, (pixel, weight)) in self.pixels.iter_mut().zip(self.weights).enumerate() {
            let before = *pixel;
            let k = k as f32;
            let lit = (gain + k * more_gain) * before + (offset + k * more_offset);
            *pixel = lit.max(low).min(high);
            let within = before > prev_low && before < prev_high && lit > low && lit < high;
            *weight = if within { 1.0 } else { 0.0 };
        }
    }
}
