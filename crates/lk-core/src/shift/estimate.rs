//! From the start at a coarse level down to the displacement, and whether to believe it.

use super::refine::{GainField, Look, REACH, gain_field, look};
use super::scratch::Scratch;
use super::solve::{Solution, eigenvalues};
use super::start::{Start, best_start};
use super::unit::Unit;
use super::{Shift, ShiftOptions, ShiftStatus};
use crate::error::Result;

/// A standard deviation above this is no measurement, in pixels.
const MAX_SIGMA: f64 = 0.2;
/// Gains beyond this, or below its inverse, are not light: one of the frames is blank.
const MAX_GAIN: f64 = 16.0;
/// Side of a tile at a coarse level, in its pixels.
const COARSE_TILE: usize = 8;
/// A step above this, in pixels, changes what the tiles say about the gain.
const GAIN_SETTLED: f64 = 2e-3;
/// The gain is fitted at most so often at a level: then it stands, so that the displacement can settle.
const GAIN_FITS: usize = 2;
/// After so many looks tiles are no longer merged anew, so that the displacement can settle.
const FREE_LOOKS: usize = 5;
/// The iteration has settled once a step is below this, in pixels.
const SETTLED: f64 = 1e-4;
/// The same at a coarse level, in its pixels.
const COARSE_SETTLED: f64 = 0.05;

/// A step, made longer or shorter by what the one before it left, and the share of it that the next would be: the
/// gradients are not exact, but their error is the same in each step.
fn extrapolated(step: [f64; 2], before: Option<[f64; 2]>) -> ([f64; 2], f64) {
    let square = before.map_or(0.0, |before| before[0] * before[0] + before[1] * before[1]);
    let Some(before) = before.filter(|_| square > 0.0) else {
        return (step, 1.0);
    };
    let along = (step[0] * before[0] + step[1] * before[1]) / square;
    let left = along.clamp(-0.3, 0.3);
    let ratio = (step[0].hypot(step[1]) / square.sqrt()).min(1.0);
    (step.map(|value| value / (1.0 - left)), 0.3 * ratio)
}

impl Scratch {
    /// The displacement between the frames that were taken.
    pub(super) fn estimate(&mut self, limit: [f64; 2], options: &ShiftOptions) -> Result<Shift> {
        let Self {
            inputs,
            start: search,
            workspace,
        } = self;
        let inputs = &*inputs;
        let mut start: Option<Start> = None;
        let mut from = inputs.levels;
        for level in (0..=inputs.levels).rev() {
            // The finer levels are for texture that the coarse ones do not show.
            let scale = f64::from(1u32 << level);
            let limit = limit.map(|value| (value / scale).ceil());
            if let Some(found) = best_start(inputs.pair(level), limit, search, &options.execution)?
            {
                if start.is_none_or(|best| found.better_than(&best)) {
                    start = Some(found);
                    from = level;
                }
                if found.convinces() {
                    break;
                }
            }
        }
        let Some(start) = start else {
            return Ok(Shift::invalid(ShiftStatus::TooLittleOverlap));
        };
        let mut displacement = start.displacement.map(|value| value as f64);
        let mut match_found = false;
        let mut gain = GainField::default();
        for level in (0..=from).rev() {
            if level != from && level != 0 {
                displacement = displacement.map(|value| 2.0 * value);
                continue;
            }
            let finest = level == 0;
            let mut whole = displacement.map(f64::round);
            let mut before: Option<[f64; 2]> = None;
            let mut steady = false;
            let mut fits = 0;
            let mut last = None;
            for index in 0..if finest { 20 } else { 6 } {
                for (whole, exact) in whole.iter_mut().zip(displacement) {
                    if (exact - *whole).abs() > REACH {
                        *whole = exact.round();
                        before = None;
                    }
                }
                let how = Look {
                    displacement,
                    whole,
                    illumination: options.illumination,
                    gain,
                    tile: if finest { inputs.tile } else { COARSE_TILE },
                    hold: index >= FREE_LOOKS,
                };
                let Some(solution) = look(inputs.pair(level), how, workspace, &options.execution)?
                else {
                    return Ok(Shift::invalid(ShiftStatus::TooLittleOverlap));
                };
                let (step, left) = extrapolated(solution.step, before);
                let length = step[0].hypot(step[1]);
                let damp = if length > 1.0 { 1.0 / length } else { 1.0 };
                for (value, step) in displacement.iter_mut().zip(step) {
                    *value += damp * step;
                }
                steady = length * left < if finest { SETTLED } else { COARSE_SETTLED };
                last = Some((solution, gain));
                if length < 0.2 && fits < GAIN_FITS && (fits == 0 || length > GAIN_SETTLED) {
                    fits += 1;
                    gain = gain_field(inputs.pair(level), how, workspace);
                }
                before = (length < 0.2).then_some(solution.step);
                if steady {
                    break;
                }
            }
            let Some((solution, gain)) = last else {
                return Ok(Shift::invalid(ShiftStatus::NotConverged));
            };
            if level == from {
                match_found = solution.matches();
            }
            if finest {
                return Ok(judge(
                    inputs.unit,
                    displacement,
                    limit,
                    match_found,
                    steady,
                    &solution,
                    gain,
                ));
            }
            displacement = displacement.map(|value| 2.0 * value);
        }
        Ok(Shift::invalid(ShiftStatus::NotConverged))
    }
}

fn judge(
    unit: Unit,
    displacement: [f64; 2],
    limit: [f64; 2],
    match_found: bool,
    steady: bool,
    solution: &Solution,
    field: GainField,
) -> Shift {
    let variance = eigenvalues(solution.covariance);
    let alpha = solution.alpha + field.0[0];
    let gain = (1.0 + alpha / 2.0) / (1.0 - alpha / 2.0);
    let is_light = (1.0 / MAX_GAIN..=MAX_GAIN).contains(&gain);
    let [low, high] = solution.information;
    let limit_sigma = MAX_SIGMA * MAX_SIGMA;
    let status = if !match_found || !is_light || high <= 0.05 {
        if solution.is_noise() || !is_light {
            ShiftStatus::NoTexture
        } else {
            ShiftStatus::NoMatch
        }
    } else if low <= 0.05 || low <= 1e-4 * high {
        ShiftStatus::Aperture
    } else if variance[1].is_nan() || variance[1] > limit_sigma {
        if variance[0] < 0.04 * variance[1] {
            ShiftStatus::Aperture
        } else {
            ShiftStatus::NoTexture
        }
    } else if (0..2).any(|axis| displacement[axis].abs() > limit[axis] + 1.0) {
        ShiftStatus::NoMatch
    } else if !steady {
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
