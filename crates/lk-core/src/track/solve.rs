//! One point: down the levels, and the judgement of what was found.

use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::simd::{Level, dispatch_eight};
use crate::track::normal::{GAIN_RANGE, Normal, Step};
use crate::track::options::{PointStatus, TrackOptions, TrackedPoint};
use crate::track::patch::{
    BorderScratch, BuildTemplate, Compare, Sampling, Sums, Template, Window,
};

/// Length of a step, in pixels of the level, that is enough on a coarse level: the next level refines anyway.
const COARSE_EPSILON: f64 = 0.1;

/// Steps on a coarse level: one that has not come to rest by then has nothing to hold on to.
const COARSE_ITERATIONS: usize = 8;

/// Steps cannot be trusted to shrink faster than by this factor, however the last two compare.
const LEAST_FACTOR: f64 = 0.2;

/// Variance left in the difference, as a share of the window's own, beyond which two windows do not match.
const MAX_UNEXPLAINED: f64 = 0.25;

/// Standard deviation of a position, in pixels along its worst direction, beyond which a window has no texture.
const MAX_DEVIATION: f64 = 0.5;

/// The coarsest level of a second try: its starts are right to a few pixels.
const RETRY_LEVEL: usize = 3;

/// Memory of one thread.
#[derive(Debug)]
pub(crate) struct Workspace {
    template: Template,
    scratch: BorderScratch,
}

impl Workspace {
    pub(crate) fn new() -> Self {
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
    pub(crate) options: &'a TrackOptions,
    pub(crate) level: Level,
}

/// A displacement that was found, and how well it fits.
#[derive(Debug, Clone, Copy)]
struct Fit {
    displacement: [f64; 2],
    /// Mean square difference that is left, in square grey levels.
    variance: f64,
    /// Variance of the window in `prev`, times the gain squared.
    signal: f64,
    /// Covariance of the displacement for that variance: xx, xy, yy.
    covariance: [f64; 3],
    gain: f64,
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
        match self.follow(self.prev, self.next, point, guess, top, workspace) {
            Ok(fit) => self.conclude(point, guess, top, &fit, workspace),
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
        let mut best: Option<(f64, [f64; 2], [f64; 2])> = None;
        for guess in candidates {
            let (found, unexplained) =
                self.descend(self.prev, self.next, point, *guess, top, workspace);
            if best.is_none_or(|(least, ..)| unexplained < least) {
                best = Some((unexplained, found, *guess));
            }
        }
        let Some((_, found, guess)) = best else {
            return TrackedPoint::lost(PointStatus::HighResidual);
        };
        match self.fine(&self.prev[0], &self.next[0], point, found, workspace) {
            Ok(fit) => self.conclude(point, guess, top, &fit, workspace),
            Err(status) => TrackedPoint::lost(status),
        }
    }

    /// Judge what was found for `point` from the displacement `guess` on the level `top`.
    fn conclude(
        &self,
        point: [f32; 2],
        guess: [f64; 2],
        top: usize,
        fit: &Fit,
        workspace: &mut Workspace,
    ) -> TrackedPoint {
        let position = [
            (f64::from(point[0]) + fit.displacement[0]) as f32,
            (f64::from(point[1]) + fit.displacement[1]) as f32,
        ];
        if let Err(status) = self.judge(fit, position) {
            return TrackedPoint {
                residual: fit.variance.sqrt() as f32,
                ..TrackedPoint::lost(status)
            };
        }
        let mut forward_backward = f32::NAN;
        if let Some(limit) = self.options.max_forward_backward {
            let back = self.follow(
                self.next,
                self.prev,
                position,
                guess.map(|component| -component),
                top,
                workspace,
            );
            if let Ok(back) = back {
                let dx = fit.displacement[0] + back.displacement[0];
                let dy = fit.displacement[1] + back.displacement[1];
                forward_backward = dx.hypot(dy) as f32;
            }
            // Also where nothing came back, and the distance is NaN.
            if forward_backward.is_nan() || forward_backward > limit {
                return TrackedPoint {
                    residual: fit.variance.sqrt() as f32,
                    forward_backward,
                    ..TrackedPoint::lost(PointStatus::ForwardBackward)
                };
            }
        }
        TrackedPoint {
            position,
            status: PointStatus::Tracked,
            residual: fit.variance.sqrt() as f32,
            covariance: fit.covariance.map(|value| value as f32),
            forward_backward,
        }
    }

