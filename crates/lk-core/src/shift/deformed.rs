//! The displacement of a window that may deform, and whether to believe it.

use super::affine::Affine;
use super::gauss_newton::{Found, Problem};
use super::judge::{CONTRADICTION, MAX_SCATTER, beyond, is_light};
use super::matrix::{eigenvalues, inverse, quadratic};
use super::result::{Shift, ShiftStatus};

/// A window that may deform does not go further than this, in pixels, from where one that may not goes.
const ELSEWHERE: f64 = 0.5;
/// A window deforms where a displacement that varies leaves less than this share of what one that does not leaves, as
/// root mean square.
const EXPLAINS_MORE: f64 = 0.9;
/// Where its parts contradict each other by no more than this, in variance over noise, it is the motion of all of them.
const CONSISTENT: f64 = 3.0;

impl Problem<'_> {
    /// The displacement and its gradient, which a displacement without one led to.
    /// `measured` says whether that is a measurement itself.
    pub(super) fn deformed(
        &self,
        start: &Found,
        affine: Option<Affine>,
        limit: [f64; 2],
        measured: bool,
    ) -> Shift {
        let Some(affine) = affine else {
            let status = if start.matches {
                ShiftStatus::NotConverged
            } else {
                ShiftStatus::NoMatch
            };
            return Shift::invalid(status);
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
            return Shift::invalid(status);
        }
        let normalization = self.inputs.normalization;
        let offset = affine.beta / (1.0 - affine.alpha / 2.0);
        Shift {
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
        }
    }
}

/// How far a displacement without a gradient is from that of the window's centre; `None` unless a displacement that
/// varies linearly explains the frames better, though it has one light and one weight for the whole window.
///
/// The weights of a window that deforms settle on a part that moves alike, and what the rest says weighs next to nothing.
pub(super) fn off_by_deforming(rigid: &Found, affine: &Affine) -> Option<[f64; 2]> {
    let explains = affine.residual < EXPLAINS_MORE * rigid.solution.residual;
    (affine.steady && affine.matches() && explains)
        .then(|| [0, 1].map(|axis| affine.motion[axis] - rigid.displacement[axis]))
}

/// Whether a displacement that varies linearly over the window is what its parts contradict each other by: it explains more,
/// leaves little contradiction, and tells the displacement of the centre far better.
pub(super) fn accounts_for(rigid: &Found, affine: &Affine) -> bool {
    let [_, doubt] = eigenvalues(rigid.covariance());
    let largest = affine.covariance[0][0].max(affine.covariance[1][1]);
    affine.steady
        && affine.matches()
        && affine.excess <= CONSISTENT
        && affine.residual < EXPLAINS_MORE * rigid.solution.residual
        && largest < doubt / 4.0
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
