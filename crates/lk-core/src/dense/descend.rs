//! One pair of frames, from the coarsest level to the finest.

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::parallel::both;
use crate::pyramid::Pyramid;

use super::grid::{self, Grid};
use super::judge::Judged;
use super::light::Light;
use super::looks::Looks;
use super::options::{DenseHints, DenseOptions, LevelRecipe};
use super::step::StepOptions;
use super::windows::Views;
use super::{median, refine, select, step, upsample};

/// Light is estimated on levels of at most this many pixels along the longer side, and carried over to finer ones.
const LIGHT_SIZE: usize = 100;
/// Planes that are kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Memory {
    pub(super) flow: [Grid; 2],
    /// If the flow is of half the size of the level: what its values are multiplied by.
    pub(super) halved: Option<f32>,
    spare: [Grid; 2],
    /// The best flow of the coarse levels so far, and its light.
    pub(super) best: [Grid; 2],
    pub(super) best_light: Light,
    /// The coarse levels of `prev` as they came.
    pub(super) coarse: Vec<Plane>,
    pub(super) energy: Grid,
    pub(super) judged: Judged,
    /// The flow of the displacements that fit best, and how well they do.
    pub(super) found: [Grid; 2],
    pub(super) found_energy: Grid,
    pub(super) light: Light,
    looks: Looks,
    pub(super) weights: Vec<Plane>,
    /// 0 at pixels of `prev` that are masked or not finite.
    pub(super) given: Plane,
    /// 0 at pixels that count for nothing, clipped ones among them.
    pub(super) unclipped: Plane,
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
    }

    /// Set the flow on `level`, the one to begin with.
    fn start(&mut self, pyramid: &Pyramid, level: usize, hints: DenseHints<'_>) -> Result<()> {
        self.halved = None;
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
                    row[grid::PAD + x] = if value.abs() <= reach {
                        value / scale as f32
                    } else {
                        0.0
                    };
                }
                grid::extend(row, plane.width());
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
    [u, v]: [&'a Grid; 2],
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
pub(super) struct Descent<'a> {
    pub(super) options: &'a DenseOptions,
    pub(super) execution: &'a Execution,
    /// Its light is changed on the way.
    pub(super) prev: &'a mut Pyramid,
    pub(super) next: &'a Pyramid,
    /// The extremes of `prev` and of `next`, if they have any.
    pub(super) ranges: [Option<[f32; 2]>; 2],
    /// Whether some pixels count for nothing.
    pub(super) weighted: bool,
    /// Whether `memory.found` has the flow of the search.
    pub(super) found: bool,
    /// Whether `memory.judged` speaks of the flow as it stands.
    pub(super) judged: bool,
    pub(super) memory: &'a mut Memory,
}

