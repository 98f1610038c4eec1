//! One point: down the levels, and the judgement of what was found.

use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::simd::{Level, dispatch};
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

/// Gains beyond which two windows are not the same thing in another light.
const GAIN_RANGE: (f64, f64) = (0.25, 4.0);

/// Variance left in the difference, as a share of the window's own, beyond which two windows do not match.
const MAX_UNEXPLAINED: f64 = 0.25;

/// Standard deviation of a position, in pixels along its worst direction, beyond which a window has no texture.
const MAX_DEVIATION: f64 = 0.5;

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

/// One step of the least squares.
#[derive(Debug, Clone, Copy)]
struct Step {
    by: [f64; 2],
    gain: f64,
    /// Sum of squares that is left after the step.
    left: f64,
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
        let fit = match self.follow(self.prev, self.next, point, start, workspace) {
            Ok(fit) => fit,
            Err(status) => return TrackedPoint::lost(status),
        };
        let position = [
            (f64::from(point[0]) + fit.displacement[0]) as f32,
            (f64::from(point[1]) + fit.displacement[1]) as f32,
        ];
        if let Err(status) = self.judge(&fit, position) {
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
                start.map(|component| -component),
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

    /// The displacement of the window around `point` from `from` to `to`, down all levels.
    fn follow(
        &self,
        from: &[Plane],
        to: &[Plane],
        point: [f32; 2],
        start: [f32; 2],
        workspace: &mut Workspace,
    ) -> Result<Fit, PointStatus> {
        let levels = from.len().min(to.len());
        let mut displacement = start.map(f64::from);
        for level in (1..levels).rev() {
            let scale = 1.0 / f64::from(1u32 << level);
            let guess = displacement.map(|component| component * scale);
            let centre = point.map(|coordinate| coordinate * scale as f32);
            if let Some(found) = self.coarse(&from[level], &to[level], centre, guess, workspace) {
                displacement = found.map(|component| component / scale);
            }
        }
        self.fine(&from[0], &to[0], point, displacement, workspace)
    }

    /// A rough displacement on a coarse level, if the window has one to offer.
    fn coarse(
        &self,
        from: &Plane,
        to: &Plane,
        centre: [f32; 2],
        guess: [f64; 2],
        workspace: &mut Workspace,
    ) -> Option<[f64; 2]> {
        let window = self.options.window;
        self.build(from, centre, Sampling::Linear, workspace);
        let normal = Normal::new(&workspace.template, window, self.options.illumination)?;
        let reach = f64::from(window.half()[0].max(window.half()[1])) + 1.0;
        let mut displacement = guess;
        let mut last = f64::INFINITY;
        for _ in 0..COARSE_ITERATIONS.min(self.options.max_iterations) {
            let sums = self.compare(to, centre, displacement, workspace)?;
            let step = normal.step(&sums);
            let length = step.by[0].hypot(step.by[1]);
            displacement = [displacement[0] + step.by[0], displacement[1] + step.by[1]];
            let moved = (displacement[0] - guess[0]).hypot(displacement[1] - guess[1]);
            if moved > reach || moved.is_nan() {
                return None;
            }
            if length < COARSE_EPSILON || length * length < COARSE_EPSILON * last {
                return Some(displacement);
            }
            last = length;
        }
        Some(displacement)
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
        self.build(from, centre, Sampling::Spline, workspace);
        let template = &workspace.template;
        if !template
            .tensor
            .iter()
            .chain(&template.intensity_sums)
            .all(|sum| sum.is_finite())
        {
            return Err(PointStatus::NotFinite);
        }
        let normal = Normal::new(template, window, self.options.illumination)
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
            let length = step.by[0].hypot(step.by[1]);
            displacement = [displacement[0] + step.by[0], displacement[1] + step.by[1]];
            // Steps shrink by a steady factor, so this is how far the rest of them would lead.
            let factor = (length / last).max(LEAST_FACTOR);
            if factor < 1.0 && length * factor / (1.0 - factor) < 0.5 * epsilon {
                return Ok(normal.fit(displacement, &step));
            }
            last = length;
        }
        Err(PointStatus::NotConverged)
    }