    fn judge(&self, fit: &Fit, position: [f32; 2]) -> Result<(), PointStatus> {
        if !inside(&self.next[0], position) {
            return Err(PointStatus::OutOfFrame);
        }
        if let Some(longest) = self.options.max_displacement
            && fit.displacement[0].hypot(fit.displacement[1]) > f64::from(longest)
        {
            return Err(PointStatus::NotConverged);
        }
        if fit.variance > MAX_UNEXPLAINED * fit.signal
            || fit.gain < GAIN_RANGE.0
            || fit.gain > GAIN_RANGE.1
        {
            return Err(PointStatus::HighResidual);
        }
        let [xx, xy, yy] = fit.covariance;
        let worst = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        if worst > MAX_DEVIATION * MAX_DEVIATION {
            return Err(PointStatus::LowTexture);
        }
        Ok(())
    }

    /// The displacement of the window around `point` from `from` to `to`, from the level `top` down.
    fn follow(
        &self,
        from: &[Plane],
        to: &[Plane],
        point: [f32; 2],
        guess: [f64; 2],
        top: usize,
        workspace: &mut Workspace,
    ) -> Result<Fit, PointStatus> {
        let (displacement, _) = self.descend(from, to, point, guess, top, workspace);
        self.fine(&from[0], &to[0], point, displacement, workspace)
    }

    /// The displacement after the coarse levels from `top` down, and the share of the window's variance that it leaves
    /// unexplained on the last of them.
    fn descend(
        &self,
        from: &[Plane],
        to: &[Plane],
        point: [f32; 2],
        guess: [f64; 2],
        top: usize,
        workspace: &mut Workspace,
    ) -> ([f64; 2], f64) {
        let mut displacement = guess;
        let mut unexplained = f64::INFINITY;
        for level in (1..=top).rev() {
            let scale = 1.0 / f64::from(1u32 << level);
            let guess = displacement.map(|component| component * scale);
            let centre = point.map(|coordinate| coordinate * scale as f32);
            unexplained = f64::INFINITY;
            if let Some((found, left)) =
                self.coarse(&from[level], &to[level], centre, guess, workspace)
            {
                displacement = found.map(|component| component / scale);
                unexplained = left;
            }
        }
        (displacement, unexplained)
    }

    /// A rough displacement on a coarse level, if the window has one to offer, and what it leaves unexplained.
    fn coarse(
        &self,
        from: &Plane,
        to: &Plane,
        centre: [f32; 2],
        guess: [f64; 2],
        workspace: &mut Workspace,
    ) -> Option<([f64; 2], f64)> {
        let window = coarse_window(self.options.window);
        let centre = self.build(from, centre, window, Sampling::Linear, workspace);
        let normal = Normal::new(&workspace.template, self.options.illumination, false)?;
        let reach = f64::from(window.half()[0].max(window.half()[1])) + 1.0;
        let mut displacement = guess;
        let mut last = f64::INFINITY;
        let iterations = COARSE_ITERATIONS.min(self.options.max_iterations);
        for iteration in 1..=iterations {
            let sums = self.compare(to, centre, displacement, workspace)?;
            let step = normal.step(&sums);
            let size = length(step.by);
            displacement = [displacement[0] + step.by[0], displacement[1] + step.by[1]];
            let moved = length([displacement[0] - guess[0], displacement[1] - guess[1]]);
            if moved > reach || moved.is_nan() {
                return None;
            }
            if size < COARSE_EPSILON
                || size * size < COARSE_EPSILON * last
                || iteration == iterations
            {
                return Some((displacement, normal.variance(&step) / normal.signal(&step)));
            }
            last = size;
        }
        None
    }

