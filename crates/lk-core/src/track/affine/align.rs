//! One point whose surroundings turn, grow or shear: Lucas-Kanade with an affine warp of the window.
//!
//! S. Baker and I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004: the inverse compositional
//! step, whose normal equations belong to the template and are made once a level. The lighting model has its unknowns
//! in the same least squares.

use std::cell::Cell;

use crate::frame::Plane;
use crate::simd::{EIGHT, Eight, EightKernel, Kernel, Level, dispatch, dispatch_eight};
use crate::support::{CLIPPED, COUNTS, Support};
use crate::track::affine::sample::{Copied, Filter, SampleWarped};
use crate::track::affine::warp::{Positions, Warp, inverted, product};
use crate::track::noise::Gradients;
use crate::track::normal::{GAIN_RANGE, Light, SIMPLER, unit_noise};
use crate::track::patch::{MAX_SIDE, Window};

/// Unknowns: the displacement and the derivative of the warp along x and along y, an offset, a gain, the offset's slopes.
const UNKNOWNS: usize = 10;

/// Samples along a side: a template has one more on each side, for its gradient.
const SIDE: usize = MAX_SIDE + 2;

/// Samples of a window in whole lanes, and room for the last lanes of its last row.
const ROOM: usize = (SIDE * SIDE).next_multiple_of(EIGHT) + EIGHT;

/// Pixels of a window and around it whose support is looked at.
const LOOKED: usize = (MAX_SIDE + 6) * (MAX_SIDE + 6);

/// Share of a window's pixels that must count.
const LEAST_COUNTING: f64 = 0.125;

/// Share of the window's variance that may be left after so many steps on the way to a warp.
const HOPE: f64 = 0.3;
const HOPE_STEPS: usize = 2;

/// How many times as much as at the end may be left after the first step.
const STILL_LEFT: f64 = 1.2;

/// For each unknown a value for each pixel; 0 up to whole lanes.
type Basis = [[f32; ROOM]; UNKNOWNS];

