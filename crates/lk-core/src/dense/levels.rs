//! The work on one level of both pyramids: its steps, its rounds, and what is filled in afterwards.
//!
//! `docs/explanation/algorithms.md`, section "Dense flow: dense_flow".

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::pyramid::Pyramid;

use super::options::{DenseHints, DenseOptions};
use super::padded_plane::{PAD, PaddedPlane, extend};
use super::recipe::LevelRecipe;
use super::refine::{RefineRecipe, RoundOptions};
use super::step::StepOptions;
use super::trend::Trend;
use super::windows::Views;
use super::workspace::Workspace;
use super::{half_round, median, propagate, refine, step, upsample};

/// Half the windows that judge the flow, at least: smaller ones find texture in noise.
const JUDGING: usize = 2;

/// From this share of the flow that follows its trend on, and up to the other, smoothness gains weight.
const AFFINE: [f32; 2] = [0.85, 0.95];

/// One level of both pyramids, with the flow between them.
fn views<'a>(
    prev: &'a Pyramid,
    next: &'a Pyramid,
    level: usize,
    [u, v]: [&'a PaddedPlane; 2],
    halved: Option<f32>,
    weights: Option<&'a [Plane]>,
) -> Views<'a> {
    Views {
        prev: &prev.levels()[level],
        next: &next.levels()[level],
        u,
        v,
        halved,
        weight: weights.map(|planes| &planes[level]),
    }
}

/// The level to begin with: the coarsest one, or a finer one where there is a flow to start from.
pub(super) fn first_level(pyramid: &Pyramid, hints: DenseHints<'_>) -> usize {
    let coarsest = pyramid.levels().len() - 1;
    match hints.initial {
        Some(_) => coarsest.min(2),
        None => coarsest,
    }
}

/// One measurement under way.
pub(super) struct CoarseToFine<'a> {
    pub(super) options: &'a DenseOptions,
    pub(super) execution: &'a Execution,
    /// Its light is changed on the way.
    pub(super) prev: &'a mut Pyramid,
    pub(super) next: &'a Pyramid,
    /// The extremes of `prev` and of `next`, if they have any.
    pub(super) ranges: [Option<[f32; 2]>; 2],
    /// Whether some pixels count for nothing.
    pub(super) weighted: bool,
    /// The finest of the levels that the measurement starts with.
    pub(super) first: usize,
    /// Whether `memory.found` has the flow of the search.
    pub(super) found: bool,
    /// Whether what is measured is a guess yet: of the light, or of large motion.
    pub(super) guessing: bool,
    /// Whether the coarse levels begin with `first` alone, at rest: under light that is not modelled yet coarser ones drift.
    pub(super) short: bool,
    /// Whether `memory.judged` speaks of the flow as it stands.
    pub(super) judged: bool,
    pub(super) memory: &'a mut Workspace,
}

