//! One point whose surroundings turn, grow or shear: Lucas-Kanade with an affine warp of the window.
//!
//! S. Baker and I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004: the inverse compositional
//! step, whose normal equations belong to the template and are made once a level. The lighting model has its unknowns
//! in the same least squares.

use std::cell::Cell;

use crate::frame::Plane;
use crate::simd::{SimdLevel, dispatch};
use crate::support::Support;
use crate::track::affine::factor::{Factor, Step, UNKNOWNS};
use crate::track::affine::meeting::{Counting, Meeting};
use crate::track::affine::sample::{Copied, Filter, SampleWarped};
use crate::track::affine::sums::{Project, Square};
use crate::track::affine::template::{Correlation, Differentiate, Samples, Template, stride};
use crate::track::affine::warp::{Positions, Warp};
use crate::track::noise::Gradients;
use crate::track::normal::{SIMPLER, unit_noise};
use crate::track::patch::Light;
use crate::track::patch::Window;

/// Share of a window's pixels that must count.
const LEAST_COUNTING: f64 = 0.125;

/// Share of the window's variance that may be left from so many steps on: on the way to any warp, and to one that has to be
/// better than a displacement, which says more than its window.
const HOPE: (usize, f64) = (1, 0.2);
const HOPE_TO_WIN: (usize, f64) = (2, 0.3);

/// How many times as much as at the end may be left after the first step, and after the others.
const FIRST_LEFT: f64 = 1.5;
const STILL_LEFT: f64 = 1.2;

/// Memory of one thread.
#[derive(Debug)]
pub(in crate::track) struct Aligner {
    samples: Samples,
    pub(in crate::track) copied: Copied,
    counting: Counting,
    template: Template,
}

/// What one level is asked.
#[derive(Debug, Clone, Copy)]
pub(in crate::track) struct Input<'a> {
    pub(in crate::track) from: &'a Plane,
    pub(in crate::track) to: &'a Plane,
    pub(in crate::track) from_support: &'a Support,
    pub(in crate::track) to_support: &'a Support,
    pub(in crate::track) filter: Filter,
    pub(in crate::track) centre: [f64; 2],
    pub(in crate::track) start: Warp,
    pub(in crate::track) window: Window,
    pub(in crate::track) light: Light,
    pub(in crate::track) iterations: usize,
    /// Length of a step at the window's rim, in pixels, that is short enough.
    pub(in crate::track) tolerance: f64,
    /// What may be left at the end, as a mean square.
    pub(in crate::track) most_left: f64,
    pub(in crate::track) level: SimdLevel,
}

/// What one level answers.
#[derive(Debug, Clone, Copy)]
pub(in crate::track) struct Output {
    pub(in crate::track) warp: Warp,
    pub(in crate::track) gain: f64,
    /// Mean square of what is left, and of the window without what an offset and its slopes explain, times the squared
    /// gain.
    pub(in crate::track) variance: f64,
    pub(in crate::track) signal: f64,
    /// Covariance of the displacement where what is left has variance 1 a pixel and no correlation: xx, xy, yy.
    pub(in crate::track) unit_covariance: [f64; 3],
}

thread_local! {
    static KEPT: Cell<Option<Box<Aligner>>> = const { Cell::new(None) };
}

impl Aligner {
    /// Call `work` with memory that the next call of this thread has again.
    pub(in crate::track) fn with<R>(work: impl FnOnce(&mut Self) -> R) -> R {
        let mut aligner = KEPT.take().unwrap_or_else(|| Box::new(Self::new()));
        let result = work(&mut aligner);
        KEPT.set(Some(aligner));
        result
    }

    fn new() -> Self {
        Self {
            samples: [0.0; _],
            copied: Copied::new(),
            counting: Counting::new(),
            template: Template::new(),
        }
    }

    /// Align a window on one level; `None` where its texture does not fix a warp, or the steps lead nowhere.
    pub(in crate::track) fn align(&mut self, input: &Input<'_>) -> Option<Output> {
        let Input { window, to, .. } = *input;
        if !self.build(input) {
            return None;
        }
        let mut met = Meeting::Whole;
        let mut equations = self.equations(met, input)?;
        let half = 0.5 * window.width.max(window.height) as f64;
        let reach = half + 2.0;
        let mut warp = input.start;
        let mut last = f64::INFINITY;
        for iteration in 0..input.iterations {
            let at = [
                input.centre[0] + warp.shift[0],
                input.centre[1] + warp.shift[1],
            ];
            let near = at[0] >= -half
                && at[1] >= -half
                && at[0] <= to.width() as f64 - 1.0 + half
                && at[1] <= to.height() as f64 - 1.0 + half;
            if !near {
                return None;
            }
            let positions = Positions::around(at, warp.matrix, window, 0);
            if !self.sample(to, positions, input) {
                return None;
            }
            let meeting = self
                .counting
                .meet(input.to_support, &positions, input.level);
            if meeting != met {
                met = meeting;
                equations = self.equations(met, input)?;
            }
            let (sums, squared) = self.project(met, input.level);
            if !squared.is_finite() {
                return None;
            }
            let step = Step::new(&equations.normal, &sums, squared);
            let next = step.apply(warp, half);
            let size = step.size();
            let start = input.start.shift;
            let moved = (next.shift[0] - start[0]).hypot(next.shift[1] - start[1]);
            if !next.is_plausible() || moved > reach || moved.is_nan() {
                return None;
            }
            let area = equations.area;
            let signal = step.gain * step.gain * equations.normal.contrast / area;
            let left = equations.normal.variance(step.left, area);
            if is_hopeless(iteration, left, signal, input.most_left) {
                return None;
            }
            // Steps shrink by a steady factor, so this is how far the rest of them would lead.
            let factor = (size / last).max(0.2);
            if factor < 1.0 && size * factor / (1.0 - factor) < input.tolerance {
                return Some(equations.output(input, warp, (sums, squared), step));
            }
            warp = next;
            last = size;
        }
        None
    }

