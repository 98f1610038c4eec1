//! The Gauss-Newton iteration for a window that deforms, from level to level.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::solution::Affine;
use super::solve::{SETTLED, solve};
use super::view::{MOTION, View};
use crate::error::Result;
use crate::shift::gauss_newton::{Found, Problem};
use crate::shift::gram::Light;

/// Evaluations at a level.
const ITERATIONS: usize = 12;
/// So does one below this share of its standard deviation.
const SETTLED_SHARE: f64 = 0.2;
/// The same as [`SETTLED`] at a coarse level.
const COARSE_SETTLED: f64 = 0.02;
/// Windows that deform more than this over a pixel are not followed.
const MAX_GRADIENT: f64 = 0.5;
impl Problem<'_> {
    /// The displacement that varies linearly over the window, from one that does not; `None` if too few pixels are
    /// shown by both frames. `enough` clusters of the window, about, are looked at.
    pub(in crate::shift) fn affine(
        &mut self,
        start: &Found,
        from: usize,
        enough: usize,
    ) -> Result<Option<Affine>> {
        let mut motion = [0.0; MOTION];
        let mut found = None;
        for level in (0..=from).rev() {
            let scale = f64::from(1u32 << level);
            let pair = self.inputs.pair(level);
            // Pixel (x, y) of a level sits over pixel (2^level x, 2^level y).
            let center = self.inputs.center().map(|value| value / scale);
            let unit = self.inputs.half_side() / scale;
            if level == from {
                motion[..2].copy_from_slice(&start.displacement.map(|value| value / scale));
            } else {
                motion[0] *= 2.0;
                motion[1] *= 2.0;
            }
            let mut steady = false;
            for iteration in 0..ITERATIONS {
                let view = View {
                    pair,
                    motion,
                    center,
                    unit,
                };
                self.clusters.sum(&view, enough, &self.options.execution)?;
                let light = Light::new(self.options.illumination);
                let rounding = self.inputs.normalization.rounding / (scale * scale);
                let damping = start.solution.damping;
                let (clusters, cells) = self.clusters.last();
                let solved = solve(clusters, light, view.noise(), rounding, damping, cells)?;
                let Some(mut solution) = solved else {
                    return Ok(None);
                };
                let mut length: f64 = 0.0;
                for (index, value) in motion.iter_mut().enumerate() {
                    let step = solution.motion[index];
                    length = length.max(step.abs());
                    *value += if index < 2 { step } else { step / unit };
                }
                if !length.is_finite() || motion[2..].iter().any(|value| value.abs() > MAX_GRADIENT)
                {
                    return Ok(None);
                }
                // Where a pixel's counterpart changes the sums jump, by far less than their deviation.
                let deviation = (solution.covariance[0][0] + solution.covariance[1][1]).sqrt();
                let settled = if level == 0 { SETTLED } else { COARSE_SETTLED };
                steady = length < settled.max(SETTLED_SHARE * deviation);
                // Where a few pixels change to and fro it goes on like this: no further off than they say.
                let last = iteration + 1 == ITERATIONS && length < deviation;
                if last && !steady {
                    steady = true;
                    let more = 1.0 + (length / deviation).powi(2);
                    solution.covariance = solution.covariance.map(|row| row.map(|v| more * v));
                }
                solution.motion = motion;
                solution.steady = steady;
                for i in 0..MOTION {
                    for j in 0..MOTION {
                        for index in [i, j] {
                            solution.covariance[i][j] /= if index < 2 { 1.0 } else { unit };
                        }
                    }
                }
                found = Some(solution);
                if steady {
                    break;
                }
            }
            if !steady && level == 0 {
                break;
            }
        }
        Ok(found.map(Affine::corrected))
    }
}
