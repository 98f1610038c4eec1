//! Whether to believe a displacement, and what a caller gets of it.
//!
//! `docs/explanation/algorithms.md`, section "Status of a shift".

use super::gauss_newton::Found;
use super::matrix::eigenvalues;
use super::normalization::Normalization;
use super::result::{Shift, ShiftStatus, without_gradient};

/// A standard deviation by noise above this is no measurement, in pixels; the second where the frames match at the
/// finest level too.
const MAX_SIGMA: [f64; 2] = [0.2, 0.5];
/// The same where the tiles contradict each other: there is no one displacement.
pub(super) const MAX_SCATTER: [f64; 2] = [0.25, 0.5];
/// Less information than this, in units of what noise adds to it, is none.
const LEAST_INFORMATION: f64 = 0.05;
/// Where one direction is known this much better than the other, in variance, and that is known no better than this, in
/// pixels, it is an edge: what its roughness and the noise seem to tell along it cannot be trusted.
const EDGE_RATIO: f64 = 0.01;
const EDGE_SIGMA: f64 = 0.03;
/// Less information than this share of that across is that of an edge even without noise: the filters turn the
/// gradients of one direction by up to a few hundredths.
pub(super) const EDGE_INFORMATION: f64 = 3e-3;
/// One light for the window that correlates like this explains next to everything: what it leaves are edges that are too
/// sharp for the samples.
pub(super) const EXPLAINED: f64 = 0.999;
/// Displacements with one light for the window and with one for each part of it contradict each other above this square
/// of their distance in deviations: one in 370 by chance.
pub(super) const CONTRADICTION: f64 = 11.8;
/// Gains beyond this, or below its inverse, are not light: one of the frames is blank.
const MAX_GAIN: f64 = 16.0;
/// What a displacement leaves unexplained, as a share of the texture: one explains the frames as well as another where
/// its share is within this factor, or where it is what rounding to whole grey levels leaves.
pub(super) const AMBIGUITY_RATIO: f64 = 1.3;

/// Whether a displacement is longer than what was asked for.
pub(super) fn beyond(displacement: [f64; 2], limit: [f64; 2]) -> bool {
    (0..2).any(|axis| displacement[axis].abs() > limit[axis] + 1.0)
}

/// Whether the displacement was measured, and if not, why.
pub(super) fn judge(found: &Found, limit: [f64; 2], ambiguous: bool) -> ShiftStatus {
    let solution = &found.solution;
    let total = eigenvalues(found.covariance());
    let variance = eigenvalues(solution.covariance).map(|value| value / solution.excess);
    let is_light = is_light(gain(found));
    let [low, high] = solution.information;
    // What noise adds to the gradients is known to about one over the root of the pixels.
    let chance = LEAST_INFORMATION.max(6.0 / solution.count.sqrt());
    let fine = solution.matches_finely();
    let limit_sigma = MAX_SIGMA[usize::from(fine)].powi(2);
    let limit_scatter = MAX_SCATTER[usize::from(fine)].powi(2);
    // A window that shows structure in one direction agrees everywhere along it.
    let slides = ambiguous || !found.steady;
    if !found.matches || !is_light || high <= LEAST_INFORMATION {
        if solution.is_noise() || !is_light {
            ShiftStatus::NoTexture
        } else {
            ShiftStatus::NoMatch
        }
    } else if low <= chance
        || (variance[1] > EDGE_SIGMA * EDGE_SIGMA && variance[0] < EDGE_RATIO * variance[1])
        || low <= EDGE_INFORMATION * high
        || (slides && low <= 1e-2 * high)
    {
        ShiftStatus::Aperture
    } else if variance[1].is_nan() || variance[1] > limit_sigma {
        if variance[0] < 0.04 * variance[1] {
            ShiftStatus::Aperture
        } else {
            ShiftStatus::NoTexture
        }
    } else if beyond(found.displacement, limit) || total[1] > limit_scatter {
        ShiftStatus::NoMatch
    } else if ambiguous {
        ShiftStatus::Ambiguous
    } else if !found.steady {
        ShiftStatus::NotConverged
    } else {
        ShiftStatus::Valid
    }
}

/// Whether a gain is that of light.
pub(super) fn is_light(gain: f64) -> bool {
    (1.0 / MAX_GAIN..=MAX_GAIN).contains(&gain)
}

/// The symmetric gain, with what was taken out before the last evaluation.
fn alpha(found: &Found) -> f64 {
    found.solution.alpha + found.gain.0[0]
}

fn gain(found: &Found) -> f64 {
    (1.0 + alpha(found) / 2.0) / (1.0 - alpha(found) / 2.0)
}

/// What was found, in the frames' grey levels.
pub(super) fn measured(normalization: Normalization, found: &Found, status: ShiftStatus) -> Shift {
    let solution = &found.solution;
    let offset = solution.beta / (1.0 - alpha(found) / 2.0);
    let gain = gain(found);
    Shift {
        dx: found.displacement[0],
        dy: found.displacement[1],
        covariance: found.covariance(),
        direction: [f64::NAN; 2],
        direction_variance: f64::INFINITY,
        gradient: [[0.0; 2]; 2],
        joint_covariance: without_gradient(found.covariance()),
        gain,
        offset: offset / normalization.scale + normalization.mean * (1.0 - gain),
        residual: solution.residual / normalization.scale,
        status,
    }
}
