//! One point: down the levels.
//!
//! `docs/algorithms.md`, section "One window".

use std::cell::Cell;

use crate::frame::Plane;
use crate::simd::{SimdLevel, dispatch};
use crate::support::Support;
use crate::track::normal::{Normal, Step};
use crate::track::options::{PointStatus, TrackOptions, TrackedPoint};
use crate::track::patch::Light;
use crate::track::patch::{
    BorderScratch, BuildTemplate, Compare, Place, Sampling, SumAgain, Sums, Template, Window,
};

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

/// Memory of one thread.
#[derive(Debug)]
pub(crate) struct Workspace {
    template: Template,
    scratch: BorderScratch,
}

thread_local! {
    static KEPT: Cell<Option<Box<Workspace>>> = const { Cell::new(None) };
}

impl Workspace {
    /// Call `work` with memory that the next call of this thread has again.
    pub(crate) fn with<R>(work: impl FnOnce(&mut Self) -> R) -> R {
        let mut workspace = KEPT.take().unwrap_or_else(|| Box::new(Self::new()));
        let result = work(&mut workspace);
        KEPT.set(Some(workspace));
        result
    }

    fn new() -> Self {
        Self {
            template: Template::new(),
            scratch: BorderScratch::new(),
        }
    }
}

/// Both pyramids and how to compare them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub(crate) prev: &'a [Plane],
    pub(crate) next: &'a [Plane],
    /// Which pixels of each level count.
    pub(crate) prev_support: &'a [Support],
    pub(crate) next_support: &'a [Support],
    /// Whether a mask says which pixels of `next` count.
    pub(crate) masked: bool,
    pub(crate) options: &'a TrackOptions,
    pub(crate) level: SimdLevel,
}

