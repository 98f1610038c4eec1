//! Light that has changed: what it did is found on coarse levels, and all levels of `prev` are brought to it.
//!
//! `docs/explanation/algorithms.md`, section "Slow light".

use crate::error::Result;
use crate::frame::Plane;

use super::levels::CoarseToFine;
use super::light::LIGHT_RADII;
use super::options::DenseHints;
use super::weights;
use super::windows::Views;
use super::workspace::Workspace;

/// Light may have changed where the logarithm of the gain exceeds this once windows are compared along the flow: that of its
/// trend, or what windows say beyond it. On photographs and drawings a gain of 0.9 has 0.1, lens shading of 30 % 0.05 and 0.03 at
/// least, and steady light 0.06 and 0.02 at most where the flow is right.
const DIFFERS: [f64; 2] = [0.06, 0.03];
/// Light is taken to have changed where that leaves less than this share of the misfit.
const CHANGED: f64 = 0.9;
/// Light that leaves more than this share of the misfit may be the motion of thin things: it is held against steady light
/// on the next finer level.
const DOUBTFUL: f64 = 0.3;
/// There it is kept if it leaves less than this share of the misfit of steady light.
const EXPLAINS: f64 = 0.9;
/// Below this share of the frame pixels at its limits are the extremes of any frame, not those of a sensor.
const FEW_CLIPPED: f32 = 0.001;
/// The flow from rest is taken instead of one that fits if it leaves less than this share of its misfit.
const OTHER: f64 = 0.95;
/// It is not tried where the first one leaves less than this share of the misfit.
const SURE: f64 = 0.3;