    fn build(&self, from: &Plane, centre: [f32; 2], sampling: Sampling, workspace: &mut Workspace) {
        dispatch(
            self.level,
            BuildTemplate {
                template: &mut workspace.template,
                prev: from,
                centre,
                window: self.options.window,
                sampling,
                illumination: self.options.illumination,
                scratch: &mut workspace.scratch,
            },
        );
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
        let half = self.options.window.half();
        let near = at[0] >= -half[0]
            && at[1] >= -half[1]
            && at[0] <= to.width() as f32 - 1.0 + half[0]
            && at[1] <= to.height() as f32 - 1.0 + half[1];
        near.then(|| {
            dispatch(
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

fn inside(plane: &Plane, [x, y]: [f32; 2]) -> bool {
    x >= 0.0 && y >= 0.0 && x <= plane.width() as f32 - 1.0 && y <= plane.height() as f32 - 1.0
}

/// The normal equations of one template, inverted.
#[derive(Debug, Clone, Copy)]
struct Normal {
    illumination: Illumination,
    area: f64,
    /// The inverse of the gradients' tensor: xx, xy, yy.
    inverse: [f64; 3],
    /// Sums of the squared intensity, and of its products with the gradients.
    intensity: [f64; 3],
}

impl Normal {
    /// `None` if the window's texture does not fix a displacement at all.
    fn new(template: &Template, window: Window, illumination: Illumination) -> Option<Self> {
        let [xx, xy, yy] = template.tensor;
        let determinant = xx * yy - xy * xy;
        let trace = xx + yy;
        // Beyond this condition single precision has no digit left for the weak direction.
        if determinant <= 1e-10 * trace * trace || determinant.is_nan() {
            return None;
        }
        Some(Self {
            illumination,
            area: f64::from(window.area()),
            inverse: [yy / determinant, -xy / determinant, xx / determinant],
            intensity: template.intensity_sums,
        })
    }

    fn times_inverse(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [xx, xy, yy] = self.inverse;
        [xx * x + xy * y, xy * x + yy * y]
    }

    /// The step for these sums. With d = next - prev, motion by s and a gain g and an offset in the light,
    /// d = (g - 1) a + offset - g grad(a).s, and the gradients hold nothing that a or a constant explains.
    fn step(&self, sums: &Sums) -> Step {
        let scaled = self
            .times_inverse(sums.gradient)
            .map(|component| -component);
        let mut left = sums.squared + scaled[0] * sums.gradient[0] + scaled[1] * sums.gradient[1];
        let mut gain = 1.0;
        if self.illumination != Illumination::None {
            left -= sums.plain * sums.plain / self.area;
        }
        let [aa, ax, ay] = self.intensity;
        if self.illumination == Illumination::GainOffset && aa > 0.0 {
            left -= sums.intensity * sums.intensity / aa;
            gain += (sums.intensity + scaled[0] * ax + scaled[1] * ay) / aa;
        }
        let usable = gain.clamp(GAIN_RANGE.0, GAIN_RANGE.1);
        Step {
            by: scaled.map(|component| component / usable),
            gain,
            left: left.max(0.0),
        }
    }

    fn fit(&self, displacement: [f64; 2], step: &Step) -> Fit {
        let unknowns = match self.illumination {
            Illumination::None => 2.0,
            Illumination::Offset => 3.0,
            Illumination::GainOffset => 4.0,
        };
        let variance = step.left / (self.area - unknowns).max(1.0);
        let gain = step.gain;
        Fit {
            displacement,
            variance,
            signal: gain * gain * self.intensity[0] / self.area,
            covariance: self.inverse.map(|entry| entry * variance / (gain * gain)),
            gain,
        }
    }
}
