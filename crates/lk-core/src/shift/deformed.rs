//! The displacement of a window that may deform, and whether to believe it.

use super::affine::Affine;
use super::gauss_newton::{Found, Problem};
use super::judge::{CONTRADICTION, MAX_SCATTER, beyond, is_light};
use super::matrix::{inverse, quadratic};
use super::result::{Shift, ShiftStatus};
use crate::error::Result;

/// A window that may deform does not go further than this, in pixels, from where one that may not goes.
const ELSEWHERE: f64 = 0.5;

impl Problem<'_> {
    /// The displacement and its gradient, from a displacement without one.
    /// `measured` says whether that is a measurement itself.
    pub(super) fn deformed(
        &mut self,
        start: &Found,
        from: usize,
        limit: [f64; 2],
        measured: bool,
    ) -> Result<Shift> {
        let Some(affine) = self.affine(start, from)? else {
            let status = if start.matches {
                ShiftStatus::NotConverged
            } else {
                ShiftStatus::NoMatch
            };
            return Ok(Shift::invalid(status));
        };
        let displacement = [affine.motion[0], affine.motion[1]];
        let gain = (1.0 + affine.alpha / 2.0) / (1.0 - affine.alpha / 2.0);
        let largest = affine.covariance[0][0].max(affine.covariance[1][1]).sqrt();
        let status = if !(start.matches || affine.matches())
            || !is_light(gain)
            || beyond(displacement, limit)
        {
            ShiftStatus::NoMatch
        } else if largest.is_nan() || largest >= MAX_SCATTER[1] {
            ShiftStatus::NoTexture
        } else if !affine.steady || (measured && is_elsewhere(start, &affine)) {
            ShiftStatus::NotConverged
        } else {
            ShiftStatus::Valid
        };
        if status != ShiftStatus::Valid {
            return Ok(Shift::invalid(status));
        }
        let normalization = self.inputs.normalization;
        let offset = affine.beta / (1.0 - affine.alpha / 2.0);
        Ok(Shift {
            dx: displacement[0],
            dy: displacement[1],
            covariance: std::array::from_fn(|i| std::array::from_fn(|j| affine.covariance[i][j])),
            direction: [f64::NAN; 2],
            direction_variance: f64::INFINITY,
            gradient: affine.gradient(),
            joint_covariance: affine.covariance,
            gain,
            offset: offset / normalization.scale + normalization.mean * (1.0 - gain),
            residual: affine.residual / normalization.scale,
            status,
        })
    }
}

/// Whether a window that may deform went somewhere else than one that may not was measured to go.
fn is_elsewhere(start: &Found, affine: &Affine) -> bool {
    let apart = [0, 1].map(|axis| affine.motion[axis] - start.displacement[axis]);
    let without = start.covariance();
    let sum =
        std::array::from_fn(|i| std::array::from_fn(|j| without[i][j] + affine.covariance[i][j]));
    let distance = inverse(sum).map_or(f64::INFINITY, |inverse| quadratic(inverse, apart));
    apart[0].hypot(apart[1]) > ELSEWHERE && distance > CONTRADICTION
}
