//! Windows of one frame sought in another: normalised correlation, which does not mind a gain or an offset of the light.

use std::ops::Range;

use crate::error::Result;
use crate::frame::Plane;
use crate::memory::resize;
use crate::simd::{Floats, Kernel, LANES, Simd, SimdLevel, blocks_mut, dispatch};

use super::padded_plane::{self, PAD, PaddedPlane};

/// Half the windows that are sought, their sides, and how many pixels they hold.
pub(super) const RADIUS: usize = 4;
pub(super) const SIDE: usize = 2 * RADIUS + 1;
const AREA: usize = SIDE * SIDE;
/// Mean squared differences and variances below this are noise, in squared grey levels.
pub(super) const NOISE: f32 = 16.0;
/// Correlation at least of a window that is found anywhere, and of one found beside another.
const ALIKE: f32 = 0.8;
const ALIKE_NEAR: f32 = 0.7;
/// Another place must leave this many times as much unexplained.
const DISTINCT: f32 = 1.3;
/// Places nearer than this are one, in pixels of the level.
const APART: usize = 3;
/// How far from a neighbour's displacement a window is sought, in pixels of the level.
pub(super) const NEAR: usize = 2;

/// A level of one frame.
#[derive(Debug, Default)]
pub(super) struct Side {
    plane: PaddedPlane,
    /// Of the window that begins at each pixel: the reciprocal of the norm of its deviations, 0 where it holds noise.
    inverse: PaddedPlane,
    /// Of a row: sums and sums of squares down its windows.
    sums: [Vec<f32>; 2],
}

/// A window, as deviations from its mean of norm 1, and the pixel that it begins at.
pub(super) struct Template {
    values: [f32; AREA],
    pub(super) at: [usize; 2],
}

impl Side {
    /// Take over a level, and measure its windows.
    pub(super) fn take(&mut self, level: &Plane) -> Result<()> {
        let (width, height) = (level.width(), level.height());
        self.plane.resize(width, height)?;
        self.inverse.resize(width, height)?;
        self.inverse.fill(0.0);
        for y in 0..height {
            let row = self.plane.padded_mut(y);
            row[PAD..PAD + width].copy_from_slice(level.row(y));
            padded_plane::extend(row, width);
        }
        // Sums down the windows of a row, then across; of differences to the mean, which keeps them small.
        let mean = level.data().iter().sum::<f32>() / level.data().len() as f32;
        let [sums, squares] = &mut self.sums;
        for memory in [&mut *sums, &mut *squares] {
            resize("sums of a row", memory, width, 0.0)?;
        }
        for y in 0..=height - SIDE {
            sums.fill(0.0);
            squares.fill(0.0);
            for line in y..y + SIDE {
                for ((sum, square), value) in
                    sums.iter_mut().zip(&mut *squares).zip(level.row(line))
                {
                    let value = value - mean;
                    *sum += value;
                    *square += value * value;
                }
            }
            let inverse = &mut self.inverse.padded_mut(y)[PAD..];
            let windows = sums.windows(SIDE).zip(squares.windows(SIDE));
            for (inverse, (sums, squares)) in inverse.iter_mut().zip(windows) {
                let sum: f32 = sums.iter().sum();
                let squares = squares.iter().sum::<f32>() - sum * sum / AREA as f32;
                if squares > NOISE * AREA as f32 {
                    *inverse = squares.sqrt().recip();
                }
            }
        }
        Ok(())
    }

    /// Correlate a window with those that begin in these columns and rows.
    fn correlate(
        &self,
        template: &Template,
        scores: &mut PaddedPlane,
        [columns, rows]: [Range<usize>; 2],
        simd: SimdLevel,
    ) {
        for y in rows {
            let kernel = Correlate {
                template: &template.values,
                rows: std::array::from_fn(|row| &self.plane.padded(y + row)[columns.start..]),
                inverse: &self.inverse.padded(y)[columns.start..],
                count: columns.len().div_ceil(LANES),
                to: &mut scores.padded_mut(y)[columns.start..],
            };
            dispatch(simd, kernel);
        }
    }

    /// Where a window went, if one place explains it and no other does.
    pub(super) fn anywhere(
        &self,
        template: &Template,
        scores: &mut PaddedPlane,
        most: Option<f32>,
        simd: SimdLevel,
    ) -> Option<[i32; 2]> {
        let [x, y] = template.at;
        let (width, height) = (self.plane.width(), self.plane.height());
        // By default half the frame along each axis, as phase correlation does.
        let reach = match most {
            Some(most) => [most.min(1e6).ceil() as usize; 2],
            None => [width / 2, height / 2],
        };
        let columns = x.saturating_sub(reach[0])..(x + reach[0] + 1).min(width - SIDE + 1);
        let rows = y.saturating_sub(reach[1])..(y + reach[1] + 1).min(height - SIDE + 1);
        let ranges = [columns, rows];
        self.correlate(template, scores, ranges.clone(), simd);
        let (best, place) = highest(scores, &ranges, |_| true)?;
        if best < ALIKE {
            return None;
        }
        let apart = |[x, y]: [usize; 2]| x.abs_diff(place[0]).max(y.abs_diff(place[1])) >= APART;
        if let Some((other, _)) = highest(scores, &ranges, apart)
            && 1.0 - other < DISTINCT * (1.0 - best)
        {
            return None;
        }
        template.to(place, most)
    }

