//! Windows that deform: the displacement of the centre and its gradient, with their joint covariance.
//!
//! Each pixel of `prev` is compared with one of `next`, whole pixels away; both are moved towards each other by half of
//! what is left, as in the rest of this module, so that noise does not bias the result. What is left differs from pixel
//! to pixel: `w(m) = d + G (m - c)`, with m halfway between the two pixels and c halfway between the centres.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::coordinates::Pair;
use super::curvature::{Correction, correction};
use super::filters::{DERIVATIVE, NoiseGain, RADIUS, Taps, noise_gain, taps};
use super::gauss_newton::{Found, Problem};
use super::gram::{Light, agreement};
use super::matrix::{Matrix, product};
use super::solve::exceeds_chance;
use crate::error::Result;
use crate::frame::Plane;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};

/// dx, dy, and the gradient: du/dx, du/dy, dv/dx, dv/dy.
pub(super) const MOTION: usize = 6;
/// The light: one, x, y and the mean of both frames.
const LIGHT: usize = 4;
/// Motion, light and the difference.
pub(super) const FEATURES: usize = MOTION + LIGHT + 1;
pub(super) const ONE: usize = MOTION;
pub(super) const X: usize = MOTION + 1;
pub(super) const Y: usize = MOTION + 2;
const MEAN: usize = MOTION + 3;
const DIFFERENCE: usize = MOTION + LIGHT;
const PRODUCTS: usize = FEATURES * (FEATURES + 1) / 2;

/// Evaluations at a level.
const ITERATIONS: usize = 12;
/// A step below this settles, in pixels at the border of the window.
const SETTLED: f64 = 1e-3;
/// So does one below this share of its standard deviation.
const SETTLED_SHARE: f64 = 0.2;
/// The same as [`SETTLED`] at a coarse level.
const COARSE_SETTLED: f64 = 0.02;
/// Windows that deform more than this over a pixel are not followed.
const MAX_GRADIENT: f64 = 0.5;
/// Pixels along a side of a cluster: what is left of its differences may pull together.
const CLUSTER: usize = 8;
/// Rows that a thread takes at least are as many as hold this many pixels.
const BAND_PIXELS: usize = 4096;

/// A displacement that varies linearly over the window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Affine {
    /// Displacement of the centre, then the gradient halfway between the frames.
    pub(super) motion: [f64; MOTION],
    pub(super) covariance: [[f64; MOTION]; MOTION],
    /// Symmetric gain and offset.
    pub(super) alpha: f64,
    pub(super) beta: f64,
    /// Root mean square of what motion and light leave.
    pub(super) residual: f64,
    pub(super) correlation: f64,
    /// Independent samples among the pixels.
    pub(super) samples: f64,
    pub(super) steady: bool,
    /// What a displacement that varies quadratically adds at the centre.
    curvature: Option<Correction>,
}

impl Affine {
    /// With the displacement of the centre corrected for its curvature.
    fn corrected(mut self) -> Self {
        if let Some(correction) = self.curvature {
            for i in 0..2 {
                self.motion[i] += correction.displacement[i];
                for j in 0..2 {
                    self.covariance[i][j] += correction.covariance[i][j];
                }
            }
        }
        self
    }

    /// The gradient by the place in `prev`: `u(x) = d + G (I - G / 2)^-1 (x - c)`.
    pub(super) fn gradient(&self) -> Matrix {
        let [_, _, xx, xy, yx, yy] = self.motion;
        let half = [[1.0 - xx / 2.0, -xy / 2.0], [-yx / 2.0, 1.0 - yy / 2.0]];
        let determinant = half[0][0] * half[1][1] - half[0][1] * half[1][0];
        let inverse = [
            [half[1][1] / determinant, -half[0][1] / determinant],
            [-half[1][0] / determinant, half[0][0] / determinant],
        ];
        product([[xx, xy], [yx, yy]], inverse)
    }

    /// Whether the frames agree by more than chance: six deviations of Fisher's transform.
    pub(super) fn matches(&self) -> bool {
        exceeds_chance(self.correlation, 6.0, self.samples)
    }
}

/// The features of one pixel.
type Sample = [f64; FEATURES];

