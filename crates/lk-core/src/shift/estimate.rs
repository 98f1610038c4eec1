//! The displacement from the best of the starts, and whether to believe it.

use super::affine::Affine;
use super::evaluate::GainField;
use super::gauss_newton::{COMMON_STRUCTURE, Found, Guess, Problem};
use super::matrix::{eigenvalues, inverse, largest_direction, quadratic};
use super::normalization::Normalization;
use super::solve::LightScope;
use super::start::{Starts, best_start, repeats_along};
use super::workspace::Workspace;
use super::{Shift, ShiftDeformation, ShiftOptions, ShiftStatus};
use crate::error::Result;

/// A standard deviation by noise above this is no measurement, in pixels; the second where the frames match at the
/// finest level too.
const MAX_SIGMA: [f64; 2] = [0.2, 0.5];
/// The same where the tiles contradict each other: there is no one displacement.
const MAX_SCATTER: [f64; 2] = [0.25, 0.5];
/// Less information than this, in units of what noise adds to it, is none.
const LEAST_INFORMATION: f64 = 0.05;
/// Where one direction is known this much better than the other, in variance, and that is known no better than this, in
/// pixels, it is an edge: what its roughness and the noise seem to tell along it cannot be trusted.
const EDGE_RATIO: f64 = 0.01;
const EDGE_SIGMA: f64 = 0.03;
/// Less information than this share of that across is that of an edge even without noise: the filters turn the
/// gradients of one direction by up to a few hundredths.
const EDGE_INFORMATION: f64 = 3e-3;
/// Below this share the border of the window, where gradients are not whole, may be what tells it.
const THIN_INFORMATION: f64 = 0.1;
/// One light for the window that correlates like this explains next to everything: what it leaves are edges that are too
/// sharp for the samples.
pub(super) const EXPLAINED: f64 = 0.999;
/// Displacements with one light for the window and with one for each part of it contradict each other above this square
/// of their distance in deviations: one in 370 by chance.
const CONTRADICTION: f64 = 11.8;
/// A window that may deform does not go further than this, in pixels, from where one that may not goes.
const ELSEWHERE: f64 = 0.5;
/// Gains beyond this, or below its inverse, are not light: one of the frames is blank.
const MAX_GAIN: f64 = 16.0;
/// Displacements further apart than this, in pixels, are two.
const MIN_SEPARATION: f64 = 1.0;
/// What a displacement leaves unexplained, as a share of the texture: one explains the frames as well as another where
/// its share is within this factor, or where it is below [`ROUNDING_SHARE`].
pub(super) const AMBIGUITY_RATIO: f64 = 1.3;
/// Rounding to whole grey levels leaves this much.
const ROUNDING_SHARE: f64 = 1e-4;
/// A rival is the better start where it leaves less by this factor, on no fewer pixels than [`COMPARABLE_OVERLAP`] of the other's:
/// a small overlap may have been spared a shadow.
const RIVAL_RATIO: f64 = 16.0;
const COMPARABLE_OVERLAP: f64 = 0.8;
/// On more pixels, this much left may be such a shadow.
const SHADOW_SHARE: f64 = 0.2;