impl CoarseToFine<'_> {
    /// Judge the flow of the finest level by a step that is not taken.
    pub(super) fn judge(&mut self) -> Result<()> {
        // No longer than nothing: what is judged is the flow as it stands.
        let options = StepOptions {
            radius: JUDGING,
            max_step: 0.0,
            ..self.step_options(0)
        };
        let Workspace {
            flow: [u, v],
            halved,
            spare: [to_u, to_v],
            energy,
            judged,
            weights,
            ..
        } = &mut *self.memory;
        let weights = self.weighted.then_some(&**weights);
        let views = views(self.prev, self.next, 0, [u, v], *halved, weights);
        let execution = self.execution;
        step::sparse_step(
            views,
            &options,
            (to_u, to_v, energy),
            Some(judged),
            execution,
        )
    }

    pub(super) fn level_recipe(&self, level: usize) -> LevelRecipe {
        let recipe = &self.options.recipe;
        match recipe.fine.get(level) {
            Some(fine) if level < self.first => *fine,
            _ => recipe.coarse,
        }
    }

    pub(super) fn step_options(&self, level: usize) -> StepOptions {
        let recipe = &self.options.recipe;
        StepOptions {
            radius: self.level_recipe(level).radius,
            centred: self.options.illumination != Illumination::None,
            damping: recipe.damping,
            max_step: recipe.max_step,
            measures: false,
        }
    }

    /// What a round on `level` needs to know; finds the trend of the flow as it stands.
    fn round_options(&mut self, level: usize) -> Result<RoundOptions> {
        let recipe = &self.options.recipe;
        let Workspace {
            flow,
            halved,
            trend,
            samples,
            sureness,
            ..
        } = &mut *self.memory;
        *trend = Trend::of(flow.each_ref(), *halved, trend.slopes, sureness, samples)?;
        let trend = *trend;
        let [low, high] = AFFINE;
        let affine = if level < self.first.min(2) {
            ((trend.affine - low) / (high - low)).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let gain = 1.0 + affine * (recipe.affine_gain - 1.0);
        Ok(RoundOptions {
            recipe: RefineRecipe {
                alpha: gain * recipe.refine.alpha,
                ..recipe.refine
            },
            sweeps: self.level_recipe(level).sweeps,
            centred: self.options.illumination != Illumination::None,
            slopes: trend.slopes,
        })
    }

    /// Measure the levels from the coarsest one to `first`, or `first` alone where the search has found its flow. With
    /// `relight`, the light of each is changed before it is measured.
    pub(super) fn coarse(
        &mut self,
        first: usize,
        hints: DenseHints<'_>,
        relight: bool,
    ) -> Result<()> {
        self.guessing = relight;
        let start = if self.found {
            let Workspace {
                flow,
                found,
                trend,
                found_trend,
                ..
            } = &mut *self.memory;
            for (flow, found) in flow.iter_mut().zip(found) {
                flow.copy_from(found)?;
            }
            *trend = *found_trend;
            first
        } else {
            let level = if self.short {
                first
            } else {
                first_level(self.prev, hints)
            };
            self.memory.start(self.prev, level, hints)?;
            level
        };
        for level in (first..=start).rev() {
            if level < start {
                self.memory.halved = Some(2.0);
                self.whole(level)?;
            }
            if relight {
                self.relight_level(level)?;
            }
            self.level(level, false)?;
            self.whole(level)?;
            self.fill(level, 1)?;
        }
        self.guessing = false;
        Ok(())
    }

    /// Bring the flow to the size of `level`, if it is of half that size.
    pub(super) fn whole(&mut self, level: usize) -> Result<()> {
        let Some(scale) = self.memory.halved.take() else {
            return Ok(());
        };
        let plane = &self.prev.levels()[level];
        let size = (plane.width(), plane.height());
        let Workspace { flow, spare, .. } = &mut *self.memory;
        for (flow, spare) in flow.iter_mut().zip(spare) {
            upsample::upsample(flow, size, scale, spare, self.execution)?;
            std::mem::swap(flow, spare);
        }
        Ok(())
    }

    /// Improve the flow of one level. With `once` nothing on this level comes afterwards: flow and energies may be of half
    /// the size then, and on the finest level the last step or round judges the flow if it can.
    pub(super) fn level(&mut self, level: usize, once: bool) -> Result<()> {
        self.steps(level, once)?;
        self.refine(level, once)
    }

    /// The steps of one level.
    pub(super) fn steps(&mut self, level: usize, once: bool) -> Result<()> {
        let execution = self.execution;
        let (of_level, options) = (self.level_recipe(level), self.step_options(level));
        let match_ratio = self.options.recipe.match_ratio;
        let judges_at = |last: bool| once && level == self.options.recipe.finest && last;
        for taken in 0..of_level.steps {
            execution.check()?;
            let last = taken + 1 == of_level.steps;
            let sparse = taken < of_level.sparse && (once || !last);
            let judges = sparse && judges_at(last && of_level.half_rounds + of_level.rounds == 0);
            if !sparse {
                self.whole(level)?;
            }
            let Workspace {
                flow: [u, v],
                halved,
                spare: [to_u, to_v],
                energy,
                judged,
                weights,
                trend,
                ..
            } = &mut *self.memory;
            let weights = self.weighted.then_some(&**weights);
            let views = views(self.prev, self.next, level, [u, v], *halved, weights);
            let to = (&mut *to_u, &mut *to_v, &mut *energy);
            // Distances in pixels of the grid that the step is taken on.
            let (distance, spacing, across) = if sparse {
                step::sparse_step(views, &options, to, judges.then_some(judged), execution)?;
                self.judged |= judges;
                *halved = Some(1.0);
                let half = |distance: usize| distance.div_ceil(2);
                (half(of_level.distance), half(of_level.median), 2.0)
            } else {
                step::step(views, &options, to, execution)?;
                (of_level.distance, of_level.median, 1.0)
            };
            if distance > 0 {
                let (from, to) = ((&*to_u, &*to_v), (&mut *u, &mut *v));
                let slopes = trend
                    .common_slopes()
                    .map(|axis| axis.map(|slope| slope * across));
                propagate::propagate(from, energy, (distance, slopes), match_ratio, to, execution)?;
            } else {
                std::mem::swap(u, to_u);
                std::mem::swap(v, to_v);
            }
            if spacing > 0 {
                let to = [&mut *to_u, &mut *to_v];
                median::median([&*u, &*v], spacing, to, execution)?;
                std::mem::swap(u, to_u);
                std::mem::swap(v, to_v);
            }
        }
        Ok(())
    }

    /// The rounds of one level.
    fn refine(&mut self, level: usize, once: bool) -> Result<()> {
        let execution = self.execution;
        let of_level = self.level_recipe(level);
        // A flow that is of full size stays so.
        let half_rounds = if once && self.memory.halved.is_some() {
            of_level.half_rounds
        } else {
            0
        };
        let rounds = if self.guessing {
            of_level.rounds.min(1)
        } else {
            of_level.rounds
        };
        if half_rounds + rounds == 0 {
            return Ok(());
        }
        for round in 0..half_rounds + rounds {
            execution.check()?;
            let options = self.round_options(level)?;
            let half = round < half_rounds;
            let finest = self.options.recipe.finest;
            let last = round + 1 == half_rounds + rounds;
            let judges = once && level == finest && last && options.recipe.radius >= JUDGING;
            if !half {
                self.whole(level)?;
            }
            let Workspace {
                flow,
                halved,
                spare,
                judged,
                weights,
                ..
            } = &mut *self.memory;
            let ([u, v], [to_u, to_v]) = (&mut *flow, &mut *spare);
            let weights = self.weighted.then_some(&**weights);
            let views = views(self.prev, self.next, level, [u, v], *halved, weights);
            let to = (&mut *to_u, &mut *to_v);
            let judged = judges.then_some(judged);
            if half {
                half_round::half_round(views, &options, to, judged, execution)?;
                *halved = Some(1.0);
            } else {
                refine::round(views, &options, to, judged, execution)?;
            }
            self.judged |= judges;
            std::mem::swap(flow, spare);
        }
        Ok(())
    }

    /// Fill in the flow of `level`, which was just measured, where its windows say little, on a grid of one pixel in
    /// `step` x `step`: 2 for a flow of half the size, 1 or 2 for one of all pixels.
    pub(super) fn fill(&mut self, level: usize, step: usize) -> Result<()> {
        let plane = &self.prev.levels()[level];
        let Workspace {
            flow,
            halved,
            spare,
            gains,
            energy,
            weights,
            trend,
            samples,
            sureness,
            fill,
            ..
        } = &mut *self.memory;
        let weight = self.weighted.then(|| &weights[level]);
        sureness.measure(plane, (level, step), energy, weight)?;
        *trend = Trend::of(flow.each_ref(), *halved, trend.slopes, sureness, samples)?;
        // What the flow of the grid differs by from one of its pixels to the next.
        let scale = halved.unwrap_or(1.0);
        let slopes = trend
            .carrying_slopes()
            .map(|axis| axis.map(|slope| slope * step as f32 / scale));
        if step == 1 || halved.is_some() {
            return fill.spread(flow.each_mut(), sureness, slopes);
        }
        // What a flow of all pixels gains is found on the grid and interpolated.
        for (flow, grid) in flow.iter().zip(&mut *gains) {
            grid.resize(flow.width().div_ceil(step), flow.height().div_ceil(step))?;
            for y in 0..grid.height() {
                let (from, to) = (flow.row(step * y), grid.padded_mut(y));
                for (to, from) in to[PAD..].iter_mut().zip(from.iter().step_by(step)) {
                    *to = *from;
                }
            }
        }
        fill.spread(gains.each_mut(), sureness, slopes)?;
        for ((flow, grid), gain) in flow.iter_mut().zip(gains).zip(spare) {
            let (width, height) = (flow.width(), flow.height());
            for y in 0..grid.height() {
                let (from, to) = (flow.row(step * y), grid.padded_mut(y));
                for (to, from) in to[PAD..].iter_mut().zip(from.iter().step_by(step)) {
                    *to -= *from;
                }
                extend(to, width.div_ceil(step));
            }
            upsample::upsample(grid, (width, height), 1.0, gain, self.execution)?;
            for y in 0..height {
                for (flow, gain) in flow.padded_mut(y).iter_mut().zip(gain.padded(y)) {
                    *flow += gain;
                }
            }
        }
        Ok(())
    }
}