/// What a call compares: a pair of planes, and the motion.
struct View<'a> {
    pair: Pair<'a>,
    motion: [f64; MOTION],
    /// The centre of the window, in pixels of `prev`.
    center: [f64; 2],
    /// Pixels from the centre to the border: the unit of x and y.
    unit: f64,
}

/// How a pixel of `prev` is compared.
#[derive(Debug, Clone, Copy, Default)]
struct Match {
    /// The whole pixels to its counterpart.
    whole: [isize; 2],
}

impl View<'_> {
    /// The displacement at a place halfway, less `whole`, halved; and the place from the centre, in the unit.
    #[inline(always)]
    fn half(&self, pixel: [isize; 2], whole: [isize; 2]) -> ([f64; 2], [f64; 2]) {
        let [dx, dy, xx, xy, yx, yy] = self.motion;
        let x = pixel[0] as f64 + whole[0] as f64 / 2.0 - self.center[0] - dx / 2.0;
        let y = pixel[1] as f64 + whole[1] as f64 / 2.0 - self.center[1] - dy / 2.0;
        let u = dx + xx * x + xy * y;
        let v = dy + yx * x + yy * y;
        (
            [(u - whole[0] as f64) / 2.0, (v - whole[1] as f64) / 2.0],
            [x / self.unit, y / self.unit],
        )
    }

    #[inline(always)]
    fn whole(&self, pixel: [isize; 2]) -> [isize; 2] {
        let (half, _) = self.half(pixel, [0, 0]);
        half.map(|value| (2.0 * value).round() as isize)
    }

    /// Both frames at a pixel, moved towards each other; `None` outside of what they show.
    #[inline(always)]
    fn sample(&self, pixel: [isize; 2], whole: [isize; 2]) -> Option<[f32; 2]> {
        let (half, _) = self.half(pixel, whole);
        let half = half.map(|value| value.clamp(-0.5, 0.5));
        let across = taps(half[0]);
        let down = taps(half[1]);
        let reversed = |t: Taps| [t[4], t[3], t[2], t[1], t[0]];
        let prev = filtered(self.pair.prev, pixel, reversed(across), reversed(down))?;
        let at = std::array::from_fn(|axis| pixel[axis] + whole[axis] - self.pair.origin[axis]);
        let next = filtered(self.pair.next, at, across, down)?;
        Some([prev, next])
    }

    /// What the filters do to noise, on average over the window.
    fn noise(&self) -> NoiseGain {
        const PLACES: usize = 4;
        let mut mean = NoiseGain {
            sampled: 0.0,
            gradient: [0.0; 2],
            laplacian: 0.0,
        };
        let share = 1.0 / (PLACES * PLACES) as f64;
        for row in 0..PLACES {
            for column in 0..PLACES {
                let pixel: [isize; 2] = std::array::from_fn(|axis| {
                    let (low, high) = self.pair.window[axis];
                    let place = 2 * [column, row][axis] + 1;
                    (low + (high - low) * place / (2 * PLACES)) as isize
                });
                let (half, _) = self.half(pixel, self.whole(pixel));
                let one = noise_gain(&half.map(|value| taps(value.clamp(-0.26, 0.26))));
                mean.sampled += share * one.sampled;
                mean.gradient[0] += share * one.gradient[0];
                mean.gradient[1] += share * one.gradient[1];
                mean.laplacian += share * one.laplacian;
            }
        }
        mean
    }

    fn weight(&self, pixel: [isize; 2], whole: [isize; 2]) -> f64 {
        let of = |plane: Option<&Plane>, [x, y]: [isize; 2]| {
            plane.map_or(1.0, |plane| f64::from(plane.row(y as usize)[x as usize]))
        };
        let at = std::array::from_fn(|axis| pixel[axis] + whole[axis] - self.pair.origin[axis]);
        of(self.pair.prev_weight, pixel) * of(self.pair.next_weight, at)
    }

    /// The features of a pixel; `None` where it does not count.
    fn features(&self, rows: &Sampled<'_>, x: usize, y: usize) -> Option<(Sample, f64)> {
        let pixel = rows.pixel(x, y);
        let whole = self.whole(pixel);
        let [prev, next] = rows.at(x, y, whole)?;
        let weight = self.weight(pixel, whole);
        if weight == 0.0 {
            return None;
        }
        let mean = |dx: isize, dy: isize| -> Option<f64> {
            let [prev, next] = rows.near(self, x, y, [dx, dy], whole)?;
            Some(f64::from(prev + next) / 2.0)
        };
        let (near, far) = (f64::from(DERIVATIVE[3]), f64::from(DERIVATIVE[4]));
        let gx = near * (mean(1, 0)? - mean(-1, 0)?) + far * (mean(2, 0)? - mean(-2, 0)?);
        let gy = near * (mean(0, 1)? - mean(0, -1)?) + far * (mean(0, 2)? - mean(0, -2)?);
        let (_, [px, py]) = self.half(pixel, whole);
        Some((
            [
                gx,
                gy,
                gx * px,
                gx * py,
                gy * px,
                gy * py,
                1.0,
                px,
                py,
                f64::from(prev + next) / 2.0,
                f64::from(next - prev),
            ],
            weight,
        ))
    }
}

