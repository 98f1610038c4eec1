//! One point whose surroundings turn, grow or shear: down the levels from given warps, and the judgement.

use crate::track::affine::align::{Aligner, Input, Output};
use crate::track::affine::sample::Filter;
use crate::track::affine::warp::Warp;
use crate::track::noise::{Samples, noise_gain};
use crate::track::options::{Deformation, PointStatus, TrackedPoint};
use crate::track::patch::Light;
use crate::track::problem::{Direction, Problem};
use crate::track::solve::coarse_window;
use crate::track::verify::{Fit, RETURN_SHARE};

/// A warp must leave less than this share of what a displacement leaves to take its place: its four more unknowns
/// explain about so much of what is noise.
const LESS_LEFT: f64 = 0.92;

/// Share of the variance that a warp may leave: its unknowns explain some of any window.
const MAX_UNEXPLAINED: f64 = 0.1;

/// Share of the variance that a warp may leave on the last coarse level to be worth the finest one.
const HOPEFUL: f64 = 0.15;

/// Steps on a coarse level, and the length of one that is enough.
const COARSE_ITERATIONS: usize = 8;
const COARSE_TOLERANCE: f64 = 0.05;

/// Starts for one point.
const MAX_STARTS: usize = 4;

/// A warp to start from, and the level that it is good for.
#[derive(Debug, Clone, Copy)]
pub(in crate::track) struct Start {
    warp: Warp,
    level: usize,
}

/// Where to start one point.
#[derive(Debug)]
pub(in crate::track) struct Starts {
    list: [Start; MAX_STARTS],
    count: usize,
}

impl Starts {
    pub(in crate::track) fn new() -> Self {
        let none = Start {
            warp: Warp::shift([0.0; 2]),
            level: 0,
        };
        Self {
            list: [none; MAX_STARTS],
            count: 0,
        }
    }

    /// Add one, if there is room.
    pub(in crate::track) fn add(&mut self, warp: Warp, level: usize) {
        if self.count < MAX_STARTS {
            self.list[self.count] = Start { warp, level };
            self.count += 1;
        }
    }

    pub(in crate::track) fn list(&self) -> &[Start] {
        &self.list[..self.count]
    }
}

/// Where one point went, and how its window is deformed there.
#[derive(Debug, Clone, Copy)]
pub(in crate::track) struct Found {
    pub(in crate::track) track: TrackedPoint,
    pub(in crate::track) warp: Warp,
}

/// What came of a try.
#[derive(Debug, Clone, Copy)]
pub(in crate::track) enum Outcome {
    Found(Found),
    /// Nothing, and other starts are not worth a try: from a good one no warp is better than the displacement.
    Settled,
    Nothing,
}

