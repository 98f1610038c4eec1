//! One pair of frames, from the coarsest level to the finest.
//!
//! `docs/algorithms.md`, section "Dense flow: dense_flow".

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::parallel::both;
use crate::pyramid::Pyramid;

use super::block_matching::Matching;
use super::chance::Count;
use super::confidence::Judged;
use super::covariance::Cells;
use super::fill::Fill;
use super::light::Light;
use super::looks::Looks;
use super::options::{DenseHints, DenseOptions, LevelRecipe, RefineRecipe};
use super::padded_plane::{self, PaddedPlane};
use super::refine::RoundOptions;
use super::step::StepOptions;
use super::sureness::Sureness;
use super::trend::{Samples, Trend};
use super::windows::Views;
use super::{half_round, median, propagate, refine, step, upsample};

/// Light is estimated on levels of at most this many pixels along the longer side, and carried over to finer ones.
const LIGHT_SIZE: usize = 100;

/// In small frames the levels that the measurement starts with end here in steady light: finer ones are measured better, and in
/// less time, as those of large frames are. Light is still estimated on finer levels.
const STEADY_FIRST: usize = 2;
/// But not on levels whose shorter side is below this, in pixels: their windows would hold most of the level.
const LEAST_FIRST: usize = 12;

/// Half the windows that judge the flow, at least: smaller ones find texture in noise.
const JUDGING: usize = 2;

/// The finest level whose flow is filled in where windows say little: on finer ones that costs more than it gains.
const FILLED: usize = 2;

/// From this share of the flow that follows its trend on, and up to the other, smoothness gains weight.
const AFFINE: [f32; 2] = [0.85, 0.95];
/// Planes that are kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Memory {
    pub(super) flow: [PaddedPlane; 2],
    /// If the flow is of half the size of the level: what its values are multiplied by.
    pub(super) halved: Option<f32>,
    pub(super) spare: [PaddedPlane; 2],
    /// The best flow of the coarse levels so far, and its light.
    pub(super) best: [PaddedPlane; 2],
    pub(super) best_light: Light,
    best_trend: Trend,
    /// The flow of the coarse levels in steady light.
    steady: [PaddedPlane; 2],
    steady_trend: Trend,
    /// A level of `prev` as it came.
    pub(super) finer: Plane,
    /// The coarse levels of `prev` as they came.
    pub(super) coarse: Vec<Plane>,
    pub(super) energy: PaddedPlane,
    pub(super) judged: Judged,
    /// What a coarse level says of the flow.
    pub(super) support: Judged,
    /// What most of the flow does.
    pub(super) trend: Trend,
    pub(super) samples: Samples,
    pub(super) counts: Vec<Count>,
    pub(super) cells: Cells,
    /// What the windows of the level that was filled in last say.
    pub(super) sureness: Sureness,
    pub(super) fill: Fill,
    /// What is filled in of a flow of all pixels.
    pub(super) gains: [PaddedPlane; 2],
    /// The flow of the displacements that fit best, and how well they do.
    pub(super) found: [PaddedPlane; 2],
    pub(super) found_energy: PaddedPlane,
    pub(super) found_trend: Trend,
    pub(super) light: Light,
    pub(super) matching: Matching,
    looks: Looks,
    pub(super) weights: Vec<Plane>,
    /// 0 at pixels of `prev` that are masked or not finite.
    pub(super) given: Plane,
    /// 0 at pixels that count for nothing, clipped ones among them.
    pub(super) unclipped: Plane,
    /// Not 0 at pixels of `next` that are clipped, or beside one that is.
    pub(super) near: Vec<u8>,
}