/// A plane at a pixel, filtered; `None` where the filter does not fit.
#[inline(always)]
fn filtered(plane: &Plane, [x, y]: [isize; 2], across: Taps, down: Taps) -> Option<f32> {
    let radius = RADIUS as isize;
    let inside = |at: isize, size: usize| at >= radius && at + radius < size as isize;
    if !inside(x, plane.width()) || !inside(y, plane.height()) {
        return None;
    }
    let (left, top) = (x as usize - RADIUS, y as usize - RADIUS);
    let mut sum = 0.0;
    for (k, tap) in down.iter().enumerate() {
        let row = &plane.row(top + k)[left..left + 2 * RADIUS + 1];
        let outer = across[0] * row[0] + across[4] * row[4];
        let inner = across[1] * row[1] + across[3] * row[3];
        sum += tap * (outer + inner + across[2] * row[2]);
    }
    Some(sum)
}

/// Both frames at all pixels of the window and around it.
struct Sampled<'a> {
    /// The first pixel, and columns with those around them.
    start: [isize; 2],
    width: usize,
    /// For each pixel prev and next, NaN where they do not show it, and the whole pixels between them.
    values: &'a [([f32; 2], Match)],
}

impl Sampled<'_> {
    fn pixel(&self, x: usize, y: usize) -> [isize; 2] {
        [self.start[0] + x as isize, self.start[1] + y as isize]
    }

    fn at(&self, x: usize, y: usize, whole: [isize; 2]) -> Option<[f32; 2]> {
        let (values, found) = self.values[y * self.width + x];
        (found.whole == whole && !values[0].is_nan() && !values[1].is_nan()).then_some(values)
    }

    /// The pixel `by` away, compared over the same whole pixels.
    #[inline(always)]
    fn near(
        &self,
        view: &View<'_>,
        x: usize,
        y: usize,
        by: [isize; 2],
        whole: [isize; 2],
    ) -> Option<[f32; 2]> {
        let (nx, ny) = (x.wrapping_add_signed(by[0]), y.wrapping_add_signed(by[1]));
        self.at(nx, ny, whole)
            .or_else(|| view.sample(self.pixel(nx, ny), whole))
    }
}

/// What is kept from evaluation to evaluation.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    values: Vec<([f32; 2], Match)>,
    clusters: Vec<Sums>,
}

/// Sums of products of all features, each once, row after row from the diagonal on.
pub(super) type Sums = [f64; PRODUCTS];

/// The index of the product of two features.
pub(super) fn index(i: usize, j: usize) -> usize {
    let (i, j) = (i.min(j), i.max(j));
    i * (2 * FEATURES - i - 1) / 2 + j
}

