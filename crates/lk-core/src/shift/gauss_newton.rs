//! From one start at a coarse level down to the displacement.
//!
//! `docs/explanation/algorithms.md`, section "Gauss-Newton".

use super::affine;
use super::evaluate::{Workspace, evaluate, gain_field, gain_ramp, is_one_light};
use super::inputs::Inputs;
use super::matrix::{Matrix, eigenvalues};
use super::model::LightScope;
use super::options::ShiftOptions;
use super::result::ShiftStatus;
use super::robust_covariance::SETTLED;
use super::solution::Solution;
use super::view::{Evaluation, GainField, REACH};
use crate::error::Result;

/// Side of a tile at a coarse level, in its pixels.
const COARSE_TILE: usize = 8;
/// A step above this, in pixels, changes what the tiles say about the gain.
const GAIN_SETTLED: f64 = 2e-3;
/// Below a step of this, in pixels, what is left of the differences tells whether one light holds for the window.
const LIGHT_TOLD: f64 = 0.02;
/// Below a step of this, in pixels, what is left of the differences tells how the gain varies,
const RAMP_TOLD: f64 = 0.2;
/// which is asked so often.
const RAMP_FITS: usize = 3;
/// One light for the window that explains the frames this well, as a correlation, has found what they have in common.
pub(super) const COMMON_STRUCTURE: f64 = 0.9;
/// The gain is fitted at most so often at a level: then it stands, so that the displacement can settle.
const GAIN_FITS: usize = 2;
/// After so many evaluations tiles are no longer merged anew, so that the displacement can settle.
const FREE_MERGES: usize = 5;
/// So it has below this share of its standard deviation, which counts for no more than [`MAX_DEVIATION`].
const SETTLED_SHARE: f64 = 0.02;
const MAX_DEVIATION: f64 = 0.1;
/// The same at a coarse level, in its pixels.
const COARSE_SETTLED: f64 = 0.05;

/// Where to begin at one level.
#[derive(Debug, Clone, Copy)]
pub(super) struct Guess {
    pub(super) level: usize,
    /// In pixels of the level.
    pub(super) displacement: [f64; 2],
    /// What is known of the light.
    pub(super) gain: GainField,
    /// [`LightScope::Window`] or [`LightScope::Tiles`].
    pub(super) scope: LightScope,
    /// Whether what either frame shows is known to be in both.
    pub(super) common_structure: bool,
    /// The only direction in which to move.
    pub(super) direction: Option<[f64; 2]>,
    /// Whether to go on where one light for the window turns out not to hold.
    pub(super) to_the_end: bool,
}

/// Where the iteration ended at one level.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub(super) displacement: [f64; 2],
    /// Of the last evaluation.
    pub(super) solution: Solution,
    /// What the last evaluation took out.
    pub(super) gain: GainField,
    pub(super) scope: LightScope,
    /// Whether the frames matched by more than chance, at this level or at that of the start.
    pub(super) matches: bool,
    /// Whether the iteration settled.
    pub(super) steady: bool,
    /// Whether one model of the light was found to hold for the whole window.
    pub(super) one_light: bool,
    /// Covariance of what the light models, which contradict each other, may have done to the displacement.
    pub(super) systematic: Matrix,
}

impl Found {
    /// Whether this tells more than what was found with another model of the light.
    pub(super) fn is_surer_than(&self, other: &Self) -> bool {
        let largest = |found: &Self| eigenvalues(found.solution.covariance)[1];
        let (own, others) = (largest(self), largest(other));
        self.matches && !(other.steady && other.matches && (others <= own || own.is_nan()))
    }

    /// Covariance of the displacement.
    pub(super) fn covariance(&self) -> Matrix {
        let noise = self.solution.covariance;
        std::array::from_fn(|i| std::array::from_fn(|j| noise[i][j] + self.systematic[i][j]))
    }

    /// Add to the covariance what noise does not explain.
    pub(super) fn add(&mut self, covariance: Matrix) {
        for (to, from) in (self.systematic.iter_mut().flatten()).zip(covariance.iter().flatten()) {
            *to += from;
        }
    }

