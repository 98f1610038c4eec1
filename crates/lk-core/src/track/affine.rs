//! One point whose surroundings turn, grow or shear: Lucas-Kanade with an affine warp of the window.
//!
//! S. Baker and I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004: the inverse compositional
//! step, whose normal equations belong to the template and are made once a level. The lighting model has its unknowns
//! in the same least squares.

use std::cell::Cell;

use crate::frame::Plane;
use crate::simd::{EIGHT, Eight, EightKernel, Kernel, Level, dispatch, dispatch_eight};
use crate::track::noise::Gradients;
use crate::track::normal::{GAIN_RANGE, Light, SIMPLER, unit_noise};
use crate::track::patch::{MAX_SIDE, Window};
use crate::track::warp::{Positions, SampleWarped, Warp, inverted, product};

/// Unknowns: the displacement and the derivative of the warp along x and along y, an offset and its slopes, a gain.
const UNKNOWNS: usize = 10;

/// Samples along a side: a template has one more on each side, for its gradient.
const SIDE: usize = MAX_SIDE + 2;

/// Samples of a window in whole lanes.
const ROOM: usize = (SIDE * SIDE).next_multiple_of(EIGHT);

/// For each unknown a value for each pixel; 0 up to whole lanes.
type Basis = [[f32; ROOM]; UNKNOWNS];

/// Memory of one thread.
#[derive(Debug)]
pub(super) struct Aligner {
    samples: [f32; ROOM],
    /// Grey levels of the template, and how much each unknown changes them.
    template: [f32; ROOM],
    basis: Basis,
}

/// What one level is asked.
#[derive(Debug, Clone, Copy)]
pub(super) struct Question<'a> {
    pub(super) from: &'a Plane,
    pub(super) to: &'a Plane,
    pub(super) centre: [f64; 2],
    pub(super) start: Warp,
    pub(super) window: Window,
    pub(super) light: Light,
    pub(super) iterations: usize,
    /// Length of a step at the window's rim, in pixels, that is short enough.
    pub(super) tolerance: f64,
    pub(super) level: Level,
}

/// What one level answers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    pub(super) warp: Warp,
    pub(super) gain: f64,
    /// Mean square of what is left, and of the window without what an offset and its slopes explain, times the squared
    /// gain.
    pub(super) variance: f64,
    pub(super) signal: f64,
    /// Covariance of the displacement where what is left has variance 1 a pixel and no correlation: xx, xy, yy.
    pub(super) unit_covariance: [f64; 3],
    pub(super) gradients: Gradients,
}

thread_local! {
    static KEPT: Cell<Option<Box<Aligner>>> = const { Cell::new(None) };
}

impl Aligner {
    /// Call `work` with memory that the next call of this thread has again.
    pub(super) fn with<R>(work: impl FnOnce(&mut Self) -> R) -> R {
        let mut aligner = KEPT.take().unwrap_or_else(|| Box::new(Self::new()));
        let result = work(&mut aligner);
        KEPT.set(Some(aligner));
        result
    }

    fn new() -> Self {
        Self {
            samples: [0.0; _],
            template: [0.0; _],
            basis: [[0.0; ROOM]; _],
        }
    }