impl Problem<'_> {
    /// Sums over clusters of the window at one motion: no sum reaches over two of them, so that threads change no bit.
    fn cluster_sums(&mut self, view: &View<'_>) -> Result<()> {
        let execution = &self.options.execution;
        let Workspace { values, clusters } = &mut self.workspace.affine;
        let [columns, rows] = view.pair.window.map(|(low, high)| high - low);
        let margin = RADIUS;
        let (width, height) = (columns + 2 * margin, rows + 2 * margin);
        let start = (view.pair.window).map(|(low, _)| low as isize - margin as isize);
        values.clear();
        let absent = ([f32::NAN; 2], Match::default());
        resize("samples", values, width.saturating_mul(height), absent)?;
        for_each_band(
            execution,
            height,
            (BAND_PIXELS / width).max(1),
            RowsMut::new(values, width),
            |band, mut part| {
                for (local, y) in band.enumerate() {
                    for (x, value) in part.row_mut(local).iter_mut().enumerate() {
                        let pixel = [start[0] + x as isize, start[1] + y as isize];
                        let whole = view.whole(pixel);
                        let found = view.sample(pixel, whole);
                        *value = (found.unwrap_or([f32::NAN; 2]), Match { whole });
                    }
                }
            },
        )?;
        let sampled = Sampled {
            start,
            width,
            values,
        };
        let (across, down) = (columns.div_ceil(CLUSTER), rows.div_ceil(CLUSTER));
        clusters.clear();
        resize("clusters", clusters, across * down, [0.0; PRODUCTS])?;
        for_each_band(
            execution,
            down,
            (BAND_PIXELS / (width * CLUSTER)).max(1),
            RowsMut::new(clusters, across),
            |band, mut part| {
                for (local, cluster) in band.enumerate() {
                    let sums = part.row_mut(local);
                    for y in cluster * CLUSTER..((cluster + 1) * CLUSTER).min(rows) {
                        for x in 0..columns {
                            if let Some((features, weight)) =
                                view.features(&sampled, x + margin, y + margin)
                            {
                                add(&mut sums[x / CLUSTER], &features, weight);
                            }
                        }
                    }
                }
            },
        )
    }

    /// The displacement that varies linearly over the window, from one that does not; `None` if too few pixels are
    /// shown by both frames.
    pub(super) fn affine(&mut self, start: &Found, from: usize) -> Result<Option<Affine>> {
        let mut motion = [0.0; MOTION];
        let mut found = None;
        for level in (0..=from).rev() {
            let scale = f64::from(1u32 << level);
            let pair = self.inputs.pair(level);
            // Pixel (x, y) of a level sits over pixel (2^level x, 2^level y).
            let center = self.inputs.center().map(|value| value / scale);
            let unit = self.inputs.half_side() / scale;
            if level == from {
                motion[..2].copy_from_slice(&start.displacement.map(|value| value / scale));
            } else {
                motion[0] *= 2.0;
                motion[1] *= 2.0;
            }
            let mut steady = false;
            for iteration in 0..ITERATIONS {
                let view = View {
                    pair,
                    motion,
                    center,
                    unit,
                };
                self.cluster_sums(&view)?;
                let light = Light::new(self.options.illumination);
                let rounding = self.inputs.normalization.rounding / (scale * scale);
                let damping = start.solution.damping;
                let solved = solve(
                    &self.workspace.affine.clusters,
                    light,
                    view.noise(),
                    rounding,
                    damping,
                );
                let Some(mut solution) = solved else {
                    return Ok(None);
                };
                let mut length: f64 = 0.0;
                for (index, value) in motion.iter_mut().enumerate() {
                    let step = solution.motion[index];
                    length = length.max(step.abs());
                    *value += if index < 2 { step } else { step / unit };
                }
                if !length.is_finite() || motion[2..].iter().any(|value| value.abs() > MAX_GRADIENT)
                {
                    return Ok(None);
                }
                // Where a pixel's counterpart changes the sums jump, by far less than their deviation.
                let deviation = (solution.covariance[0][0] + solution.covariance[1][1]).sqrt();
                let settled = if level == 0 { SETTLED } else { COARSE_SETTLED };
                steady = length < settled.max(SETTLED_SHARE * deviation);
                // Where a few pixels change to and fro it goes on like this: no further off than they say.
                let last = iteration + 1 == ITERATIONS && length < deviation;
                if last && !steady {
                    steady = true;
                    let more = 1.0 + (length / deviation).powi(2);
                    solution.covariance = solution.covariance.map(|row| row.map(|v| more * v));
                }
                solution.motion = motion;
                solution.steady = steady;
                for i in 0..MOTION {
                    for j in 0..MOTION {
                        for index in [i, j] {
                            solution.covariance[i][j] /= if index < 2 { 1.0 } else { unit };
                        }
                    }
                }
                found = Some(solution);
                if steady {
                    break;
                }
            }
            if !steady && level == 0 {
                break;
            }
        }
        Ok(found.map(Affine::corrected))
    }
}