/// Pyramids in the order of the search.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction<'a> {
    pub(super) from: &'a [Plane],
    pub(super) to: &'a [Plane],
    pub(super) from_support: &'a [Support],
    pub(super) to_support: &'a [Support],
}

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
        [
            self.before[0] + step.delta[0],
            self.before[1] + step.delta[1],
        ]
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
        let way = self.forward();
        let descent = self.descend::<false>(way, point, guess, top, workspace);
        match self.fine(
            way,
            point,
            descent.displacement,
            self.tolerance(),
            workspace,
        ) {
            Ok(rest) => {
                let fit = self.settle(&rest, &workspace.template);
                self.conclude(point, descent.entry, top, &fit, workspace)
            }
            Err(status) => TrackedPoint::lost(status),
        }
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
        let way = self.forward();
        let mut best: Option<Descent> = None;
        for guess in candidates {
            let descent = self.descend::<true>(way, point, *guess, top, workspace);
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
        match self.fine(way, point, found, self.tolerance(), workspace) {
            Ok(rest) => {
                let fit = self.settle(&rest, &workspace.template);
                self.conclude(point, entry, top, &fit, workspace)
            }
            Err(status) => TrackedPoint::lost(status),
        }
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
        match self.fine(self.forward(), point, guess, self.tolerance(), workspace) {
            Ok(rest) => {
                let fit = self.settle(&rest, &workspace.template);
                self.conclude(point, guess, RETURN_LEVEL, &fit, workspace)
            }
            Err(status) => TrackedPoint::lost(status),
        }
    }

    pub(super) fn forward(&self) -> Direction<'_> {
        Direction {
            from: self.prev,
            to: self.next,
            from_support: self.prev_support,
            to_support: self.next_support,
        }
    }

    pub(super) fn backward(&self) -> Direction<'_> {
        Direction {
            from: self.next,
            to: self.prev,
            from_support: self.next_support,
            to_support: self.prev_support,
        }
    }

    /// How far the steps that are left out may lead, in pixels.
    pub(super) fn tolerance(&self) -> f64 {
        0.5 * f64::from(self.options.epsilon)
    }

    /// The displacement after the coarse levels from `top` down, and, to `RANK` it, the share of the window's variance
    /// that it leaves unexplained on the last of them.
    fn descend<const RANK: bool>(
        &self,
        way: Direction<'_>,
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
            if let Some((found, left)) = self.coarse::<RANK>(way, level, centre, guess, workspace) {
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
        way: Direction<'_>,
        level: usize,
        centre: [f32; 2],
        guess: [f64; 2],
        workspace: &mut Workspace,
    ) -> Option<([f64; 2], f64)> {
        let window = coarse_window(self.options.window);
        let light = Light::of(self.options.illumination);
        let centre = self.build(
            way,
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
                    way,
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
            displacement = [
                displacement[0] + step.delta[0],
                displacement[1] + step.delta[1],
            ];
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
        let way = self.backward();
        let start = guess.map(|component| -component);
        let top = top.min(RETURN_LEVEL);
        let mut displacement = self
            .descend::<false>(way, position, start, top, workspace)
            .displacement;
        let window = self.options.window.with_rim();
        let light = Light::of(self.options.illumination).with_tilt();
        let centre = self.build(way, 0, position, window, Sampling::Linear, light, workspace);
        let mut normal = Normal::new(&workspace.template, light)?;
        let mut last = f64::INFINITY;
        for _ in 0..self.options.max_iterations {
            let sums = self
                .compare(way, 0, centre, displacement, false, &mut normal, workspace)
                .ok()?;
            let step = normal.step(&sums);
            let size = length(step.delta);
            displacement = [
                displacement[0] + step.delta[0],
                displacement[1] + step.delta[1],
            ];
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
        way: Direction<'_>,
        centre: [f32; 2],
        guess: [f64; 2],
        tolerance: f64,
        workspace: &mut Workspace,
    ) -> Result<FinalStep, PointStatus> {
        let window = self.options.window.with_rim();
        let light = Light::of(self.options.illumination).with_tilt();
        self.build(way, 0, centre, window, Sampling::Spline, light, workspace);
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
            let sums = self.compare(way, 0, centre, displacement, true, &mut normal, workspace)?;
            if !sums.squared.is_finite() {
                return Err(PointStatus::NotFinite);
            }
            let step = normal.step(&sums);
            let size = length(step.delta);
            let before = displacement;
            displacement = [
                displacement[0] + step.delta[0],
                displacement[1] + step.delta[1],
            ];
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

    /// Build the template; where its centre is.
    #[allow(
        clippy::too_many_arguments,
        reason = "a level, a window, how to read it"
    )]
    fn build(
        &self,
        way: Direction<'_>,
        level: usize,
        centre: [f32; 2],
        window: Window,
        sampling: Sampling,
        light: Light,
        workspace: &mut Workspace,
    ) -> [f32; 2] {
        let centre = dispatch(
            self.level,
            BuildTemplate {
                template: &mut workspace.template,
                prev: &way.from[level],
                centre,
                window,
                sampling,
                light,
                scratch: &mut workspace.scratch,
            },
        );
        workspace.template.belongs_to(&way.from_support[level]);
        centre
    }

    /// The sums at `displacement`, over the pixels that count there; `normal` becomes theirs.
    #[allow(clippy::too_many_arguments, reason = "a level, a place, what to sum")]
    fn compare(
        &self,
        way: Direction<'_>,
        level: usize,
        centre: [f32; 2],
        displacement: [f64; 2],
        squared: bool,
        normal: &mut Normal,
        workspace: &mut Workspace,
    ) -> Result<Sums, PointStatus> {
        let to = &way.to[level];
        let at = [
            (f64::from(centre[0]) + displacement[0]) as f32,
            (f64::from(centre[1]) + displacement[1]) as f32,
        ];
        let template = &mut workspace.template;
        let half = template.window.half();
        let near = at[0] >= -half[0]
            && at[1] >= -half[1]
            && at[0] <= to.width() as f32 - 1.0 + half[0]
            && at[1] <= to.height() as f32 - 1.0 + half[1];
        if !near {
            return Err(PointStatus::OutOfFrame);
        }
        match template.meets(&way.to_support[level], at) {
            Place::Same => {}
            Place::Other => {
                dispatch(self.level, SumAgain(template));
                *normal = Normal::new(template, normal.model()).ok_or(PointStatus::LowTexture)?;
            }
            Place::Bare if !inside(to, at) => return Err(PointStatus::OutOfFrame),
            Place::Bare => {
                let [x, y] = at.map(|coordinate| coordinate.round() as isize);
                let stands = way.to_support[level].has_all((x, y), 1, 1);
                return Err(if self.masked && !stands {
                    PointStatus::Masked
                } else {
                    PointStatus::LowSupport
                });
            }
        }
        Ok(dispatch(
            self.level,
            Compare {
                template: &workspace.template,
                next: to,
                centre: at,
                squared,
                scratch: &mut workspace.scratch,
            },
        ))
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

impl Problem<'_> {
    /// Width and height of the frames.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.prev[0].width(), self.prev[0].height())
    }

    /// Whether `point` is inside of the frame.
    pub(crate) fn holds(&self, point: [f32; 2]) -> bool {
        inside(&self.prev[0], point)
    }
}

pub(super) fn inside(plane: &Plane, [x, y]: [f32; 2]) -> bool {
    x >= 0.0 && y >= 0.0 && x <= plane.width() as f32 - 1.0 && y <= plane.height() as f32 - 1.0
}
