//! One pair of frames, from the coarsest level to the finest.

use crate::error::Result;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::pyramid::Pyramid;

use super::grid::{self, Grid};
use super::light::Light;
use super::options::{DenseHints, DenseOptions};
use super::step::StepOptions;
use super::windows::Views;
use super::{median, refine, select, step, upsample, weights};

/// Light is estimated on levels of at most this many pixels along the longer side, and carried over to finer ones.
const LIGHT_SIZE: usize = 100;
/// Half the windows of its trend over the picture, and of what differs locally, in pixels of those levels. Where light
/// has changed, all are tried: on coarse levels a wrong guess can lead the flow astray.
const LIGHT_RADII: [(usize, usize); 4] = [(3, 8), (2, 8), (5, 12), (3, 6)];
/// Whether it has changed is looked at closely where the logarithm of the gain exceeds this.
const SUSPICIOUS: f64 = 0.05;
/// Light is taken to have changed where that leaves less than this share of the misfit.
const CHANGED: f64 = 0.9;

/// Planes that are kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Memory {
    pub(super) flow: [Grid; 2],
    spare: [Grid; 2],
    /// The best flow of the coarse levels so far, and its light.
    best: [Grid; 2],
    best_light: Light,
    /// The coarse levels of `prev` as they came.
    coarse: Vec<Plane>,
    energy: Grid,
    pub(super) light: Light,
    pub(super) weights: Vec<Plane>,
    /// 0 at pixels of `prev` that are masked or not finite.
    pub(super) given: Plane,
    /// 0 at pixels that count for nothing, clipped ones among them.
    unclipped: Plane,
}

impl Memory {
    /// How badly the windows fitted before the last step: the mean root of their energies.
    fn misfit(&self) -> f64 {
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
    fn keep_flow(&mut self) {
        std::mem::swap(&mut self.flow, &mut self.best);
    }

    /// Set the flow on the level to begin with, and return that level.
    fn start(&mut self, pyramid: &Pyramid, hints: DenseHints<'_>) -> usize {
        let coarsest = pyramid.levels().len() - 1;
        let level = match hints.initial {
            Some(_) => coarsest.min(2),
            None => coarsest,
        };
        let plane = &pyramid.levels()[level];
        // What went further than the frame reaches is not in it; NaN is not within either.
        let reach = pyramid.levels()[0]
            .width()
            .max(pyramid.levels()[0].height()) as f32;
        for (axis, grid) in self.flow.iter_mut().enumerate() {
            grid.resize(plane.width(), plane.height());
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
        level
    }
}

/// One measurement under way.
pub(super) struct Descent<'a> {
    pub(super) options: &'a DenseOptions,
    /// Its light is changed on the way.
    pub(super) prev: &'a mut Pyramid,
    pub(super) next: &'a Pyramid,
    /// The extremes of `prev` and of `next`, if they have any.
    pub(super) ranges: [Option<[f32; 2]>; 2],
    /// Whether some pixels count for nothing.
    pub(super) weighted: bool,
    pub(super) memory: &'a mut Memory,
}

impl Descent<'_> {
    /// Measure all levels. Returns the level of the light's estimate, if light is found to have changed.
    pub(super) fn run(&mut self, hints: DenseHints<'_>) -> Result<Option<usize>> {
        let coarsest = self.memory.start(self.prev, hints);
        let small = |plane: &Plane| plane.width().max(plane.height()) <= LIGHT_SIZE;
        let first = self
            .prev
            .levels()
            .iter()
            .position(small)
            .unwrap_or(coarsest)
            .min(coarsest);
        self.coarse(first, coarsest, hints)?;
        let mut lit = None;
        if self.options.illumination == Illumination::GainOffset && self.gain_matters(first) {
            let mut least = CHANGED * self.memory.misfit();
            self.memory.keep_flow();
            self.memory
                .coarse
                .resize_with(coarsest + 1 - first, Plane::default);
            for (kept, plane) in self
                .memory
                .coarse
                .iter_mut()
                .zip(&self.prev.levels()[first..])
            {
                kept.clone_from(plane);
            }
            for radii in LIGHT_RADII {
                self.memory.start(self.prev, hints);
                for level in (first..=coarsest).rev() {
                    if level < coarsest {
                        self.finer(level)?;
                    }
                    self.relight(level, radii);
                    self.level(level)?;
                }
                let misfit = self.memory.misfit();
                for (kept, plane) in self
                    .memory
                    .coarse
                    .iter()
                    .zip(&mut self.prev.levels_mut()[first..])
                {
                    plane.clone_from(kept);
                }
                if std::env::var("GM").is_ok() {
                    eprintln!("radii {radii:?} misfit {misfit:.3} least {least:.3}");
                }
                if misfit < least {
                    least = misfit;
                    lit = Some(first);
                    self.memory.keep_flow();
                    let Memory {
                        light, best_light, ..
                    } = &mut *self.memory;
                    std::mem::swap(light, best_light);
                }
                if lit.is_none() {
                    break;
                }
            }
            let Memory {
                flow,
                best,
                light,
                best_light,
                ..
            } = &mut *self.memory;
            std::mem::swap(flow, best);
            std::mem::swap(light, best_light);
            if lit.is_some() {
                self.relight_all(first)?;
                self.coarse(first, coarsest, hints)?;
            }
        }
        for level in (0..first).rev() {
            self.finer(level)?;
            self.level(level)?;
        }
        Ok(lit)
    }

