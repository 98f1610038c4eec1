//! One point: down the levels.
//!
//! `docs/explanation/algorithms.md`, section "One window".

use crate::track::normal::{Normal, Step};
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::patch::{Light, Sampling, Sums, Window};
use crate::track::problem::{Direction, Problem, Workspace, inside};

/// Length of a step, in pixels of the level, that is enough on a coarse level: the next level refines anyway.
const COARSE_EPSILON: f64 = 0.1;

/// Steps on a coarse level: one that has not come to rest by then has nothing to hold on to.
const COARSE_ITERATIONS: usize = 8;

/// Steps cannot be trusted to shrink faster than by this factor, however the last two compare.
const LEAST_FACTOR: f64 = 0.2;

/// The coarsest level of a second try: its starts are right to a few pixels.
const RETRY_LEVEL: usize = 3;

/// The level on which the way back begins.
const RETURN_LEVEL: usize = 1;

/// A way down the coarse levels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Descent {
    pub(super) displacement: [f64; 2],
    /// From which displacement the level [`RETURN_LEVEL`], or the first one below it, was entered.
    pub(super) entry: [f64; 2],
    /// The share of the window's variance that is left on the last of the levels; infinite unless that was asked for.
    unexplained: f64,
}

/// The last step on the finest level.
#[derive(Debug, Clone, Copy)]
pub(super) struct FinalStep {
    /// The displacement before the step.
    pub(super) before: [f64; 2],
    /// The window's first sample in `next` there, and what was summed.
    pub(super) corner: [f64; 2],
    pub(super) sums: Sums,
    pub(super) normal: Normal,
}

impl FinalStep {
    /// The displacement after `step`.
    pub(super) fn after(&self, step: &Step) -> [f64; 2] {
        step.after(self.before)
    }
}

