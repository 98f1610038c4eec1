//! The displacement from the best of the starts, and whether to believe it.
//!
//! `docs/explanation/algorithms.md`, section "Displacement of a window: estimate_shift".

use super::deformed::{accounts_for, off_by_deforming};
use super::evaluate::{evaluate, step_in_one_light};
use super::gauss_newton::{COMMON_STRUCTURE, Found, Guess, Problem};
use super::judge::{
    AMBIGUITY_RATIO, CONTRADICTION, EDGE_INFORMATION, EXPLAINED, beyond, judge, measured,
};
use super::matrix::{eigenvalues, inverse, largest_direction, quadratic};
use super::model::LightScope;
use super::options::{ShiftDeformation, ShiftOptions};
use super::result::{Shift, ShiftStatus};
use super::start::{Starts, best_start, repeats_along};
use super::view::{Evaluation, GainField};
use super::workspace::Workspace;
use crate::error::Result;

/// Below this share the border of the window, where gradients are not whole, may be what tells it.
const THIN_INFORMATION: f64 = 0.1;
/// Where the tiles contradict each other by more than this, in variance over noise, and leave a deviation above that, in
/// pixels, the window may deform.
const SCATTERS: f64 = 4.0;
const DOUBTFUL: f64 = 0.03;
/// Of a large window, a part tells whether it does.
const ENOUGH_CLUSTERS: usize = 1500;
/// Displacements further apart than this, in pixels, are two.
const MIN_SEPARATION: f64 = 1.0;
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
        let Some((starts, from)) = self.search(limit, options)? else {
            return Ok(Shift::invalid(ShiftStatus::TooLittleOverlap));
        };
        let Self {
            inputs,
            start: search,
            evaluation,
            clusters,
        } = self;
        let inputs = &*inputs;
        let mut problem = Problem {
            inputs,
            workspace: evaluation,
            clusters,
            options,
        };
        let (mut best, ambiguous) = match problem.best_of(starts, from, limit)? {
            Ok(best) => best,
            Err(status) => return Ok(Shift::invalid(status)),
        };
        let mut status = judge(&best, limit, ambiguous);
        if status != ShiftStatus::Aperture && problem.is_edge_inside(&best)? {
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
        if status == ShiftStatus::Valid {
            best.add(best.solution.contradictions());
            status = judge(&best, limit, ambiguous);
        }
        let follows = matches!(
            status,
            ShiftStatus::Valid | ShiftStatus::NoMatch | ShiftStatus::NotConverged
        );
        let affine = if follows && options.deformation == ShiftDeformation::Affine {
            problem.affine(&best, from, usize::MAX)?
        } else if may_deform(&best, status) {
            problem.affine(&best, from, ENOUGH_CLUSTERS)?
        } else {
            None
        };
        if options.deformation == ShiftDeformation::None
            && !ambiguous
            && let Some(affine) = affine
            && accounts_for(&best, &affine)
        {
            let measured = status == ShiftStatus::Valid;
            let shift = problem.deformed(&best, Some(affine), limit, measured);
            if shift.status == ShiftStatus::Valid {
                return Ok(shift.without_gradient());
            }
        }
        if status == ShiftStatus::Valid
            && let Some(affine) = &affine
            && let Some(apart) = off_by_deforming(&best, affine)
        {
            best.add(apart.map(|a| apart.map(|b| a * b)));
            status = judge(&best, limit, ambiguous);
        }
        if follows && options.deformation == ShiftDeformation::Affine {
            let measured = status == ShiftStatus::Valid;
            return Ok(problem.deformed(&best, affine, limit, measured));
        }
        if status != ShiftStatus::Valid {
            return Ok(Shift::invalid(status));
        }
        best.add(problem.aliasing(&best, None)?);
        Ok(measured(inputs.normalization, &best, status))
    }

    /// The best starts, and the level that they are of: the finer ones are for texture that the coarse ones do not show.
    fn search(
        &mut self,
        limit: [f64; 2],
        options: &ShiftOptions,
    ) -> Result<Option<(Starts, usize)>> {
        let inputs = &self.inputs;
        let mut starts: Option<(Starts, usize)> = None;
        for level in (0..=inputs.levels).rev() {
            let scale = f64::from(1u32 << level);
            let limit = limit.map(|value| (value / scale).ceil());
            let found = best_start(
                inputs.pair(level),
                limit,
                &mut self.start,
                &options.execution,
            )?;
            let Some(found) = found else { continue };
            let is_convincing = found.best.is_convincing();
            if starts
                .as_ref()
                .is_none_or(|(starts, _)| found.best.better_than(&starts.best))
            {
                starts = Some((found, level));
            }
            if is_convincing {
                break;
            }
        }
        Ok(starts)
    }
}