impl CoarseToFine<'_> {
    /// Find what the light did, on level `of_light` and coarser ones, bring all levels of `prev` to it, and measure those
    /// levels again; the level, or `None` and nothing has happened where no change of light fits. `before` is the misfit of
    /// the flow so far, which may be that of a coarser level; it is measured down to `of_light` then.
    pub(super) fn relight(
        &mut self,
        of_light: usize,
        hints: DenseHints<'_>,
        mut before: f64,
    ) -> Result<Option<usize>> {
        if !self.found && of_light < self.first {
            if !self.light_differs_along(self.first)? {
                return Ok(None);
            }
            self.first = of_light;
            self.coarse(of_light, hints, false)?;
            before = self.memory.misfit();
        }
        let first = self.first;
        if !self.light_differs_along(first)? {
            return Ok(None);
        }
        let mut least = CHANGED * before;
        // Whether the best flow in changed light began at rest, if there is one.
        let mut best: Option<bool> = None;
        self.memory.keep_steady()?;
        self.memory.keep_flow();
        let levels = &self.prev.levels()[first..];
        self.memory.coarse.resize_with(levels.len(), Plane::default);
        for (kept, plane) in self.memory.coarse.iter_mut().zip(levels) {
            kept.copy_of(plane)?;
        }
        let starts: &[bool] = if hints.initial.is_none() {
            &[false, true]
        } else {
            &[false]
        };
        for short in starts {
            self.short = *short;
            self.coarse(first, hints, true)?;
            let levels = &mut self.prev.levels_mut()[first..];
            for (kept, plane) in self.memory.coarse.iter().zip(levels) {
                plane.copy_of(kept)?;
            }
            let misfit = self.memory.misfit();
            let other = if best.is_some() { OTHER } else { 1.0 };
            if misfit < other * least {
                least = misfit;
                best = Some(*short);
                self.memory.keep_flow();
                let Workspace {
                    light, best_light, ..
                } = &mut *self.memory;
                std::mem::swap(light, best_light);
            }
            if least < SURE * before {
                break;
            }
        }
        self.memory.take_best_flow();
        let Workspace {
            light, best_light, ..
        } = &mut *self.memory;
        std::mem::swap(light, best_light);
        if best.is_some() && least > DOUBTFUL * before && !self.light_explains_more(first)? {
            best = None;
        }
        if let Some(short) = best {
            self.short = short;
            self.relight_all(first)?;
            self.coarse(first, hints, false)?;
        }
        self.short = false;
        Ok(best.map(|_| first))
    }

    /// Whether the light differs along the flow so far, by more than an offset. Windows that are compared where they stand differ
    /// by what moves in and out of them too.
    fn light_differs_along(&mut self, first: usize) -> Result<bool> {
        let Workspace {
            flow: [u, v],
            light,
            weights,
            ..
        } = &mut *self.memory;
        let views = Views {
            prev: &self.prev.levels()[first],
            next: &self.next.levels()[first],
            u,
            v,
            halved: None,
            weight: self.weighted.then(|| &weights[first]),
        };
        let simd = self.execution.simd_level();
        let [trend, beyond] = light.change_along(views, LIGHT_RADII.1, simd)?;
        Ok(trend > DIFFERS[0] || beyond > DIFFERS[1])
    }

    /// Whether the light, with its flow, leaves less misfit on the level below `first` than the flow in steady light does; that
    /// flow is taken if not. On `first` what moves may be too thin to be followed there, and a gain that follows its edges
    /// explains more.
    fn light_explains_more(&mut self, first: usize) -> Result<bool> {
        let finest = self.options.recipe.finest;
        if first <= finest {
            return Ok(true);
        }
        let level = first - 1;
        self.memory.keep_flow();
        let Workspace {
            flow,
            best,
            finer,
            light,
            unclipped,
            ..
        } = &mut *self.memory;
        for (flow, best) in flow.iter_mut().zip(best) {
            flow.copy_from(best)?;
        }
        let plane = &mut self.prev.levels_mut()[level];
        finer.copy_of(plane)?;
        unclipped.resize(plane.width(), plane.height())?;
        light.apply_clipped(plane, 1, self.ranges, unclipped, self.execution)?;
        let lit = self.misfit_of(level)?;
        self.prev.levels_mut()[level].copy_of(&self.memory.finer)?;
        self.memory.take_steady()?;
        let steady = self.misfit_of(level)?;
        let more = lit < EXPLAINS * steady;
        if more {
            self.memory.take_best_flow();
        } else {
            self.memory.take_steady()?;
        }
        Ok(more)
    }

    /// What the flow, of half the size of `level`, leaves there after it was improved.
    fn misfit_of(&mut self, level: usize) -> Result<f64> {
        self.memory.halved = Some(2.0);
        self.level(level, true)?;
        self.memory.halved = None;
        self.judged = false;
        Ok(self.memory.misfit())
    }

    /// Give `prev` the light of `next` on all levels, as level `from` has seen it. A sensor clips what is beyond its range,
    /// which says nothing of motion: pixels at the limits of either frame weigh nothing from here on.
    fn relight_all(&mut self, from: usize) -> Result<()> {
        let Workspace {
            flow: [u, v],
            light,
            weights,
            unclipped,
            near,
            ..
        } = &mut *self.memory;
        let finest = &mut self.prev.levels_mut()[0];
        unclipped.resize(finest.width(), finest.height())?;
        light.apply_clipped(finest, from, self.ranges, unclipped, self.execution)?;
        self.prev.reduce_again(self.execution)?;
        let most = FEW_CLIPPED * unclipped.data().len() as f32;
        let few = |clipped: usize| (clipped as f32) < most;
        let mut clipped = weights::zeros(unclipped);
        if let Some([low, high]) = self.ranges[1] {
            // What rounding leaves of a limit.
            let margin = 1e-3 * (high - low);
            let (next, limits) = (&self.next.levels()[0], [low + margin, high - margin]);
            // Nine pixels are beside each.
            if few(clipped + 9 * weights::at_limits(next, limits)) {
                return Ok(());
            }
            weights::near_limits(next, limits, near)?;
            weights::drop_leading(unclipped, near, [u, v], from);
            clipped = weights::zeros(unclipped);
        }
        if few(clipped) {
            return Ok(());
        }
        if self.weighted {
            for (to, given) in unclipped.data_mut().iter_mut().zip(weights[0].data()) {
                *to *= given;
            }
        }
        self.weighted = true;
        weights::pyramid(unclipped, self.prev, weights)
    }

    /// Give `prev` the light of `next`, as the flow so far sees it.
    pub(super) fn relight_level(&mut self, level: usize) -> Result<()> {
        let Workspace {
            flow: [u, v],
            light,
            weights,
            ..
        } = &mut *self.memory;
        let weight = self.weighted.then(|| &weights[level]);
        let (prev, next) = (&self.prev.levels()[level], &self.next.levels()[level]);
        let simd = self.execution.simd_level();
        light.estimate(
            Views {
                prev,
                next,
                u,
                v,
                halved: None,
                weight,
            },
            LIGHT_RADII,
            simd,
        )?;
        light.apply(&mut self.prev.levels_mut()[level]);
        Ok(())
    }
}
