//! From one start at a coarse level down to the displacement.

use super::inputs::Inputs;
use super::refine::{GainField, Look, REACH, Workspace, gain_field, look};
use super::solve::Solution;
use super::{ShiftOptions, ShiftStatus};
use crate::error::Result;

/// Side of a tile at a coarse level, in its pixels.
const COARSE_TILE: usize = 8;
/// A step above this, in pixels, changes what the tiles say about the gain.
const GAIN_SETTLED: f64 = 2e-3;
/// The gain is fitted at most so often at a level: then it stands, so that the displacement can settle.
const GAIN_FITS: usize = 2;
/// After so many looks tiles are no longer merged anew, so that the displacement can settle.
const FREE_LOOKS: usize = 5;
/// The iteration has settled once a step is below this, in pixels.
pub(super) const SETTLED: f64 = 1e-4;
/// The same at a coarse level, in its pixels.
const COARSE_SETTLED: f64 = 0.05;

/// What a start led to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub(super) displacement: [f64; 2],
    /// Of the last look.
    pub(super) solution: Solution,
    /// What the last look took out.
    pub(super) gain: GainField,
    /// Whether the frames matched at the level of the start, by more than chance.
    pub(super) matches: bool,
    /// Whether the iteration settled.
    pub(super) steady: bool,
}

/// Follow a start, in pixels of level `from`, down to the finest level; what stopped it, if it was stopped.
pub(super) fn follow(
    inputs: &Inputs,
    from: usize,
    start: [isize; 2],
    workspace: &mut Workspace,
    options: &ShiftOptions,
) -> Result<std::result::Result<Found, ShiftStatus>> {
    let mut displacement = start.map(|value| value as f64);
    let mut matches = false;
    let mut gain = GainField::default();
    // The levels between change little: what the coarse one leaves, the finest one finds as well.
    for level in [from, 0].into_iter().skip(usize::from(from == 0)) {
        let finest = level == 0;
        if finest {
            displacement = displacement.map(|value| f64::from(1u32 << from) * value);
        }
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
            let pair = inputs.pair(level);
            let Some(solution) = look(pair, how, workspace, &options.execution)? else {
                return Ok(Err(ShiftStatus::TooLittleOverlap));
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
                gain = gain_field(pair, how, workspace)?;
            }
            before = (length < 0.2).then_some(solution.step);
            if steady {
                break;
            }
        }
        let Some((solution, gain)) = last else {
            break;
        };
        if level == from {
            matches = solution.matches();
        }
        if finest {
            return Ok(Ok(Found {
                displacement,
                solution,
                gain,
                matches,
                steady,
            }));
        }
    }
    Ok(Err(ShiftStatus::NotConverged))
}

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