/// Memory of one thread.
#[derive(Debug)]
pub(in crate::track) struct Aligner {
    samples: [f32; ROOM],
    pub(in crate::track) copied: Copied,
    /// What the pixels of the template are, and whether all of them count.
    own: [u8; LOOKED],
    own_whole: bool,
    /// Bits to keep of each pixel, if some do not count.
    keep: [f32; ROOM],
    /// How many of them were found for this template.
    kept: usize,
    /// Grey levels of the template, and how much each unknown changes them.
    template: [f32; ROOM],
    basis: Basis,
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
    pub(in crate::track) level: Level,
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
    pub(in crate::track) gradients: Gradients,
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
            own: [COUNTS; _],
            own_whole: true,
            keep: [0.0; _],
            kept: 0,
            template: [0.0; _],
            basis: [[0.0; ROOM]; _],
        }
    }

    /// Align a window on one level; `None` where its texture does not fix a warp, or the steps lead nowhere.
    pub(in crate::track) fn align(&mut self, input: &Input<'_>) -> Option<Output> {
        let Input {
            window,
            light,
            to,
            centre,
            ..
        } = *input;
        let gradients = self.build(input)?;
        let count = window.width * window.height;
        let mut area = count as f64;
        let mut masked = false;
        let mut met = Meeting::Whole;
        let unknowns = Unknowns::of(light);
        let mut square = self.square(count, masked, unknowns, input.level);
        let mut normal = Factor::new(&square, light)?;
        let half = 0.5 * window.width.max(window.height) as f64;
        let reach = half + 2.0;
        let mut warp = input.start;
        let mut last = f64::INFINITY;
        for iteration in 0..input.iterations {
            let at = [centre[0] + warp.shift[0], centre[1] + warp.shift[1]];
            let near = at[0] >= -half
                && at[1] >= -half
                && at[0] <= to.width() as f64 - 1.0 + half
                && at[1] <= to.height() as f64 - 1.0 + half;
            if !near {
                return None;
            }
            let positions = Positions::around(at, warp.matrix, window, 0);
            let sampled = dispatch_eight(
                input.level,
                SampleWarped {
                    plane: to,
                    positions,
                    filter: input.filter,
                    copied: &mut self.copied,
                    to: &mut self.samples,
                },
            );
            if !sampled {
                return None;
            }
            let meeting = self.meet(input.to_support, &positions);
            if meeting != met {
                met = meeting;
                masked = met != Meeting::Whole;
                area = match met {
                    Meeting::Whole => count as f64,
                    Meeting::Part { counting, .. } => counting as f64,
                };
                if area < LEAST_COUNTING * count as f64 {
                    return None;
                }
                square = self.square(count, masked, unknowns, input.level);
                normal = Factor::new(&square, light)?;
            }
            let (sums, squared) = self.project(count, masked, unknowns, input.level);
            if !squared.is_finite() {
                return None;
            }
            let step = Step::new(&normal, &sums, squared);
            let next = step.apply(warp, half);
            let size = step.size();
            let start = input.start.shift;
            let moved = (next.shift[0] - start[0]).hypot(next.shift[1] - start[1]);
            if !next.is_plausible() || moved > reach || moved.is_nan() {
                return None;
            }
            let signal = step.gain * step.gain * normal.contrast / area;
            let variance =
                |normal: &Factor, left: f64| left / (area - normal.unknowns() as f64).max(1.0);
            let left = variance(&normal, step.left);
            if iteration >= HOPE_STEPS && left > HOPE * signal
                || iteration >= 1 && left > STILL_LEFT * input.most_left
            {
                return None;
            }
            // Steps shrink by a steady factor, so this is how far the rest of them would lead.
            let factor = (size / last).max(0.2);
            if factor < 1.0 && size * factor / (1.0 - factor) < input.tolerance {
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
                return Some(Output {
                    warp,
                    gain,
                    variance: variance(&normal, step.left),
                    signal: gain * gain * normal.contrast / area,
                    unit_covariance: normal.covariance(&warp, gain),
                    gradients,
                });
            }
            warp = next;
            last = size;
        }
        None
    }

    /// Find which pixels count with those of `support` at `positions`.
    fn meet(&mut self, support: &Support, positions: &Positions) -> Meeting {
        let [x, y] = positions.bounds();
        let low = [x, y].map(|[low, _]| low.floor() as isize - 1);
        let high = [x, y].map(|[_, high]| high.floor() as isize + 2);
        let size = [0, 1].map(|axis: usize| (high[axis] - low[axis] + 1).max(0) as usize);
        let whole = support.has_all((low[0], low[1]), size[0], size[1]);
        if whole && self.own_whole {
            return Meeting::Whole;
        }
        let all = f32::from_bits(u32::MAX);
        let (mut counting, mut changed) = (0usize, false);
        let count = positions.columns * positions.rows;
        let own = self.own[..count].chunks_exact(positions.columns);
        let keep = self.keep[..count].chunks_exact_mut(positions.columns);
        for (row, (keep, own)) in keep.zip(own).enumerate() {
            for (column, (keep, own)) in keep.iter_mut().zip(own).enumerate() {
                let mut counts = self.own_whole || *own >= CLIPPED;
                if counts && !whole {
                    let [x, y] = positions.at(column, row).map(whole_below);
                    // The four pixels around on both axes.
                    counts = support.has_all((x - 1, y - 1), 4, 4);
                }
                counting += usize::from(counts);
                let bits = if counts { all } else { 0.0 };
                changed |= keep.to_bits() != bits.to_bits();
                *keep = bits;
            }
        }
        self.kept += usize::from(changed || self.kept == 0);
        Meeting::Part {
            counting,
            turn: self.kept,
        }
    }

    /// Sums of the products of what the unknowns change; above the diagonal.
    fn square(
        &self,
        count: usize,
        masked: bool,
        unknowns: Unknowns,
        level: Level,
    ) -> [[f64; UNKNOWNS]; UNKNOWNS] {
        let (basis, keep) = (&self.basis, masked.then_some(&self.keep));
        let kernel = Square {
            basis,
            keep,
            count,
            unknowns,
        };
        dispatch_eight(level, kernel)
    }

    /// Sums of the difference with what each unknown changes, and squared.
    fn project(
        &self,
        count: usize,
        masked: bool,
        unknowns: Unknowns,
        level: Level,
    ) -> ([f64; UNKNOWNS], f64) {
        let kernel = Project {
            samples: &self.samples,
            template: &self.template,
            basis: &self.basis,
            keep: masked.then_some(&self.keep),
            count,
            unknowns,
        };
        dispatch_eight(level, kernel)
    }

    /// Fill template and basis.
    fn build(&mut self, input: &Input<'_>) -> Option<Gradients> {
        let window = input.window;
        let positions = Positions::around(input.centre, Warp::IDENTITY, window, 1);
        let sampled = dispatch_eight(
            input.level,
            SampleWarped {
                plane: input.from,
                positions,
                filter: input.filter,
                copied: &mut self.copied,
                to: &mut self.samples,
            },
        );
        let reads = [0, 1].map(|axis: usize| {
            // The window's own first sample: one more stands before it.
            let first = positions.first[axis] + 1.0;
            [first.floor() as isize, first.ceil() as isize]
        });
        let size = (window.width, window.height);
        let place = reads.map(|[low, _]| low - 2);
        let [columns, rows] = [0, 1].map(|axis: usize| {
            let [low, high] = reads[axis];
            [size.0, size.1][axis] + (high - low) as usize + 4
        });
        let support = input.from_support;
        // Clipped pixels count here: where only they are missing, all count.
        self.own_whole = support.has_all((place[0], place[1]), columns, rows)
            || support.least(reads, size, [2, 2], &mut self.own);
        self.kept = 0;
        sampled.then(|| {
            dispatch(
                input.level,
                Differentiate {
                    samples: &self.samples,
                    window,
                    template: &mut self.template,
                    basis: &mut self.basis,
                },
            )
        })
    }
}