    /// Begin where this ended, with another model of the light.
    pub(super) fn guess(&self, scope: LightScope) -> Guess {
        Guess {
            level: 0,
            displacement: self.displacement,
            gain: self.gain,
            scope,
            common_structure: self.solution.correlation > COMMON_STRUCTURE,
            direction: None,
            to_the_end: false,
        }
    }
}

/// What the iteration works on.
#[derive(Debug)]
pub(super) struct Problem<'a> {
    pub(super) inputs: &'a Inputs,
    pub(super) workspace: &'a mut Workspace,
    pub(super) clusters: &'a mut affine::Workspace,
    pub(super) options: &'a ShiftOptions,
}

impl Problem<'_> {
    /// Follow a start down to the finest level; what stopped it, if it was stopped.
    pub(super) fn descend(
        &mut self,
        mut guess: Guess,
    ) -> Result<std::result::Result<Found, ShiftStatus>> {
        let from = guess.level;
        // The levels between change little: what the coarse one leaves, the finest one finds as well.
        if from > 0 {
            let coarse = match self.gauss_newton(guess)? {
                Ok(coarse) => coarse,
                Err(status) => return Ok(Err(status)),
            };
            guess = Guess {
                level: 0,
                displacement: (coarse.displacement).map(|value| f64::from(1u32 << from) * value),
                gain: coarse.gain,
                ..guess
            };
            return Ok(self.gauss_newton(guess)?.map(|found| Found {
                matches: (coarse.matches && found.solution.holds())
                    || found.solution.matches_finely(),
                ..found
            }));
        }
        self.gauss_newton(guess)
    }

    /// How well the frames correlate at what was found, with one light for the window.
    pub(super) fn window_correlation(&mut self, found: &Found) -> Result<Option<f64>> {
        let params = Evaluation {
            displacement: found.displacement,
            whole: found.displacement.map(f64::round),
            scope: LightScope::Window,
            ..self.evaluation(0, GainField::default())
        };
        let execution = &self.options.execution;
        let solution = evaluate(self.inputs.pair(0), params, self.workspace, execution)?;
        Ok(solution.map(|solution| solution.correlation))
    }

    /// An evaluation of a level, of which the displacement is not set yet.
    pub(super) fn evaluation(&self, level: usize, gain: GainField) -> Evaluation {
        Evaluation {
            displacement: [0.0; 2],
            whole: [0.0; 2],
            illumination: self.options.illumination,
            gain,
            tile: if level == 0 {
                self.inputs.tile
            } else {
                COARSE_TILE
            },
            borders: true,
            rounding: self.inputs.normalization.rounding / f64::from(1u32 << (2 * level)),
            scope: LightScope::Tiles,
            common_structure: false,
        }
    }

    /// Gauss-Newton iteration at one level.
    pub(super) fn gauss_newton(
        &mut self,
        guess: Guess,
    ) -> Result<std::result::Result<Found, ShiftStatus>> {
        let Guess {
            level,
            scope,
            direction,
            ..
        } = guess;
        let finest = level == 0;
        let pair = self.inputs.pair(level);
        let mut state = State::new(guess);
        let mut found = None;
        for index in 0..if finest { 20 } else { 6 } {
            state.round();
            let params = Evaluation {
                displacement: state.displacement,
                whole: state.whole,
                scope: if scope == LightScope::Tiles && index >= FREE_MERGES {
                    LightScope::HeldTiles
                } else {
                    scope
                },
                common_structure: guess.common_structure,
                ..self.evaluation(level, state.gain)
            };
            let solution = evaluate(pair, params, self.workspace, &self.options.execution)?;
            let Some(solution) = solution else {
                return Ok(Err(ShiftStatus::TooLittleOverlap));
            };
            let exact = direction.map_or(solution.step, |along| solution.step_along(along));
            let (length, left) = state.go(exact);
            let steady = length * left < settled(&solution, finest, direction);
            // Gains of tiles are those of the light where one light nearly holds; elsewhere they may be motion.
            let window = scope == LightScope::Window;
            let one_light = window
                && finest
                && (steady || length < 0.2)
                && is_one_light(pair, params, self.workspace)?;
            found = Some(Found {
                displacement: state.displacement,
                solution,
                gain: state.gain,
                scope,
                matches: solution.matches(),
                steady,
                one_light,
                systematic: [[0.0; 2]; 2],
            });
            let told = window && finest && !one_light && length < LIGHT_TOLD;
            // The light of a window may vary linearly over it, and be one light all the same.
            // Along one direction motion and a gain that varies explain each other: what is known of the light stands.
            let free = direction.is_none();
            if window
                && finest
                && free
                && !one_light
                && length < RAMP_TOLD
                && state.ramps < RAMP_FITS
                && let Some(ramp) = gain_ramp(pair, params, solution.excess, self.workspace)
            {
                state.ramps += 1;
                state.gain = ramp;
                state.before = None;
                continue;
            }
            if steady || (told && !guess.to_the_end) {
                break;
            }
            if free && state.may_fit(length) && (one_light || !window) {
                state.fits += 1;
                state.gain = gain_field(pair, params, self.workspace)?;
            }
        }
        Ok(found.ok_or(ShiftStatus::NotConverged))
    }
}