    /// Measure the levels from the coarsest one to `first`.
    fn coarse(&mut self, first: usize, coarsest: usize, hints: DenseHints<'_>) -> Result<()> {
        self.memory.start(self.prev, hints);
        for level in (first..=coarsest).rev() {
            if level < coarsest {
                self.finer(level)?;
            }
            self.level(level)?;
        }
        Ok(())
    }

    /// Give `prev` the light of `next` on all levels, as level `from` has seen it. A sensor clips what is beyond its range,
    /// which says nothing of motion: pixels at the limits of either frame weigh nothing from here on.
    fn relight_all(&mut self, from: usize) -> Result<()> {
        let Memory {
            light,
            weights,
            unclipped,
            ..
        } = &mut *self.memory;
        let finest = &mut self.prev.levels_mut()[0];
        unclipped.resize(finest.width(), finest.height());
        let within = |value: f32, range: Option<[f32; 2]>| {
            range.is_none_or(|[low, high]| value > low && value < high)
        };
        for (weight, value) in unclipped.data_mut().iter_mut().zip(finest.data()) {
            *weight = f32::from(u8::from(within(*value, self.ranges[0])));
        }
        light.apply(finest, from);
        for (weight, value) in unclipped.data_mut().iter_mut().zip(finest.data_mut()) {
            if let Some([low, high]) = self.ranges[1] {
                *value = value.clamp(low, high);
            }
            if !within(*value, self.ranges[1]) {
                *weight = 0.0;
            }
        }
        self.prev.reduce_again(&self.options.execution)?;
        if self.weighted {
            for (to, given) in unclipped.data_mut().iter_mut().zip(weights[0].data()) {
                *to *= given;
            }
        }
        self.weighted = true;
        weights::pyramid(unclipped, self.prev, weights);
        Ok(())
    }

    /// Carry the flow over from the next coarser level.
    fn finer(&mut self, level: usize) -> Result<()> {
        let plane = &self.prev.levels()[level];
        let Memory { flow, spare, .. } = &mut *self.memory;
        for (flow, spare) in flow.iter_mut().zip(spare) {
            upsample::upsample(
                flow,
                (plane.width(), plane.height()),
                spare,
                &self.options.execution,
            )?;
            std::mem::swap(flow, spare);
        }
        Ok(())
    }

    /// Whether the light may have changed by more than an offset.
    fn gain_matters(&mut self, level: usize) -> bool {
        let (prev, next) = (&self.prev.levels()[level], &self.next.levels()[level]);
        let weight = self.weighted.then(|| &self.memory.weights[level]);
        let [trend, beyond] = self
            .memory
            .light
            .change(prev, next, weight, LIGHT_RADII[0].1);
        if std::env::var("GM").is_ok() {
            eprintln!("share {trend:.3}/{beyond:.3}");
        }
        trend > SUSPICIOUS || beyond > 2.0 * SUSPICIOUS
    }

    /// Give `prev` the light of `next`, as the flow so far sees it.
    fn relight(&mut self, level: usize, radii: (usize, usize)) {
        let Memory {
            flow: [u, v],
            light,
            weights,
            ..
        } = &mut *self.memory;
        let weight = self.weighted.then(|| &weights[level]);
        let (prev, next) = (&self.prev.levels()[level], &self.next.levels()[level]);
        let simd = self.options.execution.simd_level();
        light.estimate(
            Views {
                prev,
                next,
                u,
                v,
                weight,
            },
            radii.0,
            radii.1,
            simd,
        );
        light.apply(&mut self.prev.levels_mut()[level], 0);
    }

    /// Improve the flow of one level.
    fn level(&mut self, level: usize) -> Result<()> {
        let execution = &self.options.execution;
        let recipe = &self.options.recipe;
        let of_level = recipe.levels[level.min(recipe.levels.len() - 1)];
        let centred = self.options.illumination != Illumination::None;
        let options = StepOptions {
            radius: of_level.radius,
            centred,
            damping: recipe.damping,
            longest: recipe.longest,
        };
        let Memory {
            flow,
            spare,
            energy,
            weights,
            ..
        } = &mut *self.memory;
        let weight = self.weighted.then(|| &weights[level]);
        let (prev, next) = (&self.prev.levels()[level], &self.next.levels()[level]);
        for _ in 0..of_level.cycles {
            for _ in 0..of_level.steps {
                execution.check()?;
                let ([u, v], [to_u, to_v]) = (&mut *flow, &mut *spare);
                let input = Views {
                    prev,
                    next,
                    u,
                    v,
                    weight,
                };
                step::step(
                    input,
                    &options,
                    (&mut *to_u, &mut *to_v, &mut *energy),
                    execution,
                )?;
                if of_level.distance > 0 {
                    let (distance, better) = (of_level.distance, recipe.better);
                    let to = (&mut *u, &mut *v);
                    select::select((to_u, to_v), energy, distance, better, to, execution)?;
                } else {
                    std::mem::swap(u, to_u);
                    std::mem::swap(v, to_v);
                }
                if of_level.median > 0 {
                    let to = [&mut *to_u, &mut *to_v];
                    median::median([&*u, &*v], of_level.median, to, execution)?;
                    std::mem::swap(u, to_u);
                    std::mem::swap(v, to_v);
                }
            }
            for _ in 0..of_level.rounds {
                execution.check()?;
                let ([u, v], [to_u, to_v]) = (&mut *flow, &mut *spare);
                let views = Views {
                    prev,
                    next,
                    u,
                    v,
                    weight,
                };
                let to = (&mut *to_u, &mut *to_v);
                refine::round(views, &recipe.refine, centred, to, execution)?;
                std::mem::swap(flow, spare);
            }
        }
        Ok(())
    }
}