/// Which pixels of a window count at both of its ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meeting {
    Whole,
    /// So many; `turn` tells those of one place from those of another.
    Part {
        counting: usize,
        turn: usize,
    },
}

/// The whole number below; without a call of a library, and for what lies near a frame.
fn whole_below(coordinate: f64) -> isize {
    let whole = coordinate as isize;
    whole - isize::from(whole as f64 > coordinate)
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
        let [bx, bxx, bxy, by, byx, byy, one, level, along, down] = self.basis;
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

/// How many of the unknowns a lighting model has, from the first one on.
#[derive(Debug, Clone, Copy)]
enum Unknowns {
    Motion,
    Offset,
    Gain,
    All,
}

impl Unknowns {
    fn of(light: Light) -> Self {
        match (light.has_tilt(), light.has_gain(), light.has_offset()) {
            (true, ..) => Self::All,
            (false, true, _) => Self::Gain,
            (false, false, true) => Self::Offset,
            (false, false, false) => Self::Motion,
        }
    }
}

/// Sums of the difference `samples - template` with each unknown's change, and squared.
struct Project<'a> {
    samples: &'a [f32; ROOM],
    template: &'a [f32; ROOM],
    basis: &'a Basis,
    keep: Option<&'a [f32; ROOM]>,
    count: usize,
    unknowns: Unknowns,
}

impl EightKernel for Project<'_> {
    type Output = ([f64; UNKNOWNS], f64);

    #[inline(always)]
    fn run<L: Eight>(self) -> Self::Output {
        match self.unknowns {
            Unknowns::Motion => self.sums::<L, 6>(),
            Unknowns::Offset => self.sums::<L, 7>(),
            Unknowns::Gain => self.sums::<L, 8>(),
            Unknowns::All => self.sums::<L, UNKNOWNS>(),
        }
    }
}