impl Problem<'_> {
    /// Track `point` from the best of `starts`, if that is better than `before`.
    pub(in crate::track) fn deform(
        &self,
        point: [f32; 2],
        before: &TrackedPoint,
        starts: &[Start],
        aligner: &mut Aligner,
    ) -> Outcome {
        let mut best: Option<(f64, Warp, Start)> = None;
        for start in starts {
            let (warp, unexplained) = self.lead(self.forward(), point, *start, aligner);
            if best.is_none_or(|(least, ..)| unexplained < least) {
                best = Some((unexplained, warp, *start));
            }
            if unexplained < MAX_UNEXPLAINED {
                break;
            }
        }
        let Some((unexplained, warp, start)) = best else {
            return Outcome::Nothing;
        };
        if start.level > 0 && !before.is_valid() && (unexplained > HOPEFUL || unexplained.is_nan())
        {
            return Outcome::Nothing;
        }
        let rival = f64::from(before.residual);
        // What is left has to be less than what a displacement leaves.
        let must_win = before.is_valid() && self.options.deformation != Deformation::Affine;
        let most_left = if must_win {
            LESS_LEFT * rival * rival
        } else {
            f64::INFINITY
        };
        let output = self.finish(
            self.forward(),
            point,
            warp,
            (Filter::Spline, self.tolerance(), most_left),
            aligner,
        );
        let Some(output) = output.filter(|output| output.variance <= most_left) else {
            return if must_win && unexplained < MAX_UNEXPLAINED {
                Outcome::Settled
            } else {
                Outcome::Nothing
            };
        };
        match self.conclude_warp(point, &output, start, aligner) {
            Some(found) => Outcome::Found(found),
            None => Outcome::Nothing,
        }
    }

    /// Judge what was found for `point` from `start`.
    fn conclude_warp(
        &self,
        point: [f32; 2],
        output: &Output,
        start: Start,
        aligner: &mut Aligner,
    ) -> Option<Found> {
        let displacement = output.warp.shift;
        let position = [
            (f64::from(point[0]) + displacement[0]) as f32,
            (f64::from(point[1]) + displacement[1]) as f32,
        ];
        let window = self.options.window.with_rim();
        let half = window.half().map(f64::from);
        let samples = Samples {
            prev: [0, 1].map(|axis| f64::from(point[axis]) - half[axis]),
            next: None,
            spacing: output.warp.scale(),
        };
        let own = output.variance / (1.0 + output.gain * output.gain);
        let gradients = aligner.gradients(self.level);
        let scale = output.variance * noise_gain(&gradients, window, &samples, own);
        let fit = Fit {
            displacement,
            variance: output.variance,
            signal: output.signal,
            covariance: output.unit_covariance.map(|entry| entry * scale),
            gain: output.gain,
        };
        let unexplained = output.variance / output.signal;
        let residual = output.variance.sqrt() as f32;
        // The share is NaN where the window has no contrast.
        if self.judge(&fit, position).is_err()
            || unexplained.is_nan()
            || unexplained > MAX_UNEXPLAINED
        {
            return None;
        }
        let mut forward_backward = f32::NAN;
        if let Some(limit) = self.options.max_forward_backward {
            let tolerance = RETURN_SHARE * f64::from(limit);
            let back = Start {
                warp: start.warp.inverse(),
                level: start.level,
            };
            let (back, _) = self.lead(self.backward(), position, back, aligner);
            let filter = Filter::Linear;
            let back = self.finish(
                self.backward(),
                position,
                back,
                (filter, tolerance, f64::INFINITY),
                aligner,
            )?;
            let back = back.warp.shift;
            forward_backward = (displacement[0] + back[0]).hypot(displacement[1] + back[1]) as f32;
            if forward_backward.is_nan() || forward_backward > limit {
                return None;
            }
        }
        Some(Found {
            track: TrackedPoint {
                position,
                status: PointStatus::Tracked,
                residual,
                covariance: fit.covariance.map(|value| value as f32),
                forward_backward,
                deformation: output.warp.matrix.map(|row| row.map(|entry| entry as f32)),
                unexplained: unexplained as f32,
            },
            warp: output.warp,
        })
    }

    /// The warp after the coarse levels, and the share of the window's variance that it leaves on the last of them.
    fn lead(
        &self,
        direction: Direction<'_>,
        point: [f32; 2],
        start: Start,
        aligner: &mut Aligner,
    ) -> (Warp, f64) {
        let mut warp = start.warp;
        let mut unexplained = f64::INFINITY;
        for level in (1..=start.level.min(direction.from.len() - 1)).rev() {
            let factor = f64::from(1u32 << level);
            unexplained = f64::INFINITY;
            let input = Input {
                from: &direction.from[level],
                to: &direction.to[level],
                from_support: &direction.from_support[level],
                to_support: &direction.to_support[level],
                filter: Filter::Linear,
                centre: point.map(|coordinate| f64::from(coordinate) / factor),
                start: warp.scaled(1.0 / factor),
                window: coarse_window(self.options.window),
                light: Light::of(self.options.illumination),
                iterations: COARSE_ITERATIONS.min(self.options.max_iterations),
                tolerance: COARSE_TOLERANCE,
                most_left: f64::INFINITY,
                level: self.level,
            };
            if let Some(output) = aligner.align(&input) {
                warp = output.warp.scaled(factor);
                unexplained = output.variance / output.signal;
            }
        }
        (warp, unexplained)
    }

    /// The warp on the finest level.
    fn finish(
        &self,
        direction: Direction<'_>,
        point: [f32; 2],
        start: Warp,
        (filter, tolerance, most_left): (Filter, f64, f64),
        aligner: &mut Aligner,
    ) -> Option<Output> {
        aligner.align(&Input {
            from: &direction.from[0],
            to: &direction.to[0],
            from_support: &direction.from_support[0],
            to_support: &direction.to_support[0],
            filter,
            centre: point.map(f64::from),
            start,
            window: self.options.window.with_rim(),
            light: Light::of(self.options.illumination).with_tilt(),
            iterations: self.options.max_iterations,
            tolerance,
            most_left,
            level: self.level,
        })
    }
}