impl Problem<'_> {
    /// Track `point`, starting from the displacement `start`.
    pub(crate) fn track(
        &self,
        point: [f32; 2],
        start: [f32; 2],
        workspace: &mut Workspace,
    ) -> TrackedPoint {
        if !point.iter().chain(&start).all(|value| value.is_finite()) {
            return TrackedPoint::lost(PointStatus::NotFinite);
        }
        if !inside(&self.prev[0], point) {
            return TrackedPoint::lost(PointStatus::OutOfFrame);
        }
        let top = self.prev.len() - 1;
        let guess = start.map(f64::from);
        let descent = self.descend::<false>(self.forward(), point, guess, top, workspace);
        self.refine(point, descent.displacement, descent.entry, top, workspace)
    }

    /// Track `point` from the best of these displacements, which hold on the level `top`.
    pub(crate) fn retrack(
        &self,
        point: [f32; 2],
        candidates: &[[f64; 2]],
        top: usize,
        workspace: &mut Workspace,
    ) -> TrackedPoint {
        let top = top.clamp(1, RETRY_LEVEL).min(self.prev.len() - 1);
        let direction = self.forward();
        let mut best: Option<Descent> = None;
        for guess in candidates {
            let descent = self.descend::<true>(direction, point, *guess, top, workspace);
            if best.is_none_or(|best| descent.unexplained < best.unexplained) {
                best = Some(descent);
            }
        }
        let Some(Descent {
            displacement: found,
            entry,
            ..
        }) = best
        else {
            return TrackedPoint::lost(PointStatus::HighResidual);
        };
        self.refine(point, found, entry, top, workspace)
    }

    /// Where the finest level leads from the displacement `guess`, what is left there, and the window's own variance.
    pub(super) fn explains(
        &self,
        point: [f32; 2],
        guess: [f64; 2],
        workspace: &mut Workspace,
    ) -> Option<([f64; 2], f64, f64)> {
        let last = self.fine(self.forward(), point, guess, self.tolerance(), workspace);
        let fit = self.settle(&last.ok()?, &workspace.template);
        Some((fit.displacement, fit.variance, fit.signal))
    }

    /// Track `point` on the finest level alone, from the displacement `guess`.
    pub(super) fn take(
        &self,
        point: [f32; 2],
        guess: [f64; 2],
        workspace: &mut Workspace,
    ) -> TrackedPoint {
        self.refine(point, guess, guess, RETURN_LEVEL, workspace)
    }

    /// Track `point` on the finest level from the displacement `guess`, and judge what is found; `entry` and `top` are
    /// those of the way that led there.
    fn refine(
        &self,
        point: [f32; 2],
        guess: [f64; 2],
        entry: [f64; 2],
        top: usize,
        workspace: &mut Workspace,
    ) -> TrackedPoint {
        match self.fine(self.forward(), point, guess, self.tolerance(), workspace) {
            Ok(last) => {
                let fit = self.settle(&last, &workspace.template);
                self.conclude(point, entry, top, &fit, workspace)
            }
            Err(status) => TrackedPoint::lost(status),
        }
    }

    /// The displacement after the coarse levels from `top` down, and, to `RANK` it, the share of the window's variance
    /// that it leaves unexplained on the last of them.
    fn descend<const RANK: bool>(
        &self,
        direction: Direction<'_>,
        point: [f32; 2],
        guess: [f64; 2],
        top: usize,
        workspace: &mut Workspace,
    ) -> Descent {
        let (mut displacement, mut entry) = (guess, guess);
        let mut unexplained = f64::INFINITY;
        for level in (1..=top).rev() {
            if level == RETURN_LEVEL {
                entry = displacement;
            }
            let scale = 1.0 / f64::from(1u32 << level);
            let guess = displacement.map(|component| component * scale);
            let centre = point.map(|coordinate| coordinate * scale as f32);
            unexplained = f64::INFINITY;
            if let Some((found, left)) =
                self.coarse::<RANK>(direction, level, centre, guess, workspace)
            {
                displacement = found.map(|component| component / scale);
                unexplained = left;
            }
        }
        Descent {
            displacement,
            entry,
            unexplained,
        }
    }

    /// A rough displacement on a coarse level, if the window has one to offer, and what it leaves unexplained.
    fn coarse<const RANK: bool>(
        &self,
        direction: Direction<'_>,
        level: usize,
        centre: [f32; 2],
        guess: [f64; 2],
        workspace: &mut Workspace,
    ) -> Option<([f64; 2], f64)> {
        let window = coarse_window(self.options.window);
        let light = Light::of(self.options.illumination);
        let centre = self.build(
            direction,
            level,
            centre,
            window,
            Sampling::Linear,
            light,
            workspace,
        );
        let mut normal = Normal::new(&workspace.template, light)?;
        let reach = f64::from(window.half()[0].max(window.half()[1])) + 1.0;
        let mut displacement = guess;
        let mut last = f64::INFINITY;
        let iterations = COARSE_ITERATIONS.min(self.options.max_iterations);
        for iteration in 1..=iterations {
            let sums = self
                .compare(
                    direction,
                    level,
                    centre,
                    displacement,
                    RANK,
                    &mut normal,
                    workspace,
                )
                .ok()?;
            let step = normal.step(&sums);
            let size = length(step.delta);
            displacement = step.after(displacement);
            let moved = length([displacement[0] - guess[0], displacement[1] - guess[1]]);
            if moved > reach || moved.is_nan() {
                return None;
            }
            if size < COARSE_EPSILON
                || size * size < COARSE_EPSILON * last
                || iteration == iterations
            {
                let unexplained = if RANK {
                    normal.variance(normal.left(&sums)) / normal.signal(&step)
                } else {
                    f64::INFINITY
                };
                return Some((displacement, unexplained));
            }
            last = size;
        }
        None
    }

    /// How far from `point` the window around `position` comes back to, tracked on its own way.
    pub(super) fn come_back(
        &self,
        point: [f32; 2],
        position: [f32; 2],
        guess: [f64; 2],
        top: usize,
        tolerance: f64,
        workspace: &mut Workspace,
    ) -> Option<f64> {
        let direction = self.backward();
        let start = guess.map(|component| -component);
        let top = top.min(RETURN_LEVEL);
        let mut displacement = self
            .descend::<false>(direction, position, start, top, workspace)
            .displacement;
        let window = self.options.window.with_rim();
        let light = Light::of(self.options.illumination).with_tilt();
        let centre = self.build(
            direction,
            0,
            position,
            window,
            Sampling::Linear,
            light,
            workspace,
        );
        let mut normal = Normal::new(&workspace.template, light)?;
        let mut last = f64::INFINITY;
        for _ in 0..self.options.max_iterations {
            let sums = self
                .compare(
                    direction,
                    0,
                    centre,
                    displacement,
                    false,
                    &mut normal,
                    workspace,
                )
                .ok()?;
            let step = normal.step(&sums);
            let size = length(step.delta);
            displacement = step.after(displacement);
            let factor = (size / last).max(LEAST_FACTOR);
            if factor < 1.0 && size * factor / (1.0 - factor) < tolerance {
                let x = f64::from(position[0]) + displacement[0] - f64::from(point[0]);
                let y = f64::from(position[1]) + displacement[1] - f64::from(point[1]);
                return Some(length([x, y]));
            }
            last = size;
        }
        None
    }

    /// The displacement on the finest level, to `tolerance` pixels.
    fn fine(
        &self,
        direction: Direction<'_>,
        centre: [f32; 2],
        guess: [f64; 2],
        tolerance: f64,
        workspace: &mut Workspace,
    ) -> Result<FinalStep, PointStatus> {
        let window = self.options.window.with_rim();
        let light = Light::of(self.options.illumination).with_tilt();
        self.build(
            direction,
            0,
            centre,
            window,
            Sampling::Spline,
            light,
            workspace,
        );
        let template = &workspace.template;
        if !template.sums.products.iter().all(|sum| sum.is_finite()) {
            return Err(PointStatus::NotFinite);
        }
        let mut normal = Normal::new(template, light).ok_or_else(|| {
            // What is filled in around a few pixels that count has no texture of its own.
            if template.is_bare() {
                PointStatus::LowSupport
            } else {
                PointStatus::LowTexture
            }
        })?;
        let mut displacement = guess;
        let mut last = f64::INFINITY;
        for _ in 0..self.options.max_iterations {
            let sums = self.compare(
                direction,
                0,
                centre,
                displacement,
                true,
                &mut normal,
                workspace,
            )?;
            if !sums.squared.is_finite() {
                return Err(PointStatus::NotFinite);
            }
            let step = normal.step(&sums);
            let size = length(step.delta);
            let before = displacement;
            displacement = step.after(displacement);
            // Steps shrink by a steady factor, so this is how far the rest of them would lead.
            let factor = (size / last).max(LEAST_FACTOR);
            if factor < 1.0 && size * factor / (1.0 - factor) < tolerance {
                let half = window.half().map(f64::from);
                let corner = [0, 1].map(|axis| f64::from(centre[axis]) + before[axis] - half[axis]);
                return Ok(FinalStep {
                    before,
                    corner,
                    sums,
                    normal,
                });
            }
            last = size;
        }
        Err(PointStatus::NotConverged)
    }
}

/// The window of coarse levels, which only lead to the finest: about two thirds of it, and even, so that it and the
/// pixels on both sides fill whole lanes.
pub(super) fn coarse_window(window: Window) -> Window {
    let side = |pixels: usize| {
        if pixels <= 14 {
            pixels
        } else {
            (pixels * 2 / 3).next_multiple_of(8) - 2
        }
    };
    Window {
        width: side(window.width),
        height: side(window.height),
    }
}

fn length([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y).sqrt()
}
