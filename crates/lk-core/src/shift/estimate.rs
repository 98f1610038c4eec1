//! The displacement from the best of the starts, and whether to believe it.

use super::follow::{Found, follow};
use super::scratch::Scratch;
use super::solve::eigenvalues;
use super::start::{Starts, best_start};
use super::unit::Unit;
use super::{Shift, ShiftOptions, ShiftStatus};
use crate::error::Result;

/// A standard deviation by noise above this is no measurement, in pixels.
const MAX_SIGMA: f64 = 0.2;
/// The same where the tiles contradict each other: there is no one displacement.
const MAX_SCATTER: f64 = 0.25;
/// Gains beyond this, or below its inverse, are not light: one of the frames is blank.
const MAX_GAIN: f64 = 16.0;
/// Displacements further apart than this, in pixels, are two.
const APART: f64 = 1.0;
/// What a displacement leaves unexplained, as a share of the texture: one explains the frames as well as another where
/// its share is within this factor, or where it is below [`NOTHING`].
const AS_WELL: f64 = 1.3;
/// Rounding to whole grey levels leaves this much.
const NOTHING: f64 = 1e-4;
/// A rival is the better start where it leaves less by this factor, on no fewer pixels than [`ENOUGH`] of the other's:
/// a small overlap may have been spared a shadow.
const BETTER: f64 = 16.0;
const ENOUGH: f64 = 0.8;
/// On more pixels, this much left may be such a shadow.
const LITTLE: f64 = 0.2;

impl Scratch {
    /// The displacement between the frames that were taken.
    pub(super) fn estimate(&mut self, limit: [f64; 2], options: &ShiftOptions) -> Result<Shift> {
        let Self {
            inputs,
            start: search,
            workspace,
        } = self;
        let inputs = &*inputs;
        let mut starts: Option<Starts> = None;
        let mut from = inputs.levels;
        for level in (0..=inputs.levels).rev() {
            // The finer levels are for texture that the coarse ones do not show.
            let scale = f64::from(1u32 << level);
            let limit = limit.map(|value| (value / scale).ceil());
            let found = best_start(inputs.pair(level), limit, search, &options.execution)?;
            let Some(found) = found else { continue };
            let convinces = found.best.convinces();
            if starts
                .as_ref()
                .is_none_or(|starts| found.best.better_than(&starts.best))
            {
                starts = Some(found);
                from = level;
            }
            if convinces {
                break;
            }
        }
        let Some(starts) = starts else {
            return Ok(Shift::invalid(ShiftStatus::TooLittleOverlap));
        };
        let best = starts.best.displacement;
        let mut best = match follow(inputs, from, best, workspace, options)? {
            Ok(found) => found,
            Err(status) => return Ok(Shift::invalid(status)),
        };
        // A pattern that repeats agrees at several starts; what tells them apart shows at the finest level, if anything.
        let mut ambiguous = false;
        for rival in starts.rivals {
            let Ok(rival) = follow(inputs, from, rival, workspace, options)? else {
                continue;
            };
            let [dx, dy] = [0, 1].map(|axis| rival.displacement[axis] - best.displacement[axis]);
            if dx.hypot(dy) <= APART || !rival.matches || beyond(rival.displacement, limit) {
                continue;
            }
            let left = |found: &Found| (1.0 - found.solution.correlation).max(NOTHING);
            let count = |found: &Found| found.solution.count;
            if left(&best) > BETTER * left(&rival) && count(&rival) > ENOUGH * count(&best) {
                (best, ambiguous) = (rival, false);
            } else {
                let spared = count(&best) < ENOUGH * count(&rival) && left(&rival) < LITTLE;
                ambiguous |= left(&rival) < AS_WELL * left(&best) || spared;
            }
        }
        Ok(judge(inputs.unit, &best, limit, ambiguous))
    }
}

/// Whether a displacement is longer than what was asked for.
fn beyond(displacement: [f64; 2], limit: [f64; 2]) -> bool {
    (0..2).any(|axis| displacement[axis].abs() > limit[axis] + 1.0)
}

fn judge(unit: Unit, found: &Found, limit: [f64; 2], ambiguous: bool) -> Shift {
    let Found {
        displacement,
        solution,
        gain: field,
        ..
    } = found;
    let total = eigenvalues(solution.covariance);
    let variance = total.map(|value| value / solution.excess);
    let alpha = solution.alpha + field.0[0];
    let gain = (1.0 + alpha / 2.0) / (1.0 - alpha / 2.0);
    let is_light = (1.0 / MAX_GAIN..=MAX_GAIN).contains(&gain);
    let [low, high] = solution.information;
    let limit_sigma = MAX_SIGMA * MAX_SIGMA;
    // A window that shows structure in one direction agrees everywhere along it.
    let slides = ambiguous || !found.steady;
    let status = if !found.matches || !is_light || high <= 0.05 {
        if solution.is_noise() || !is_light {
            ShiftStatus::NoTexture
        } else {
            ShiftStatus::NoMatch
        }
    } else if low <= 0.05 || low <= 1e-4 * high || (slides && low <= 1e-2 * high) {
        ShiftStatus::Aperture
    } else if variance[1].is_nan() || variance[1] > limit_sigma {
        if variance[0] < 0.04 * variance[1] {
            ShiftStatus::Aperture
        } else {
            ShiftStatus::NoTexture
        }
    } else if beyond(*displacement, limit) || total[1] > MAX_SCATTER * MAX_SCATTER {
        ShiftStatus::NoMatch
    } else if ambiguous {
        ShiftStatus::Ambiguous
    } else if !found.steady {
        ShiftStatus::NotConverged
    } else {
        ShiftStatus::Valid
    };
    if status != ShiftStatus::Valid {
        return Shift::invalid(status);
    }
    let offset = solution.beta / (1.0 - alpha / 2.0);
    Shift {
        dx: displacement[0],
        dy: displacement[1],
        covariance: solution.covariance,
        gain,
        offset: offset / unit.scale + unit.mean * (1.0 - gain),
        residual: solution.residual / unit.scale,
        status,
    }
}