impl Memory {
    /// How badly the windows fitted before the last step: the mean root of their energies.
    pub(super) fn misfit(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in 0..self.energy.height() {
            for energy in self
                .energy
                .row(y)
                .iter()
                .filter(|energy| **energy < f32::MAX)
            {
                sum += f64::from(energy.max(0.0).sqrt());
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// Keep the flow as the best so far; what is in `flow` afterwards is unspecified.
    pub(super) fn keep_flow(&mut self) {
        std::mem::swap(&mut self.flow, &mut self.best);
        self.best_trend = self.trend;
    }

    /// Keep the flow in steady light.
    pub(super) fn keep_steady(&mut self) -> Result<()> {
        self.steady_trend = self.trend;
        for (steady, flow) in self.steady.iter_mut().zip(&self.flow) {
            steady.copy_from(flow)?;
        }
        Ok(())
    }

    /// Take the flow in steady light again.
    pub(super) fn take_steady(&mut self) -> Result<()> {
        self.trend = self.steady_trend;
        for (flow, steady) in self.flow.iter_mut().zip(&self.steady) {
            flow.copy_from(steady)?;
        }
        Ok(())
    }

    /// Take the best flow again.
    pub(super) fn take_best_flow(&mut self) {
        std::mem::swap(&mut self.flow, &mut self.best);
        self.trend = self.best_trend;
    }

    /// Set the flow on `level`, the one to begin with.
    fn start(&mut self, pyramid: &Pyramid, level: usize, hints: DenseHints<'_>) -> Result<()> {
        self.halved = None;
        self.trend = Trend::default();
        self.sureness.forget();
        let plane = &pyramid.levels()[level];
        // What went further than the frame reaches is not in it; NaN is not within either.
        let reach = pyramid.levels()[0]
            .width()
            .max(pyramid.levels()[0].height()) as f32;
        for (axis, grid) in self.flow.iter_mut().enumerate() {
            grid.resize(plane.width(), plane.height())?;
            grid.fill(0.0);
            let Some(initial) = hints.initial else {
                continue;
            };
            let scale = 1usize << level;
            for y in 0..plane.height() {
                let row = grid.padded_mut(y);
                for x in 0..plane.width() {
                    let value = initial[(y * scale, x * scale, axis)];
                    row[padded_plane::PAD + x] = if value.abs() <= reach {
                        value / scale as f32
                    } else {
                        0.0
                    };
                }
                padded_plane::extend(row, plane.width());
            }
        }
        Ok(())
    }
}

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
fn first_level(pyramid: &Pyramid, hints: DenseHints<'_>) -> usize {
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
    pub(super) memory: &'a mut Memory,
}

impl CoarseToFine<'_> {
    /// Measure all levels, and judge the flow of the finest one. Returns the level of the light's estimate, if light is
    /// found to have changed.
    pub(super) fn run(&mut self, hints: DenseHints<'_>) -> Result<Option<usize>> {
        let coarsest = first_level(self.prev, hints);
        let small = |plane: &Plane| plane.width().max(plane.height()) <= LIGHT_SIZE;
        let levels = self.prev.levels();
        let most = levels
            .iter()
            .rposition(|plane| plane.width().min(plane.height()) >= LEAST_FIRST)
            .unwrap_or(0)
            .min(coarsest);
        let of_light = levels.iter().position(small).unwrap_or(coarsest);
        let of_light = of_light.max(1.min(most)).min(coarsest);
        let first = of_light.max(STEADY_FIRST.min(most)).min(coarsest);
        self.first = first;
        let mut looks = std::mem::take(&mut self.memory.looks);
        looks.take(
            &self.prev.levels()[first],
            self.weighted.then(|| &self.memory.weights[first]),
        )?;
        let wants_light = self.options.illumination == Illumination::GainOffset;
        let (execution, next) = (self.execution, &self.next.levels()[first]);
        let (measured, looked) = both(
            execution,
            || self.coarse(first, hints, false),
            || looks.look(next, hints.initial.is_none(), wants_light),
        )?;
        let (contrast, lit) = (looks.contrast, looks.lit);
        self.memory.looks = looks;
        measured.and(looked)?;
        // A search that finds nothing leaves energies of its own behind.
        let mut misfit = self.memory.misfit();
        self.found = match contrast {
            Some(contrast) => self.search(first, contrast, misfit)?,
            None => false,
        };
        if self.found {
            misfit = self.memory.misfit();
        }
        let lit = if lit {
            self.relight(of_light, hints, misfit)?
        } else {
            None
        };
        let first = self.first;
        if let Some(mask) = hints.next_mask {
            self.drop_masked(mask, first)?;
            self.coarse(first, hints, false)?;
        }
        let finest = self.options.recipe.finest.min(first);
        // Where a flow is given what is lost is not looked for.
        let matched = if hints.initial.is_none() {
            finest.max(first.saturating_sub(1))
        } else {
            usize::MAX
        };
        if matched == first {
            self.match_lost(first)?;
        }
        for level in (finest..first).rev() {
            self.memory.halved = Some(2.0);
            self.level(level, true)?;
            if level == matched {
                self.match_lost(level)?;
            }
            if level >= FILLED {
                self.fill(level, 2)?;
            }
            if level > 0 {
                self.whole(level)?;
            }
        }
        if finest > 0 {
            // What is of the size of the finest level measured is of half the size of the frames.
            self.memory.halved = Some(2.0);
            if self.judged {
                let frame = &self.prev.levels()[0];
                let size = (frame.width(), frame.height());
                let Memory { judged, spare, .. } = &mut *self.memory;
                judged.spread(size, &mut spare[0])?;
            }
        }
        if !self.judged {
            self.judge()?;
        }
        self.find_support()?;
        Ok(lit)
    }

    /// Judge the flow of the finest level by a step that is not taken.
    fn judge(&mut self) -> Result<()> {
        // No longer than nothing: what is judged is the flow as it stands.
        let options = StepOptions {
            radius: JUDGING,
            max_step: 0.0,
            ..self.step_options(0)
        };
        let Memory {
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
        let Memory {
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
            let Memory {
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
        let Memory { flow, spare, .. } = &mut *self.memory;
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
            let Memory {
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
            let Memory {
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
}
