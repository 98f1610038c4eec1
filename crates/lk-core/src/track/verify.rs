//! Whether what was found is to be believed, and how uncertain it is.
//!
//! `docs/explanation/algorithms.md`, section "Judgement".

use crate::illumination::Illumination;
use crate::track::noise::{Samples, noise_gain};
use crate::track::normal::{GAIN_RANGE, Normal, SIMPLER};
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::patch::Template;
use crate::track::problem::{Problem, Workspace, inside};
use crate::track::solve::FinalStep;

/// Variance left in the difference, as a share of the window's own, beyond which two windows do not match.
const MAX_UNEXPLAINED: f64 = 0.25;

/// How exactly the way back is measured, as a share of what it may miss by.
pub(super) const RETURN_SHARE: f64 = 0.1;

/// Standard deviation of a position, in pixels along its worst direction, beyond which a window has no texture.
const MAX_DEVIATION: f64 = 0.5;

/// A displacement that was found, and how well it fits.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    pub(super) displacement: [f64; 2],
    /// Mean square difference that is left, in square grey levels.
    pub(super) variance: f64,
    /// Variance of the window in `prev`, times the gain squared.
    pub(super) signal: f64,
    /// Covariance of the displacement for that variance: xx, xy, yy.
    pub(super) covariance: [f64; 3],
    pub(super) gain: f64,
}

impl Problem<'_> {
    /// The fit after the last step, under the simplest lighting model that the window does not speak against: an
    /// unknown that is not there costs accuracy.
    pub(super) fn settle(&self, rest: &FinalStep, template: &Template) -> Fit {
        if self.options.illumination == Illumination::GainOffset {
            let full = rest.normal.left(&rest.sums);
            let unit = rest.normal.noise(full);
            for (light, limit) in SIMPLER {
                if let Some(normal) = Normal::new(template, light)
                    && normal.left(&rest.sums) - full <= limit * unit
                {
                    return Fit::new(template, rest, &normal);
                }
            }
        }
        Fit::new(template, rest, &rest.normal)
    }

    /// Judge what was found for `point` from the displacement `guess` on the level `top`.
    pub(super) fn conclude(
        &self,
        point: [f32; 2],
        guess: [f64; 2],
        top: usize,
        fit: &Fit,
        workspace: &mut Workspace,
    ) -> TrackedPoint {
        let position = [
            (f64::from(point[0]) + fit.displacement[0]) as f32,
            (f64::from(point[1]) + fit.displacement[1]) as f32,
        ];
        if let Err(status) = self.judge(fit, position) {
            return TrackedPoint {
                residual: fit.variance.sqrt() as f32,
                ..TrackedPoint::lost(status)
            };
        }
        let mut forward_backward = f32::NAN;
        if let Some(limit) = self.options.max_forward_backward {
            let tolerance = RETURN_SHARE * f64::from(limit);
            let back = self.come_back(point, position, guess, top, tolerance, workspace);
            forward_backward = back.map_or(f32::NAN, |distance| distance as f32);
            // Also where nothing came back, and the distance is NaN.
            if forward_backward.is_nan() || forward_backward > limit {
                return TrackedPoint {
                    residual: fit.variance.sqrt() as f32,
                    forward_backward,
                    ..TrackedPoint::lost(PointStatus::ForwardBackward)
                };
            }
        }
        TrackedPoint {
            position,
            status: PointStatus::Tracked,
            residual: fit.variance.sqrt() as f32,
            covariance: fit.covariance.map(|value| value as f32),
            forward_backward,
            deformation: [[1.0, 0.0], [0.0, 1.0]],
            unexplained: (fit.variance / fit.signal) as f32,
        }
    }

    pub(super) fn judge(&self, fit: &Fit, position: [f32; 2]) -> Result<(), PointStatus> {
        if !inside(&self.next[0], position) {
            return Err(PointStatus::OutOfFrame);
        }
        if let Some(longest) = self.options.max_displacement
            && fit.displacement[0].hypot(fit.displacement[1]) > f64::from(longest)
        {
            return Err(PointStatus::NotConverged);
        }
        if fit.variance > MAX_UNEXPLAINED * fit.signal
            || fit.gain < GAIN_RANGE.0
            || fit.gain > GAIN_RANGE.1
        {
            return Err(PointStatus::HighResidual);
        }
        let [xx, xy, yy] = fit.covariance;
        let worst = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        if worst > MAX_DEVIATION * MAX_DEVIATION {
            return Err(PointStatus::LowTexture);
        }
        Ok(())
    }
}

impl Fit {
    fn new(template: &Template, rest: &FinalStep, normal: &Normal) -> Self {
        let step = normal.step(&rest.sums);
        let variance = normal.variance(normal.left(&rest.sums));
        let samples = Samples {
            prev: template.corner(),
            next: Some(rest.corner),
            spacing: 1.0,
        };
        let own = variance / (1.0 + step.gain * step.gain);
        let spread = noise_gain(&template.gradients(), template.window, &samples, own);
        Self {
            displacement: rest.after(&step),
            variance,
            signal: normal.signal(&step),
            covariance: normal
                .unit_covariance(&step)
                .map(|entry| entry * spread * variance),
            gain: step.gain,
        }
    }
}