fn add(sums: &mut Sums, features: &Sample, weight: f64) {
    let mut next = 0;
    for i in 0..FEATURES {
        let weighted = weight * features[i];
        for j in i..FEATURES {
            sums[next] += weighted * features[j];
            next += 1;
        }
    }
}

/// One step of the motion, in the unit of x and y, from the sums of all clusters.
fn solve(
    clusters: &[Sums],
    light: Light,
    noise: NoiseGain,
    rounding: f64,
    damping: f64,
) -> Option<Affine> {
    let mut sums = [0.0; PRODUCTS];
    for cluster in clusters {
        for (sum, more) in sums.iter_mut().zip(cluster) {
            *sum += more;
        }
    }
    let of = |i: usize, j: usize| sums[index(i, j)];
    let count = of(ONE, ONE);
    // What light explains of motion's features and of the difference.
    let pivots: Vec<usize> = (ONE..DIFFERENCE)
        .filter(|feature| {
            if *feature == MEAN {
                light.gain
            } else {
                light.offset
            }
        })
        .collect();
    let mut degrees = count - MOTION as f64;
    let mut left: [[f64; FEATURES]; FEATURES] =
        std::array::from_fn(|i| std::array::from_fn(|j| of(i, j)));
    // Each row: a feature less what light explains of it, as a combination of all features.
    let mut combination: [[f64; FEATURES]; FEATURES] =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    let mut texture = of(MEAN, MEAN) - of(ONE, MEAN).powi(2) / count.max(1.0);
    for pivot in pivots {
        if pivot == MEAN {
            texture = left[MEAN][MEAN];
        }
        if left[pivot][pivot] <= 1e-7 * of(pivot, pivot) || left[pivot][pivot] <= 0.0 {
            continue;
        }
        degrees -= 1.0;
        let row = left[pivot];
        let known = combination[pivot];
        for i in 0..FEATURES {
            if i != pivot {
                let factor = left[i][pivot] / row[pivot];
                for j in 0..FEATURES {
                    left[i][j] -= factor * row[j];
                    combination[i][j] -= factor * known[j];
                }
            }
        }
    }
    if degrees < 16.0 {
        return None;
    }
    let a: Square = std::array::from_fn(|i| std::array::from_fn(|j| left[i][j]));
    let b: [f64; MOTION] = std::array::from_fn(|i| left[i][DIFFERENCE]);
    let inverse_a = inverse(&a)?;
    let step: [f64; MOTION] =
        std::array::from_fn(|i| -(0..MOTION).map(|j| inverse_a[i][j] * b[j]).sum::<f64>());
    let before = left[DIFFERENCE][DIFFERENCE].max(0.0);
    let explained: f64 = (0..MOTION).map(|i| step[i] * b[i]).sum();
    let residual = (before + explained).max(0.0);
    let variance = (residual / degrees).max(2.0 * rounding * noise.sampled);
    let in_band = variance / noise.sampled;
    // Noise adds to the sums of squared gradients, and not to what they tell.
    let mut clean = a;
    const PLACE: [usize; MOTION] = [ONE, ONE, X, Y, X, Y];
    const AXIS: [usize; MOTION] = [0, 1, 0, 0, 1, 1];
    for i in 0..MOTION {
        for j in 0..MOTION {
            if AXIS[i] == AXIS[j] {
                clean[i][j] -= in_band / 4.0 * noise.gradient[AXIS[i]] * of(PLACE[i], PLACE[j]);
            }
        }
    }
    let inverse_clean = inverse(&clean)?;
    // What each cluster pulls, as the displacement feels it, beside what noise lets expect.
    let mut rest = combination[DIFFERENCE];
    for i in 0..MOTION {
        for j in 0..FEATURES {
            rest[j] += step[i] * combination[i][j];
        }
    }
    let (mut seen, mut expected, mut squares) = (0.0, 0.0, 0.0);
    for cluster in clusters {
        let product = |a: &[f64; FEATURES], b: &[f64; FEATURES]| -> f64 {
            let mut sum = 0.0;
            for i in 0..FEATURES {
                for j in 0..FEATURES {
                    sum += a[i] * cluster[index(i, j)] * b[j];
                }
            }
            sum
        };
        let pulls: [f64; MOTION] = std::array::from_fn(|i| product(&combination[i], &rest));
        let mut part = 0.0;
        for axis in 0..2 {
            let felt: f64 = (0..MOTION).map(|i| inverse_clean[axis][i] * pulls[i]).sum();
            seen += felt * felt;
            let mut tells = [0.0; FEATURES];
            for i in 0..MOTION {
                for j in 0..FEATURES {
                    tells[j] += inverse_clean[axis][i] * combination[i][j];
                }
            }
            part += in_band * damping * product(&tells, &tells);
        }
        expected += part;
        squares += part * part;
    }
    let effective = expected * expected / squares.max(f64::MIN_POSITIVE);
    let ratio = seen / expected.max(f64::MIN_POSITIVE);
    let excess = if ratio > 1.0 + 3.0 / effective.sqrt() && seen > SETTLED * SETTLED {
        ratio
    } else {
        1.0
    };
    let mut covariance = [[0.0; MOTION]; MOTION];
    for i in 0..MOTION {
        for j in 0..MOTION {
            for k in 0..MOTION {
                for l in 0..MOTION {
                    covariance[i][j] += inverse_clean[i][k] * a[k][l] * inverse_clean[l][j];
                }
            }
            covariance[i][j] *= in_band * damping * excess;
        }
    }
    // Rounding makes the two halves differ.
    for i in 0..MOTION {
        for j in 0..i {
            covariance[i][j] = covariance[j][i];
        }
    }
    let by_noise = in_band * damping;
    let curvature = correction(
        clusters,
        [&combination[0], &combination[1]],
        &rest,
        by_noise,
        std::array::from_fn(|i| std::array::from_fn(|j| covariance[i][j] / excess)),
    );
    let spread = left[MEAN][MEAN];
    let gain = if light.gain && spread > 0.0 {
        (left[MEAN][DIFFERENCE] + (0..MOTION).map(|i| step[i] * left[MEAN][i]).sum::<f64>())
            / spread
    } else {
        0.0
    };
    let offset = if light.offset {
        (of(ONE, DIFFERENCE) - gain * of(ONE, MEAN)) / count
    } else {
        0.0
    };
    let [shared, size] = agreement(texture, gain, residual, light);
    Some(Affine {
        motion: step,
        covariance,
        alpha: gain,
        beta: offset,
        residual: (residual / degrees).sqrt(),
        correlation: shared / size.max(1e-12),
        samples: (count / 9.0).min(
            count * (clean[0][0] + clean[1][1]) / (std::f64::consts::TAU * texture.max(1e-12)),
        ),
        steady: false,
        curvature,
    })
}

type Square = [[f64; MOTION]; MOTION];

/// The inverse of a symmetric positive matrix; `None` if it is not one.
fn inverse(matrix: &Square) -> Option<Square> {
    let mut left = *matrix;
    let mut right: Square =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for pivot in 0..MOTION {
        // No pivoting: what is left of the diagonal of a positive matrix stays positive.
        if left[pivot][pivot] <= 1e-9 * matrix[pivot][pivot] || left[pivot][pivot] <= 0.0 {
            return None;
        }
        let one = 1.0 / left[pivot][pivot];
        for j in 0..MOTION {
            left[pivot][j] *= one;
            right[pivot][j] *= one;
        }
        let (of_left, of_right) = (left[pivot], right[pivot]);
        for i in 0..MOTION {
            if i != pivot {
                let factor = left[i][pivot];
                for j in 0..MOTION {
                    left[i][j] -= factor * of_left[j];
                    right[i][j] -= factor * of_right[j];
                }
            }
        }
    }
    Some(right)
}