    /// The displacement on the finest level, and how well it fits.
    fn fine(
        &self,
        from: &Plane,
        to: &Plane,
        centre: [f32; 2],
        guess: [f64; 2],
        workspace: &mut Workspace,
    ) -> Result<Fit, PointStatus> {
        let window = self.options.window;
        self.build(from, centre, window, Sampling::Spline, workspace);
        let template = &workspace.template;
        if !template.sums.products.iter().all(|sum| sum.is_finite()) {
            return Err(PointStatus::NotFinite);
        }
        let normal = Normal::new(template, self.options.illumination, true)
            .ok_or(PointStatus::LowTexture)?;
        let epsilon = f64::from(self.options.epsilon);
        let mut displacement = guess;
        let mut last = f64::INFINITY;
        for _ in 0..self.options.max_iterations {
            let sums = self
                .compare(to, centre, displacement, workspace)
                .ok_or(PointStatus::OutOfFrame)?;
            if !sums.squared.is_finite() {
                return Err(PointStatus::NotFinite);
            }
            let step = normal.step(&sums);
            let size = length(step.by);
            let before = displacement;
            displacement = [displacement[0] + step.by[0], displacement[1] + step.by[1]];
            // Steps shrink by a steady factor, so this is how far the rest of them would lead.
            let factor = (size / last).max(LEAST_FACTOR);
            if factor < 1.0 && size * factor / (1.0 - factor) < 0.5 * epsilon {
                let template = &workspace.template;
                let (normal, step) =
                    simplest(template, self.options.illumination, &sums, (normal, step));
                let displacement = [before[0] + step.by[0], before[1] + step.by[1]];
                return Ok(Fit::new(&normal, &step, displacement));
            }
            last = size;
        }
        Err(PointStatus::NotConverged)
    }

    /// Build the template; where its centre is.
    fn build(
        &self,
        from: &Plane,
        centre: [f32; 2],
        window: Window,
        sampling: Sampling,
        workspace: &mut Workspace,
    ) -> [f32; 2] {
        dispatch_eight(
            self.level,
            BuildTemplate {
                template: &mut workspace.template,
                prev: from,
                centre,
                window,
                sampling,
                scratch: &mut workspace.scratch,
            },
        )
    }

    /// The sums at `displacement`, unless the window has left the frame there.
    fn compare(
        &self,
        to: &Plane,
        centre: [f32; 2],
        displacement: [f64; 2],
        workspace: &mut Workspace,
    ) -> Option<Sums> {
        let at = [
            (f64::from(centre[0]) + displacement[0]) as f32,
            (f64::from(centre[1]) + displacement[1]) as f32,
        ];
        let half = workspace.template.window.half();
        let near = at[0] >= -half[0]
            && at[1] >= -half[1]
            && at[0] <= to.width() as f32 - 1.0 + half[0]
            && at[1] <= to.height() as f32 - 1.0 + half[1];
        near.then(|| {
            dispatch_eight(
                self.level,
                Compare {
                    template: &workspace.template,
                    next: to,
                    centre: at,
                    scratch: &mut workspace.scratch,
                },
            )
        })
    }
}

impl Fit {
    fn new(normal: &Normal, step: &Step, displacement: [f64; 2]) -> Self {
        let variance = normal.variance(step);
        Self {
            displacement,
            variance,
            signal: normal.signal(step),
            covariance: normal.unit_covariance(step).map(|entry| entry * variance),
            gain: step.gain,
        }
    }
}

/// Lighting models within "gain_offset", the simplest first, and how much more than the full one they may leave: the
/// 90 % quantile of chi squared for the 4, 3 and 2 unknowns that they lack.
const SIMPLER: [(Illumination, f64); 3] = [
    (Illumination::None, 7.78),
    (Illumination::Offset, 6.25),
    (Illumination::GainOffset, 4.61),
];

/// The last step again under the simplest lighting model that the window does not speak against: an unknown that is
/// not there costs accuracy.
fn simplest(
    template: &Template,
    illumination: Illumination,
    sums: &Sums,
    full: (Normal, Step),
) -> (Normal, Step) {
    if illumination != Illumination::GainOffset {
        return full;
    }
    let unit = full.0.noise(&full.1);
    for (model, limit) in SIMPLER {
        if let Some(normal) = Normal::new(template, model, false) {
            let step = normal.step(sums);
            if step.left - full.1.left <= limit * unit {
                return (normal, step);
            }
        }
    }
    full
}

/// The window of coarse levels, which only lead to the finest: about two thirds of it, and even, so that it and the
/// pixels on both sides fill whole lanes.
fn coarse_window(window: Window) -> Window {
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

fn inside(plane: &Plane, [x, y]: [f32; 2]) -> bool {
    x >= 0.0 && y >= 0.0 && x <= plane.width() as f32 - 1.0 && y <= plane.height() as f32 - 1.0
}