impl Workspace {
    /// The displacement between the frames that were taken.
    pub(super) fn estimate(&mut self, limit: [f64; 2], options: &ShiftOptions) -> Result<Shift> {
        let Self {
            inputs,
            start: search,
            evaluation,
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
            let is_convincing = found.best.is_convincing();
            if starts
                .as_ref()
                .is_none_or(|starts| found.best.better_than(&starts.best))
            {
                starts = Some(found);
                from = level;
            }
            if is_convincing {
                break;
            }
        }
        let Some(starts) = starts else {
            return Ok(Shift::invalid(ShiftStatus::TooLittleOverlap));
        };
        let mut problem = Problem {
            inputs,
            workspace: evaluation,
            options,
        };
        let guess = |start: [isize; 2], scope| Guess {
            level: from,
            displacement: start.map(|value| value as f64),
            gain: GainField::default(),
            scope,
            common_structure: false,
            direction: None,
            to_the_end: false,
        };
        let mut best =
            match problem.simplest_light(|scope| guess(starts.best.displacement, scope))? {
                Ok(found) => found,
                Err(status) => return Ok(Shift::invalid(status)),
            };
        // A pattern that repeats agrees at several starts; what tells them apart shows at the finest level, if anything.
        let mut ambiguous = false;
        for rival in starts.rivals {
            let Ok(rival) = problem.descend(guess(rival, best.scope))? else {
                continue;
            };
            let [dx, dy] = [0, 1].map(|axis| rival.displacement[axis] - best.displacement[axis]);
            if dx.hypot(dy) <= MIN_SEPARATION || !rival.matches || beyond(rival.displacement, limit)
            {
                continue;
            }
            let left = |found: &Found| (1.0 - found.solution.correlation).max(ROUNDING_SHARE);
            let count = |found: &Found| found.solution.count;
            if left(&best) > RIVAL_RATIO * left(&rival)
                && count(&rival) > COMPARABLE_OVERLAP * count(&best)
            {
                (best, ambiguous) = (rival, false);
            } else {
                // Where the light is free in each part of the window, more displacements explain the frames.
                if left(&rival) < AMBIGUITY_RATIO * left(&best)
                    && best.scope == LightScope::Tiles
                    && let Some(own) = problem.window_correlation(&best)?
                    && let Some(others) = problem.window_correlation(&rival)?
                    && 1.0 - others > AMBIGUITY_RATIO * (1.0 - own).max(ROUNDING_SHARE)
                {
                    continue;
                }
                let spared = count(&best) < COMPARABLE_OVERLAP * count(&rival)
                    && left(&rival) < SHADOW_SHARE;
                ambiguous |= left(&rival) < AMBIGUITY_RATIO * left(&best) || spared;
            }
        }
        let mut status = judge(&best, limit, ambiguous);
        let [low, high] = best.solution.information;
        if status != ShiftStatus::Aperture
            && low <= THIN_INFORMATION * high
            && best.matches
            && let Some(inside) = problem.inside(&best)?
            && let [low, high] = inside.information
            && low <= EDGE_INFORMATION * high
        {
            status = ShiftStatus::Aperture;
        }
        if status == ShiftStatus::Aperture
            && let Some(found) = problem.along_one_direction(&best)?
        {
            let pair = inputs.pair(from);
            let scale = f64::from(1u32 << from);
            let at = found.across / scale;
            let reach = limit.map(|value| (value / scale).ceil());
            let level = options.execution.simd_level();
            if !repeats_along(pair, found.direction, at, reach, search, level)? {
                return Ok(found.shift(inputs.normalization, limit));
            }
        }
        let follows = matches!(
            status,
            ShiftStatus::Valid | ShiftStatus::NoMatch | ShiftStatus::NotConverged
        );
        if follows && options.deformation == ShiftDeformation::Affine {
            return problem.deformed(&best, from, limit, status == ShiftStatus::Valid);
        }
        if status != ShiftStatus::Valid {
            return Ok(Shift::invalid(status));
        }
        best.add(problem.aliasing(&best, None)?);
        Ok(measured(inputs.normalization, &best, status))
    }
}