impl Project<'_> {
    #[inline(always)]
    fn sums<L: Eight, const N: usize>(&self) -> ([f64; UNKNOWNS], f64) {
        let (mut sums, mut squared) = ([L::zero(); N], L::zero());
        for at in (0..self.count).step_by(EIGHT) {
            let mut mask = L::first(self.count - at);
            if let Some(keep) = self.keep {
                mask = mask.keep(L::load(keep, at));
            }
            let d = (L::load(self.samples, at) - L::load(self.template, at)).keep(mask);
            for (sum, basis) in sums.iter_mut().zip(self.basis) {
                *sum += d * L::load(basis, at);
            }
            squared += d * d;
        }
        let mut all = [0.0; UNKNOWNS];
        all[..N].copy_from_slice(&L::sums(&sums));
        (all, squared.sum())
    }
}

/// Sums of the products of what the unknowns change.
struct Square<'a> {
    basis: &'a Basis,
    keep: Option<&'a [f32; ROOM]>,
    count: usize,
    unknowns: Unknowns,
}

impl EightKernel for Square<'_> {
    type Output = [[f64; UNKNOWNS]; UNKNOWNS];

    #[inline(always)]
    fn run<L: Eight>(self) -> Self::Output {
        match self.unknowns {
            Unknowns::Motion => self.sums::<L, 6>(),
            Unknowns::Offset => self.sums::<L, 7>(),
            Unknowns::Gain => self.sums::<L, 8>(),
            Unknowns::All => self.sums::<L, UNKNOWNS>(),
        }
    }
}

impl Square<'_> {
    /// The contrast of a window is told without an offset and a gain too: their sums are made for every model.
    #[inline(always)]
    fn sums<L: Eight, const N: usize>(&self) -> [[f64; UNKNOWNS]; UNKNOWNS] {
        let mut sums = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (row, (line, sums)) in self.basis.iter().zip(&mut sums).enumerate() {
            let last = if row < 6 { N } else { UNKNOWNS };
            let mut products = [L::zero(); UNKNOWNS];
            for at in (0..self.count).step_by(EIGHT) {
                let mut value = L::load(line, at);
                if let Some(keep) = self.keep {
                    value = value.keep(L::load(keep, at));
                }
                for (product, other) in products[row..last].iter_mut().zip(&self.basis[row..last]) {
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
        let gain = 1.0 + found[7];
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

/// Sum of the squares of the intensity without what an offset and its slopes explain, one after the other.
fn contrast(sums: &[[f64; UNKNOWNS]; UNKNOWNS]) -> f64 {
    let [one, level, along, down] = [6, 7, 8, 9];
    let of = |a: usize, b: usize| sums[a.min(b)][a.max(b)];
    let mut left = of(level, level);
    // Orthogonal to those before: the sum with the level, and its own square.
    let share = of(one, level) / of(one, one);
    left -= share * of(one, level);
    let mean = [along, down].map(|slope| of(one, slope) / of(one, one));
    let with_level =
        [0, 1].map(|axis| of([along, down][axis], level) - mean[axis] * of(one, level));
    let square = |i: usize, j: usize| {
        of([along, down][i], [along, down][j]) - mean[i] * of(one, [along, down][j])
    };
    let (xx, xy, yy) = (square(0, 0), square(0, 1), square(1, 1));
    if xx > 0.0 {
        left -= with_level[0] * with_level[0] / xx;
        let (rest, with) = (yy - xy * xy / xx, with_level[1] - xy / xx * with_level[0]);
        if rest > 1e-9 * yy {
            left -= with * with / rest;
        }
    }
    left.max(0.0)
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
        active[7] = light.has_gain();
        active[8] = light.has_tilt();
        active[9] = light.has_tilt();
        let contrast = contrast(sums);
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
