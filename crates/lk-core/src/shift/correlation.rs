//! How well two frames agree at a whole-pixel displacement, in their grey levels and with light taken out by local
//! normalisation: each pixel less the mean around it, over the deviation around it.

use std::ops::Range;

use super::coordinates::Pair;
use crate::error::Result;
use crate::frame::Plane;
use crate::memory::{reserve, resize};
use crate::simd::{EIGHT, Eight, Kernel, Simd, SimdLevel, dispatch};

/// The least share of the window that both frames must show.
const MIN_SHARE: f64 = 0.08;
/// Pixels on each side that local normalisation looks at.
const RADIUS: usize = 4;
/// Rows that are summed in `f32`.
const ROWS: usize = 8;

/// Two frames as they are and locally normalised, with room behind each row to load whole lanes; kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Correlator {
    /// Of `prev` and of `next`.
    pub(super) raw: [Plane; 2],
    pub(super) normalized: [Plane; 2],
    weight: [Plane; 2],
    weighted: bool,
    size: [[usize; 2]; 2],
    window: [(usize, usize); 2],
    origin: [isize; 2],
    sums: [Vec<f32>; 2],
    variance: Vec<f32>,
    /// For each column, one over the columns that the sum around it has.
    across: Vec<f32>,
}

/// Correlation coefficients at one displacement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correlation {
    pub(super) raw: f64,
    pub(super) normalized: f64,
    /// Pixels that they rest on.
    pub(super) count: f64,
}

impl Correlator {
    /// Take the frames of `pair`.
    pub(super) fn take(&mut self, pair: Pair<'_>, level: SimdLevel) -> Result<()> {
        (self.window, self.origin) = (pair.window, pair.origin);
        self.weighted = pair.prev_weight.is_some() || pair.next_weight.is_some();
        let planes = [(pair.prev, pair.prev_weight), (pair.next, pair.next_weight)];
        for (index, (plane, weight)) in planes.into_iter().enumerate() {
            let size = [plane.width(), plane.height()];
            self.size[index] = size;
            pad(plane, &mut self.raw[index])?;
            if self.weighted {
                match weight {
                    Some(weight) => pad(weight, &mut self.weight[index])?,
                    None => {
                        self.weight[index].resize(padded(size[0]), size[1])?;
                        self.weight[index].data_mut().fill(1.0);
                    }
                }
            }
            let columns = |x: usize| x.min(RADIUS) + (size[0] - 1 - x).min(RADIUS) + 1;
            let across = (0..size[0]).map(|x| 1.0 / columns(x) as f32);
            self.across.clear();
            reserve("a row", &mut self.across, padded(size[0]))?;
            self.across.extend(across);
            self.across.resize(padded(size[0]), 1.0);
            dispatch(
                level,
                Normalise {
                    plane: &self.raw[index],
                    width: size[0],
                    across: &self.across,
                    sums: &mut self.sums,
                    variance: &mut self.variance,
                    to: &mut self.normalized[index],
                },
            )?;
        }
        Ok(())
    }

    /// How well the frames agree at displacement `d`; `None` if they share too few pixels.
    pub(super) fn at(&self, d: [isize; 2], level: SimdLevel) -> Option<Correlation> {
        let shared = |axis: usize| -> Option<(Range<usize>, usize)> {
            let offset = d[axis] - self.origin[axis];
            let (low, high) = self.window[axis];
            let start = (low as isize).max(-offset);
            let end = (high as isize).min(self.size[1][axis] as isize - offset);
            (start < end).then_some((start as usize..end as usize, (start + offset) as usize))
        };
        let ((columns, next_column), (rows, next_row)) = (shared(0)?, shared(1)?);
        let window = (self.window[0].1 - self.window[0].0) * (self.window[1].1 - self.window[1].0);
        let enough = (MIN_SHARE * window as f64).max(9.0);
        if ((columns.len() * rows.len()) as f64) < enough {
            return None;
        }
        let starts = [[columns.start, rows.start], [next_column, next_row]];
        let size = [columns.len(), rows.len()];
        let (count, [raw, normalized]) = if self.weighted {
            dispatch(
                level,
                Correlate::<true> {
                    of: self,
                    starts,
                    size,
                },
            )
        } else {
            dispatch(
                level,
                Correlate::<false> {
                    of: self,
                    starts,
                    size,
                },
            )
        };
        if count < enough {
            return None;
        }
        let coefficient = |[p, n, pp, pn, nn]: [f64; 5]| {
            let (pp, pn, nn) = (pp - p * p / count, pn - p * n / count, nn - n * n / count);
            pn / (pp.max(0.0) * nn.max(0.0)).sqrt().max(1e-9)
        };
        Some(Correlation {
            raw: coefficient(raw),
            normalized: coefficient(normalized),
            count,
        })
    }
}

/// The length of a row with room to load whole lanes from any pixel on.
fn padded(width: usize) -> usize {
    width.next_multiple_of(EIGHT) + EIGHT
}

/// Copy `plane`, with zeros behind its rows.
fn pad(plane: &Plane, to: &mut Plane) -> Result<()> {
    let width = plane.width();
    to.resize(padded(width), plane.height())?;
    for y in 0..plane.height() {
        let row = to.row_mut(y);
        row[..width].copy_from_slice(plane.row(y));
        row[width..].fill(0.0);
    }
    Ok(())
}

struct Normalise<'a> {
    plane: &'a Plane,
    /// Columns without the room behind them.
    width: usize,
    across: &'a [f32],
    sums: &'a mut [Vec<f32>; 2],
    variance: &'a mut Vec<f32>,
    to: &'a mut Plane,
}