    /// Align a window on one level; `None` where its texture does not fix a warp, or the steps lead nowhere.
    pub(super) fn align(&mut self, question: &Question<'_>) -> Option<Answer> {
        let Question {
            window,
            light,
            to,
            centre,
            ..
        } = *question;
        let gradients = self.build(question);
        let count = window.width * window.height;
        let square = self.square(count, question.level);
        let normal = Factor::new(&square, light)?;
        let half = 0.5 * window.width.max(window.height) as f64;
        let reach = half + 2.0;
        let mut warp = question.start;
        let mut last = f64::INFINITY;
        for _ in 0..question.iterations {
            let at = [centre[0] + warp.shift[0], centre[1] + warp.shift[1]];
            let near = at[0] >= -half
                && at[1] >= -half
                && at[0] <= to.width() as f64 - 1.0 + half
                && at[1] <= to.height() as f64 - 1.0 + half;
            if !near {
                return None;
            }
            dispatch(
                question.level,
                SampleWarped {
                    plane: to,
                    positions: Positions::around(at, warp.matrix, window, 0),
                    to: &mut self.samples[..count],
                },
            );
            let (sums, squared) = dispatch_eight(
                question.level,
                Project {
                    samples: &self.samples,
                    template: &self.template,
                    basis: &self.basis,
                    count,
                },
            );
            if !squared.is_finite() {
                return None;
            }
            let step = Step::new(&normal, &sums, squared);
            let next = step.apply(warp, half);
            let size = step.size();
            let start = question.start.shift;
            let moved = (next.shift[0] - start[0]).hypot(next.shift[1] - start[1]);
            if !next.is_plausible() || moved > reach || moved.is_nan() {
                return None;
            }
            // Steps shrink by a steady factor, so this is how far the rest of them would lead.
            let factor = (size / last).max(0.2);
            if factor < 1.0 && size * factor / (1.0 - factor) < question.tolerance {
                let variance = |normal: &Factor, left: f64| {
                    left / (count as f64 - normal.unknowns() as f64).max(1.0)
                };
                // The simplest lighting model that the window does not speak against, as for a displacement alone.
                let limit = unit_noise(variance(&normal, step.left));
                let simpler =
                    SIMPLER
                        .iter()
                        .filter(|_| light.has_tilt())
                        .find_map(|(simple, quantile)| {
                            let normal = Factor::new(&square, *simple)?;
                            let taken = Step::new(&normal, &sums, squared);
                            (taken.left - step.left <= quantile * limit).then_some((normal, taken))
                        });
                let (normal, step) = simpler.unwrap_or((normal, step));
                let warp = step.apply(warp, half);
                let gain = step.gain;
                return Some(Answer {
                    warp,
                    gain,
                    variance: variance(&normal, step.left),
                    signal: gain * gain * normal.contrast / count as f64,
                    unit_covariance: normal.covariance(&warp, gain),
                    gradients,
                });
            }
            warp = next;
            last = size;
        }
        None
    }

    /// Sums of the products of what the unknowns change; above the diagonal.
    fn square(&self, count: usize, level: Level) -> [[f64; UNKNOWNS]; UNKNOWNS] {
        let basis = &self.basis;
        dispatch_eight(level, Square { basis, count })
    }

    /// Fill template and basis.
    fn build(&mut self, question: &Question<'_>) -> Gradients {
        let window = question.window;
        let positions = Positions::around(question.centre, Warp::IDENTITY, window, 1);
        let (columns, rows) = (positions.columns, positions.rows);
        dispatch(
            question.level,
            SampleWarped {
                plane: question.from,
                positions,
                to: &mut self.samples[..columns * rows],
            },
        );
        dispatch(
            question.level,
            Differentiate {
                samples: &self.samples[..columns * rows],
                window,
                template: &mut self.template,
                basis: &mut self.basis,
            },
        )
    }
}

/// Fill template and basis from samples with one more on each side.
struct Differentiate<'a> {
    samples: &'a [f32],
    window: Window,
    template: &'a mut [f32; ROOM],
    basis: &'a mut Basis,
}