impl Descent<'_> {
    /// Measure all levels, and judge the flow of the finest one. Returns the level of the light's estimate, if light is
    /// found to have changed.
    pub(super) fn run(&mut self, hints: DenseHints<'_>) -> Result<Option<usize>> {
        let coarsest = first_level(self.prev, hints);
        let small = |plane: &Plane| plane.width().max(plane.height()) <= LIGHT_SIZE;
        let first = self
            .prev
            .levels()
            .iter()
            .position(small)
            .unwrap_or(coarsest)
            .min(coarsest);
        let mut looks = std::mem::take(&mut self.memory.looks);
        looks.take(
            &self.prev.levels()[first],
            self.weighted.then(|| &self.memory.weights[first]),
        )?;
        let wants_light = self.options.illumination == Illumination::GainOffset;
        let (execution, next) = (self.execution, &self.next.levels()[first]);
        let (measured, looked) = both(
            execution,
            || self.coarse(first, hints, None),
            || looks.look(next, hints.initial.is_none(), wants_light),
        )?;
        let (contrast, lit) = (looks.contrast, looks.lit);
        self.memory.looks = looks;
        measured.and(looked)?;
        self.found = match contrast {
            Some(contrast) => self.search(first, contrast)?,
            None => false,
        };
        let lit = if lit {
            self.relight(first, hints)?
        } else {
            None
        };
        for level in (0..first).rev() {
            self.memory.halved = Some(2.0);
            self.level(level, true)?;
            if level > 0 {
                self.whole(level)?;
            }
        }
        if !self.judged {
            self.judge()?;
        }
        Ok(lit)
    }

    /// Judge the flow of the finest level by a step that is not taken.
    fn judge(&mut self) -> Result<()> {
        // No longer than nothing: what is judged is the flow as it stands.
        let options = StepOptions {
            longest: 0.0,
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

    fn level_recipe(&self, level: usize) -> LevelRecipe {
        let levels = &self.options.recipe.levels;
        levels[level.min(levels.len() - 1)]
    }

    fn step_options(&self, level: usize) -> StepOptions {
        let recipe = &self.options.recipe;
        StepOptions {
            radius: self.level_recipe(level).radius,
            centred: self.options.illumination != Illumination::None,
            damping: recipe.damping,
            longest: recipe.longest,
        }
    }

    /// Measure the levels from the coarsest one to `first`, or `first` alone where the search has found its flow. With
    /// `radii`, the light of each is changed before it is measured.
    pub(super) fn coarse(
        &mut self,
        first: usize,
        hints: DenseHints<'_>,
        radii: Option<(usize, usize)>,
    ) -> Result<()> {
        let start = if self.found {
            let Memory { flow, found, .. } = &mut *self.memory;
            for (flow, found) in flow.iter_mut().zip(found) {
                flow.copy_from(found)?;
            }
            first
        } else {
            let level = first_level(self.prev, hints);
            self.memory.start(self.prev, level, hints)?;
            level
        };
        for level in (first..=start).rev() {
            if level < start {
                self.memory.halved = Some(2.0);
                self.whole(level)?;
            }
            if let Some(radii) = radii {
                self.relight_level(level, radii)?;
            }
            self.level(level, false)?;
            self.whole(level)?;
        }
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
        let (execution, recipe) = (self.execution, &self.options.recipe);
        let (of_level, options) = (self.level_recipe(level), self.step_options(level));
        for cycle in 0..of_level.cycles {
            let ends = once && cycle + 1 == of_level.cycles;
            for taken in 0..of_level.steps {
                execution.check()?;
                let last = taken + 1 == of_level.steps;
                let sparse = taken < of_level.sparse && (ends || !last);
                let judges = ends && level == 0 && sparse && last && of_level.rounds == 0;
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
                    ..
                } = &mut *self.memory;
                let weights = self.weighted.then_some(&**weights);
                let views = views(self.prev, self.next, level, [u, v], *halved, weights);
                let to = (&mut *to_u, &mut *to_v, &mut *energy);
                // Distances in pixels of the grid that the step is taken on.
                let (distance, spacing) = if sparse {
                    step::sparse_step(views, &options, to, judges.then_some(judged), execution)?;
                    self.judged |= judges;
                    *halved = Some(1.0);
                    (of_level.distance.div_ceil(2), of_level.median.div_ceil(2))
                } else {
                    step::step(views, &options, to, execution)?;
                    (of_level.distance, of_level.median)
                };
                if distance > 0 {
                    let (from, to) = ((&*to_u, &*to_v), (&mut *u, &mut *v));
                    select::select(from, energy, distance, recipe.better, to, execution)?;
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
            for round in 0..of_level.rounds {
                execution.check()?;
                let judges = ends && level == 0 && round + 1 == of_level.rounds;
                self.whole(level)?;
                let Memory {
                    flow,
                    spare,
                    judged,
                    weights,
                    ..
                } = &mut *self.memory;
                let ([u, v], [to_u, to_v]) = (&mut *flow, &mut *spare);
                let weights = self.weighted.then_some(&**weights);
                let views = views(self.prev, self.next, level, [u, v], None, weights);
                let to = (&mut *to_u, &mut *to_v);
                let judged = judges.then_some(judged);
                refine::round(
                    views,
                    &recipe.refine,
                    options.centred,
                    to,
                    judged,
                    execution,
                )?;
                self.judged |= judges;
                std::mem::swap(flow, spare);
            }
        }
        Ok(())
    }
}