impl Kernel for Normalise<'_> {
    type Output = Result<()>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Result<()> {
        let (stride, height) = (self.plane.width(), self.plane.height());
        let lanes = self.width.next_multiple_of(EIGHT);
        let mut total = 0.0f64;
        for y in 0..height {
            let mut sum = S::Eight::zero();
            let row = self.plane.row(y);
            let mut x = 0;
            while x < lanes {
                let value = S::Eight::load(row, x);
                sum += value * value;
                x += EIGHT;
            }
            total += sum.sum();
        }
        // A deviation of a twentieth of the frame's is taken for noise.
        let floor = (0.0025 * total / (self.width * height) as f64) as f32 + f32::MIN_POSITIVE;
        let [plain, squares] = self.sums;
        for sums in [&mut *plain, &mut *squares] {
            sums.clear();
            resize("a row", sums, stride + 2 * RADIUS, 0.0)?;
        }
        resize("a row", self.variance, stride, 0.0)?;
        self.to.resize(stride, height)?;
        for y in 0..height {
            let rows = y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(height);
            let near = &self.plane.data()[rows.start * stride..rows.end * stride];
            let mut x = 0;
            while x < lanes {
                let (mut sum, mut square) = (S::Eight::zero(), S::Eight::zero());
                let mut at = x;
                while at < near.len() {
                    let value = S::Eight::load(near, at);
                    sum += value;
                    square += value * value;
                    at += stride;
                }
                sum.store(plain, x + RADIUS);
                square.store(squares, x + RADIUS);
                x += EIGHT;
            }
            let down = S::Eight::splat(1.0 / rows.len() as f32);
            let from = self.plane.row(y);
            let to = self.to.row_mut(y);
            let mut x = 0;
            while x < lanes {
                let one = down * S::Eight::load(self.across, x);
                let mean = around::<S::Eight>(plain, x) * one;
                let variance = around::<S::Eight>(squares, x) * one - mean * mean;
                (S::Eight::load(from, x) - mean).store(to, x);
                variance.store(&mut self.variance[..], x);
                x += EIGHT;
            }
            for (to, variance) in to[..lanes].iter_mut().zip(&self.variance[..lanes]) {
                // Rounding may leave less than nothing of a flat place.
                *to /= (variance.max(0.0) + floor).sqrt();
            }
            to[self.width..].fill(0.0);
        }
        Ok(())
    }
}

/// The sum of nine sums, from the one that stands at `x` on; outer pairs first, so that a mirrored row gives the same
/// bits.
#[inline(always)]
fn around<L: Eight>(sums: &[f32], x: usize) -> L {
    let s = &sums[x..x + 2 * RADIUS + EIGHT];
    let outer = (L::load(s, 0) + L::load(s, 8)) + (L::load(s, 1) + L::load(s, 7));
    let inner = (L::load(s, 2) + L::load(s, 6)) + (L::load(s, 3) + L::load(s, 5));
    outer + inner + L::load(s, 4)
}

struct Correlate<'a, const WEIGHTED: bool> {
    of: &'a Correlator,
    /// The first pixel in each frame.
    starts: [[usize; 2]; 2],
    size: [usize; 2],
}

impl<const WEIGHTED: bool> Kernel for Correlate<'_, WEIGHTED> {
    /// The pixels, and the sums of p, n, pp, pn and nn as they are and locally normalised.
    type Output = (f64, [[f64; 5]; 2]);

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Self::Output {
        let [width, height] = self.size;
        let [prev, next] = self.starts;
        let mut totals = [[0.0f64; 5]; 2];
        let mut count = 0.0f64;
        let mut y = 0;
        while y < height {
            let end = (y + ROWS).min(height);
            let mut weights = S::Eight::zero();
            let mut sums = [[S::Eight::zero(); 5]; 2];
            while y < end {
                let row = |planes: &'_ [Plane; 2], index: usize, start: [usize; 2]| {
                    let plane = &planes[index];
                    (start[1] + y) * plane.width() + start[0]
                };
                let at = [row(&self.of.raw, 0, prev), row(&self.of.raw, 1, next)];
                let mut x = 0;
                while x < width {
                    let lanes = S::Eight::first(width - x);
                    let mut weight = lanes;
                    if WEIGHTED {
                        let [a, b] = &self.of.weight;
                        weight = (S::Eight::load(a.data(), at[0] + x)
                            * S::Eight::load(b.data(), at[1] + x))
                        .keep(lanes);
                        weights += weight;
                    }
                    for (sums, planes) in sums.iter_mut().zip([&self.of.raw, &self.of.normalized]) {
                        let p = S::Eight::load(planes[0].data(), at[0] + x);
                        let n = S::Eight::load(planes[1].data(), at[1] + x);
                        let (wp, wn) = if WEIGHTED {
                            (p * weight, n * weight)
                        } else {
                            (p.keep(weight), n.keep(weight))
                        };
                        sums[0] += wp;
                        sums[1] += wn;
                        sums[2] += wp * p;
                        sums[3] += wp * n;
                        sums[4] += wn * n;
                    }
                    x += EIGHT;
                }
                y += 1;
            }
            count += weights.sum();
            for i in 0..2 {
                for j in 0..5 {
                    totals[i][j] += sums[i][j].sum();
                }
            }
        }
        if !WEIGHTED {
            count = (width * height) as f64;
        }
        (count, totals)
    }
}