impl Kernel for Differentiate<'_> {
    type Output = Gradients;

    #[inline(always)]
    fn run(self) -> Gradients {
        let Self {
            samples, window, ..
        } = self;
        let (width, height) = (window.width, window.height);
        let columns = width + 2;
        let middle = samples[(height / 2 + 1) * columns + columns / 2];
        let half = 0.5 * width.max(height) as f32;
        let (mut energy, mut lagged) = ([0.0f32; 2], [0.0f32; 2]);
        let [bx, bxx, bxy, by, byx, byy, one, along, down, level] = self.basis;
        for row in 0..height {
            let y = (row as f32 - 0.5 * (height as f32 - 1.0)) / half;
            let above = &samples[row * columns..][..columns];
            let here = &samples[(row + 1) * columns..][..columns];
            let below = &samples[(row + 2) * columns..][..columns];
            let pixels = row * width..(row + 1) * width;
            let template = &mut self.template[pixels.clone()];
            for (column, at) in pixels.clone().enumerate() {
                let x = (column as f32 - 0.5 * (width as f32 - 1.0)) / half;
                let gx = 0.5 * (here[column + 2] - here[column]);
                let gy = 0.5 * (below[column + 1] - above[column + 1]);
                template[column] = here[column + 1];
                (bx[at], bxx[at], bxy[at]) = (gx, gx * x, gx * y);
                (by[at], byx[at], byy[at]) = (gy, gy * x, gy * y);
                (one[at], along[at], down[at]) = (1.0, x, y);
                level[at] = here[column + 1] - middle;
            }
            for at in pixels.skip(1) {
                energy[0] += by[at] * by[at];
                energy[1] += bx[at] * bx[at];
                // Of each along the row: gy across the edges that it stands on, gx along itself.
                lagged[0] += by[at] * by[at - 1];
                lagged[1] += bx[at] * bx[at - 1];
            }
        }
        let count = width * height;
        let rest = count..count.next_multiple_of(EIGHT);
        self.template[rest.clone()].fill(0.0);
        for line in [bx, bxx, bxy, by, byx, byy, one, along, down, level] {
            line[rest.clone()].fill(0.0);
        }
        Gradients::new(
            energy.map(f64::from),
            lagged.map(f64::from),
            1.0,
            (width - 1) as f64 * height as f64,
        )
    }
}

/// Sums of the difference `samples - template` with each unknown's change, and squared.
struct Project<'a> {
    samples: &'a [f32; ROOM],
    template: &'a [f32; ROOM],
    basis: &'a Basis,
    count: usize,
}

impl EightKernel for Project<'_> {
    type Output = ([f64; UNKNOWNS], f64);

    #[inline(always)]
    fn run<L: Eight>(self) -> Self::Output {
        let (mut sums, mut squared) = ([L::zero(); UNKNOWNS], L::zero());
        for at in (0..self.count).step_by(EIGHT) {
            let mask = L::first(self.count - at);
            let d = (L::load(self.samples, at) - L::load(self.template, at)).keep(mask);
            for (sum, basis) in sums.iter_mut().zip(self.basis) {
                *sum += d * L::load(basis, at);
            }
            squared += d * d;
        }
        (L::sums(&sums), squared.sum())
    }
}

/// Sums of the products of what the unknowns change.
struct Square<'a> {
    basis: &'a Basis,
    count: usize,
}

impl EightKernel for Square<'_> {
    type Output = [[f64; UNKNOWNS]; UNKNOWNS];

    #[inline(always)]
    fn run<L: Eight>(self) -> Self::Output {
        let mut sums = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (row, (line, sums)) in self.basis.iter().zip(&mut sums).enumerate() {
            let mut products = [L::zero(); UNKNOWNS];
            for at in (0..self.count).step_by(EIGHT) {
                let value = L::load(line, at);
                for (product, other) in products[row..].iter_mut().zip(&self.basis[row..]) {
                    *product += value * L::load(other, at);
                }
            }
            *sums = L::sums(&products);
        }
        sums
    }
}

/// One step of the least squares.
struct Step {
    /// The unknowns, over the gain.
    by: [f64; UNKNOWNS],
    gain: f64,
    /// Sum of squares that is left after it.
    left: f64,
}

impl Step {
    fn new(normal: &Factor, sums: &[f64; UNKNOWNS], squared: f64) -> Self {
        let found = normal.solve(sums);
        let explained: f64 = found.iter().zip(sums).map(|(a, b)| a * b).sum();
        let gain = 1.0 + found[9];
        let usable = gain.clamp(GAIN_RANGE.0, GAIN_RANGE.1);
        Self {
            by: found.map(|unknown| unknown / usable),
            gain,
            left: (squared - explained).max(0.0),
        }
    }

    /// How far it moves the window's rim, in pixels.
    fn size(&self) -> f64 {
        self.by[..6]
            .iter()
            .map(|part| part * part)
            .sum::<f64>()
            .sqrt()
    }