impl Problem<'_> {
    /// The displacement that the best of the starts of a level leads to, and whether another explains the frames as well.
    fn best_of(
        &mut self,
        starts: Starts,
        from: usize,
        limit: [f64; 2],
    ) -> Result<std::result::Result<(Found, bool), ShiftStatus>> {
        let guess = |start: [isize; 2], scope| Guess {
            level: from,
            displacement: start.map(|value| value as f64),
            gain: GainField::default(),
            scope,
            common_structure: false,
            direction: None,
            to_the_end: false,
        };
        let mut best = match self.simplest_light(|scope| guess(starts.best.displacement, scope))? {
            Ok(found) => found,
            Err(status) => return Ok(Err(status)),
        };
        // A pattern that repeats agrees at several starts; what tells them apart shows at the finest level, if anything.
        let mut ambiguous = false;
        for rival in starts.rivals {
            let Ok(rival) = self.descend(guess(rival, best.scope))? else {
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
                    && let Some(own) = self.window_correlation(&best)?
                    && let Some(others) = self.window_correlation(&rival)?
                    && 1.0 - others > AMBIGUITY_RATIO * (1.0 - own).max(ROUNDING_SHARE)
                {
                    continue;
                }
                let spared = count(&best) < COMPARABLE_OVERLAP * count(&rival)
                    && left(&rival) < SHADOW_SHARE;
                ambiguous |= left(&rival) < AMBIGUITY_RATIO * left(&best) || spared;
            }
        }
        Ok(Ok((best, ambiguous)))
    }

    /// Whether the window shows an edge alone where no gradient reaches over its border.
    fn is_edge_inside(&mut self, best: &Found) -> Result<bool> {
        let [low, high] = best.solution.information;
        let thin = low <= THIN_INFORMATION * high;
        if !thin || !best.matches {
            return Ok(false);
        }
        let inside = self.inside(best)?;
        Ok(inside.is_some_and(|inside| {
            let [low, high] = inside.information;
            low <= EDGE_INFORMATION * high
        }))
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
        if self.agrees_without_things(&window, &tiles)? {
            return Ok(Ok(tiles));
        }
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

    /// Whether one light for the window leads to where the tiles do once those that move on their own are left out: these
    /// drew it away, not the light.
    fn agrees_without_things(&mut self, window: &Found, tiles: &Found) -> Result<bool> {
        let params = Evaluation {
            displacement: tiles.displacement,
            whole: tiles.displacement.map(f64::round),
            common_structure: true,
            ..self.evaluation(0, window.gain)
        };
        let pair = self.inputs.pair(0);
        let execution = &self.options.execution;
        if evaluate(pair, params, self.workspace, execution)?.is_none() {
            return Ok(false);
        }
        let Some(apart) = step_in_one_light(pair, params, self.workspace) else {
            return Ok(false);
        };
        let own = inverse(tiles.solution.covariance);
        Ok(own.is_some_and(|own| quadratic(own, apart) <= CONTRADICTION))
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

/// Whether parts of the window contradict each other as those of one that deforms do.
fn may_deform(found: &Found, status: ShiftStatus) -> bool {
    let [_, largest] = eigenvalues(found.covariance());
    let follows = match status {
        ShiftStatus::Valid => largest > DOUBTFUL * DOUBTFUL,
        ShiftStatus::NoMatch => found.matches,
        _ => false,
    };
    follows && found.solution.parts_excess > SCATTERS
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