    /// Sample `plane` at `positions`.
    fn sample(&mut self, plane: &Plane, positions: Positions, input: &Input<'_>) -> bool {
        let kernel = SampleWarped {
            plane,
            positions,
            filter: input.filter,
            copied: &mut self.copied,
            to: &mut self.samples,
            stride: stride(positions.columns),
        };
        dispatch(input.level, kernel)
    }

    /// The normal equations of the pixels that count.
    fn equations(&self, met: Meeting, input: &Input<'_>) -> Option<Equations> {
        let count = input.window.area();
        let area = match met {
            Meeting::Whole => count,
            Meeting::Part { counting, .. } => counting as f64,
        };
        if area < LEAST_COUNTING * count {
            return None;
        }
        let kernel = Square {
            template: &self.template,
            keep: self.counting.keep(met),
            lit: input.light.has_offset(),
        };
        let square = dispatch(input.level, kernel);
        let normal = Factor::new(&square, input.light)?;
        Some(Equations {
            square,
            normal,
            area,
        })
    }

    /// Sums of the difference with what each unknown changes, and squared.
    fn project(&self, met: Meeting, level: SimdLevel) -> ([f64; UNKNOWNS], f64) {
        let kernel = Project {
            template: &self.template,
            samples: &self.samples,
            keep: self.counting.keep(met),
        };
        dispatch(level, kernel)
    }

    /// How the derivatives of the template that was built last go together.
    pub(in crate::track) fn gradients(&self, level: SimdLevel) -> Gradients {
        dispatch(level, Correlation(&self.template))
    }

    /// Fill the template.
    fn build(&mut self, input: &Input<'_>) -> bool {
        let window = input.window;
        let positions = Positions::around(input.centre, Warp::IDENTITY, window, 1);
        if !self.sample(input.from, positions, input) {
            return false;
        }
        // One more stands before the window's own first sample.
        let first = positions.first.map(|at| at + 1.0);
        self.counting.begin(input.from_support, first, window);
        let kernel = Differentiate {
            samples: &self.samples,
            window,
            template: &mut self.template,
        };
        dispatch(input.level, kernel);
        true
    }
}

/// Whether what is left after so many steps tells that they lead nowhere.
fn is_hopeless(steps: usize, left: f64, signal: f64, most_left: f64) -> bool {
    let (first, share) = if most_left.is_infinite() {
        HOPE
    } else {
        HOPE_TO_WIN
    };
    let times = if steps == 0 { FIRST_LEFT } else { STILL_LEFT };
    left > times * most_left || steps >= first && left > share * signal
}

/// The least squares over the pixels that count.
struct Equations {
    square: [[f64; UNKNOWNS]; UNKNOWNS],
    normal: Factor,
    /// How many pixels that are.
    area: f64,
}

impl Equations {
    /// The answer where `step` is the last one, from `warp`: under the simplest lighting model that the window does not
    /// speak against, as for a displacement alone.
    fn output(
        &self,
        input: &Input<'_>,
        warp: Warp,
        (sums, squared): ([f64; UNKNOWNS], f64),
        step: Step,
    ) -> Output {
        let limit = unit_noise(self.normal.variance(step.left, self.area));
        let models = if input.light.has_tilt() {
            &SIMPLER[..]
        } else {
            &[]
        };
        let simpler = models.iter().find_map(|(simple, quantile)| {
            let normal = Factor::new(&self.square, *simple)?;
            let taken = Step::new(&normal, &sums, squared);
            (taken.left - step.left <= quantile * limit).then_some((normal, taken))
        });
        let (normal, step) = match &simpler {
            Some((normal, step)) => (normal, step),
            None => (&self.normal, &step),
        };
        let Window { width, height } = input.window;
        let warp = step.apply(warp, 0.5 * width.max(height) as f64);
        let gain = step.gain;
        Output {
            warp,
            gain,
            variance: normal.variance(step.left, self.area),
            signal: gain * gain * normal.contrast / self.area,
            unit_covariance: normal.covariance(&warp, gain),
        }
    }
}