    /// `warp` after the step, for a window of so many pixels from the centre to the rim.
    fn apply(&self, warp: Warp, half: f64) -> Warp {
        let by = &self.by;
        let change = [
            [1.0 + by[1] / half, by[2] / half],
            [by[4] / half, 1.0 + by[5] / half],
        ];
        let matrix = product(warp.matrix, inverted(change));
        let moved = Warp { matrix, ..warp }.turn([by[0], by[3]]);
        Warp {
            shift: [warp.shift[0] - moved[0], warp.shift[1] - moved[1]],
            matrix,
        }
    }
}

/// The normal equations of a template, factored: U'U of the unknowns that the lighting model has.
struct Factor {
    active: [bool; UNKNOWNS],
    upper: [[f64; UNKNOWNS]; UNKNOWNS],
    /// Sum of squares of the intensity without what the offset and its slopes explain.
    contrast: f64,
}

/// Share of an unknown's energy that the unknowns before it must leave to it.
const LEAST_SHARE: f64 = 1e-6;

impl Factor {
    /// `None` if the window's texture does not fix the warp.
    fn new(sums: &[[f64; UNKNOWNS]; UNKNOWNS], light: Light) -> Option<Self> {
        let mut active = [true; UNKNOWNS];
        active[6] = light.has_offset();
        active[7] = light.has_tilt();
        active[8] = light.has_tilt();
        active[9] = light.has_gain();
        let contrast = {
            let [ones, along, down] = [sums[6][9], sums[7][9], sums[8][9]];
            let explained =
                ones * ones / sums[6][6] + along * along / sums[7][7] + down * down / sums[8][8];
            (sums[9][9] - explained).max(0.0)
        };
        let mut upper = [[0.0; UNKNOWNS]; UNKNOWNS];
        for row in 0..UNKNOWNS {
            if !active[row] {
                continue;
            }
            for column in row..UNKNOWNS {
                let mut value = sums[row][column];
                for above in &upper[..row] {
                    value -= above[row] * above[column];
                }
                if column == row {
                    if !(value > LEAST_SHARE * sums[row][row] && value.is_finite()) {
                        return None;
                    }
                    upper[row][row] = value.sqrt();
                } else if active[column] {
                    upper[row][column] = value / upper[row][row];
                }
            }
        }
        Some(Self {
            active,
            upper,
            contrast,
        })
    }

    fn unknowns(&self) -> usize {
        self.active.iter().filter(|active| **active).count()
    }

    /// The unknowns for these sums; 0 for those that the model has not.
    fn solve(&self, sums: &[f64; UNKNOWNS]) -> [f64; UNKNOWNS] {
        let mut found = [0.0; UNKNOWNS];
        for row in 0..UNKNOWNS {
            if self.active[row] {
                let known: f64 = (0..row).map(|k| self.upper[k][row] * found[k]).sum();
                found[row] = (sums[row] - known) / self.upper[row][row];
            }
        }
        for row in (0..UNKNOWNS).rev() {
            if self.active[row] {
                let known: f64 = (row + 1..UNKNOWNS)
                    .map(|k| self.upper[row][k] * found[k])
                    .sum();
                found[row] = (found[row] - known) / self.upper[row][row];
            }
        }
        found
    }

    /// Covariance of the displacement in `next` for what is left with variance 1 a pixel: xx, xy, yy.
    fn covariance(&self, warp: &Warp, gain: f64) -> [f64; 3] {
        let unit = |index: usize| {
            let mut sums = [0.0; UNKNOWNS];
            sums[index] = 1.0;
            self.solve(&sums)
        };
        let (x, y) = (unit(0), unit(3));
        let own = [[x[0], x[3]], [y[0], y[3]]];
        let [[a, b], [c, d]] = warp.matrix;
        let turned = product(product(warp.matrix, own), [[a, c], [b, d]]);
        let scale = 1.0 / (gain * gain);
        [
            turned[0][0] * scale,
            turned[0][1] * scale,
            turned[1][1] * scale,
        ]
    }
}