impl Problem<'_> {
    /// Follow a start with one light for the window, and with one for each part of it where the first does not hold.
    fn simplest_light(
        &mut self,
        start: impl Fn(LightScope) -> Guess,
    ) -> Result<std::result::Result<Found, ShiftStatus>> {
        let window = self.descend(start(LightScope::Window))?;
        let tiles = match window {
            Ok(window) if window.matches => {
                if window.one_light && window.steady {
                    return Ok(Ok(window));
                }
                // The light may have drawn it away from the right displacement, but not far.
                match self.gauss_newton(window.guess(LightScope::Tiles))? {
                    Ok(tiles) if tiles.steady => Ok(Found {
                        matches: true,
                        ..tiles
                    }),
                    _ => self.descend(start(LightScope::Tiles))?,
                }
            }
            _ => self.descend(start(LightScope::Tiles))?,
        };
        let (window, tiles) = match (window, tiles) {
            (Ok(window), Ok(tiles)) => (window, tiles),
            (Ok(window), Err(_)) => return self.settled(window),
            (Err(_), tiles) => return Ok(tiles),
        };
        let Some(apart) = contradiction(&window, &tiles) else {
            let [low, high] = window.solution.information;
            // Within a tile an edge is next to nothing but its own light.
            let edge = low <= THIN_INFORMATION * high && window.solution.correlation > EXPLAINED;
            return if window.solution.correlation < COMMON_STRUCTURE
                || !(edge || window.is_surer_than(&tiles))
            {
                Ok(Ok(tiles))
            } else {
                self.settled(window)
            };
        };
        // One of them is wrong. Where one light explains next to everything it is the tiles, whose light took motion for
        // itself; how far they are apart says how far either may be off.
        let chosen = if window.solution.correlation > EXPLAINED {
            self.settled(window)?
        } else {
            Ok(tiles)
        };
        Ok(chosen.map(|found| Found {
            systematic: apart.map(|a| apart.map(|b| a * b / 4.0)),
            ..found
        }))
    }

    /// What was found with one light for the window, settled.
    fn settled(&mut self, window: Found) -> Result<std::result::Result<Found, ShiftStatus>> {
        if window.steady {
            return Ok(Ok(window));
        }
        let guess = Guess {
            to_the_end: true,
            ..window.guess(LightScope::Window)
        };
        Ok(self.gauss_newton(guess)?.map(|found| Found {
            matches: window.matches,
            ..found
        }))
    }
}

/// How far apart the displacements with one light for the window and with one for each part of it are, if that is more
/// than chance lets expect and both are to be taken seriously (Hausman, "Specification tests in econometrics", 1978).
fn contradiction(window: &Found, tiles: &Found) -> Option<[f64; 2]> {
    if !window.matches || !tiles.steady || window.solution.correlation < COMMON_STRUCTURE {
        return None;
    }
    let apart = [0, 1].map(|axis| tiles.displacement[axis] - window.displacement[axis]);
    let across = largest_direction(window.solution.information_matrix);
    let [low, high] = window.solution.information;
    if low > EDGE_INFORMATION * high {
        let distance = quadratic(inverse(window.solution.covariance)?, apart);
        return (distance > CONTRADICTION).then_some(apart);
    }
    // Of an edge only what lies across it can be compared.
    let length = apart[0] * across[0] + apart[1] * across[1];
    let variance = window.solution.variance_along(across);
    (length * length > CONTRADICTION * variance).then(|| across.map(|value| value * length))
}

impl Problem<'_> {
    /// The displacement and its gradient, from a displacement without one.
    /// `measured` says whether that is a measurement itself.
    fn deformed(
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
            || !(1.0 / MAX_GAIN..=MAX_GAIN).contains(&gain)
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

/// Whether a displacement is longer than what was asked for.
fn beyond(displacement: [f64; 2], limit: [f64; 2]) -> bool {
    (0..2).any(|axis| displacement[axis].abs() > limit[axis] + 1.0)
}

/// Whether the displacement was measured, and if not, why.
fn judge(found: &Found, limit: [f64; 2], ambiguous: bool) -> ShiftStatus {
    let solution = &found.solution;
    let total = eigenvalues(found.covariance());
    let variance = eigenvalues(solution.covariance).map(|value| value / solution.excess);
    let is_light = (1.0 / MAX_GAIN..=MAX_GAIN).contains(&gain(found));
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
        joint_covariance: std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                if i < 2 && j < 2 {
                    found.covariance()[i][j]
                } else {
                    0.0
                }
            })
        }),
        gain,
        offset: offset / normalization.scale + normalization.mean * (1.0 - gain),
        residual: solution.residual / normalization.scale,
        status,
    }
}