    /// Where a window went, near the displacement `by`.
    pub(super) fn near(
        &self,
        template: &Template,
        scores: &mut PaddedPlane,
        by: [i32; 2],
        most: Option<f32>,
        simd: SimdLevel,
    ) -> Option<[i32; 2]> {
        let ranges = near_place(template.at, by, [self.plane.width(), self.plane.height()]);
        self.correlate(template, scores, ranges.clone(), simd);
        let (score, place) = highest(scores, &ranges, |_| true)?;
        if score < ALIKE_NEAR {
            return None;
        }
        template.to(place, most)
    }
}

impl Template {
    /// The window that begins at a pixel; none where it holds noise.
    pub(super) fn of(level: &Plane, [x, y]: [usize; 2]) -> Option<Self> {
        let mut values = [0.0; AREA];
        for (line, to) in values.chunks_exact_mut(SIDE).enumerate() {
            to.copy_from_slice(&level.row(y + line)[x..x + SIDE]);
        }
        let mean = values.iter().sum::<f32>() / AREA as f32;
        let mut squares = 0.0;
        for value in &mut values {
            *value -= mean;
            squares += *value * *value;
        }
        if squares <= NOISE * AREA as f32 {
            return None;
        }
        let norm = squares.sqrt().recip();
        Some(Self {
            values: values.map(|value| value * norm),
            at: [x, y],
        })
    }

    /// The displacement to a window that begins at `place`, if it is not longer than what is looked for.
    fn to(&self, place: [usize; 2], most: Option<f32>) -> Option<[i32; 2]> {
        let by = [0, 1].map(|axis| place[axis] as i32 - self.at[axis] as i32);
        let length = (by[0] as f32).hypot(by[1] as f32);
        most.is_none_or(|most| length <= most + 1.0).then_some(by)
    }
}

/// The columns and rows that windows near a displacement begin in, in a level of this size.
fn near_place(at: [usize; 2], by: [i32; 2], sizes: [usize; 2]) -> [Range<usize>; 2] {
    [0, 1].map(|axis| {
        let to = at[axis] as i32 + by[axis];
        let ends = [to - NEAR as i32, to + NEAR as i32 + 1];
        let [first, last] = ends.map(|end| end.clamp(0, (sizes[axis] - SIDE + 1) as i32) as usize);
        first..last
    })
}

/// The highest score and its place, among those that `counts` lets pass.
fn highest(
    scores: &PaddedPlane,
    [columns, rows]: &[Range<usize>; 2],
    counts: impl Fn([usize; 2]) -> bool,
) -> Option<(f32, [usize; 2])> {
    let mut best: Option<(f32, [usize; 2])> = None;
    for y in rows.clone() {
        let scores = &scores.row(y)[columns.clone()];
        for (x, score) in columns.clone().zip(scores) {
            if best.is_none_or(|best| *score > best.0) && counts([x, y]) {
                best = Some((*score, [x, y]));
            }
        }
    }
    best
}

/// The variance of the window of this radius around a pixel, as far as it is inside.
pub(super) fn variance(plane: &Plane, x: usize, y: usize, radius: usize) -> f32 {
    let columns = x.saturating_sub(radius)..(x + radius + 1).min(plane.width());
    let rows = y.saturating_sub(radius)..(y + radius + 1).min(plane.height());
    let count = (columns.len() * rows.len()) as f32;
    let middle = plane.row(y)[x];
    let (mut sum, mut squares) = (0.0, 0.0);
    for y in rows {
        for value in &plane.row(y)[columns.clone()] {
            let value = value - middle;
            sum += value;
            squares += value * value;
        }
    }
    let mean = sum / count;
    (squares / count - mean * mean).max(0.0)
}

/// The normalised correlation of a window with those that begin along a row.
struct Correlate<'a> {
    template: &'a [f32; AREA],
    rows: [&'a [f32]; SIDE],
    inverse: &'a [f32],
    count: usize,
    to: &'a mut [f32],
}

impl Kernel for Correlate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let to = blocks_mut(self.to, PAD, self.count);
        for (group, to) in to.iter_mut().enumerate() {
            let at = PAD + group * LANES;
            let mut sum = s.splat(0.0);
            for (row, template) in self.rows.iter().zip(self.template.chunks_exact(SIDE)) {
                for (column, value) in template.iter().enumerate() {
                    sum = sum + s.splat(*value) * s.load(row, at + column);
                }
            }
            (sum * s.load(self.inverse, at)).put(to);
        }
    }
}