/// Where the iteration stands.
#[derive(Debug)]
struct State {
    displacement: [f64; 2],
    /// The whole pixels at which the frames are compared.
    whole: [f64; 2],
    gain: GainField,
    /// The step before, if it was short.
    before: Option<[f64; 2]>,
    /// How often the gain was fitted, and how often its variation over the window.
    fits: usize,
    ramps: usize,
}

impl State {
    fn new(guess: Guess) -> Self {
        Self {
            displacement: guess.displacement,
            whole: guess.displacement.map(f64::round),
            gain: guess.gain,
            before: None,
            fits: 0,
            ramps: 0,
        }
    }

    /// Compare at other whole pixels where the displacement has gone too far from those.
    fn round(&mut self) {
        for (whole, exact) in self.whole.iter_mut().zip(self.displacement) {
            if (exact - *whole).abs() > REACH {
                *whole = exact.round();
                self.before = None;
            }
        }
    }

    /// Take a step; its length, made longer or shorter by what the one before left, and the share of it to come.
    fn go(&mut self, exact: [f64; 2]) -> (f64, f64) {
        let (step, left) = extrapolated(exact, self.before);
        let length = step[0].hypot(step[1]);
        let damp = if length > 1.0 { 1.0 / length } else { 1.0 };
        for (value, step) in self.displacement.iter_mut().zip(step) {
            *value += damp * step;
        }
        self.before = (length < 0.2).then_some(exact);
        (length, left)
    }

    /// Whether the gain may be fitted after a step of this length.
    fn may_fit(&self, length: f64) -> bool {
        length < 0.2 && self.fits < GAIN_FITS && (self.fits == 0 || length > GAIN_SETTLED)
    }
}

/// The length of a step below which the iteration has settled.
fn settled(solution: &Solution, finest: bool, direction: Option<[f64; 2]>) -> f64 {
    if !finest {
        return COARSE_SETTLED;
    }
    let [xx, yy] = [0, 1].map(|axis| solution.covariance[axis][axis]);
    let variance = direction.map_or(xx.min(yy), |along| solution.variance_along(along));
    let deviation = variance.max(0.0).sqrt().min(MAX_DEVIATION);
    SETTLED.max(SETTLED_SHARE * deviation)
}

/// A step, made longer or shorter by what the one before it left, and the share of it that the next would be: the
/// gradients are not exact, but their error is the same in each step.
fn extrapolated(step: [f64; 2], before: Option<[f64; 2]>) -> ([f64; 2], f64) {
    let square = before.map_or(0.0, |before| before[0] * before[0] + before[1] * before[1]);
    let Some(before) = before.filter(|_| square > 0.0) else {
        return (step, 1.0);
    };
    let along = (step[0] * before[0] + step[1] * before[1]) / square;
    let left = along.clamp(-0.3, 0.6);
    let ratio = (step[0].hypot(step[1]) / square.sqrt()).min(1.0);
    (step.map(|value| value / (1.0 - left)), 0.3 * ratio)
}
