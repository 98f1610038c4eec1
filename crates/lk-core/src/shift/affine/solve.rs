//! One step of the motion: the light is eliminated, and the covariance holds what clusters say against each other.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::clusters::Clusters;
use super::curvature::correction;
use super::solution::Affine;
use super::sums::{Form, Sums, index};
use super::view::{DIFFERENCE, FEATURES, MEAN, MOTION, ONE, X, Y};
use crate::error::Result;
use crate::memory::replace;
use crate::shift::filters::NoiseGain;
use crate::shift::gram::{Light, agreement};
use crate::shift::robust_covariance::{Cell, Inflation};
use crate::shift::solution::PIXELS_PER_SAMPLE;

/// A step below this settles, in pixels at the border of the window.
pub(super) const SETTLED: f64 = 1e-3;
/// Pixels beyond the unknowns, below which their residual says nothing.
const MIN_DEGREES: f64 = 16.0;
/// The place that the gradient of each component of the motion is multiplied by, and the axis of that gradient.
const PLACE: [usize; MOTION] = [ONE, ONE, X, Y, X, Y];
const AXIS: [usize; MOTION] = [0, 1, 0, 0, 1, 1];

type Square = [[f64; MOTION]; MOTION];

/// One step of the motion, in the unit of x and y, from the sums of all clusters.
pub(super) fn solve(
    clusters: Clusters<'_>,
    light: Light,
    noise: NoiseGain,
    rounding: f64,
    damping: f64,
    cells: &mut Vec<Cell>,
) -> Result<Option<Affine>> {
    let sums = Totals::of(clusters.sums);
    let count = sums.of_product(ONE, ONE);
    let reduced = Reduced::new(&sums, light);
    if reduced.degrees < MIN_DEGREES {
        return Ok(None);
    }
    let (left, degrees) = (&reduced.left, reduced.degrees);
    let a: Square = std::array::from_fn(|i| std::array::from_fn(|j| left[i][j]));
    let b: [f64; MOTION] = std::array::from_fn(|i| left[i][DIFFERENCE]);
    let Some(inverse_a) = inverse(&a) else {
        return Ok(None);
    };
    let step: [f64; MOTION] =
        std::array::from_fn(|i| -(0..MOTION).map(|j| inverse_a[i][j] * b[j]).sum::<f64>());
    let before = left[DIFFERENCE][DIFFERENCE].max(0.0);
    let explained: f64 = (0..MOTION).map(|i| step[i] * b[i]).sum();
    let residual = (before + explained).max(0.0);
    let variance = (residual / degrees).max(2.0 * rounding * noise.sampled);
    let in_band = variance / noise.sampled;
    // Noise adds to the sums of squared gradients, and not to what they tell.
    let mut clean = a;
    for i in 0..MOTION {
        for j in 0..MOTION {
            if AXIS[i] == AXIS[j] {
                clean[i][j] -=
                    in_band / 4.0 * noise.gradient[AXIS[i]] * sums.of_product(PLACE[i], PLACE[j]);
            }
        }
    }
    let Some(inverse_clean) = inverse(&clean) else {
        return Ok(None);
    };
    let rest = reduced.rest(&step);
    let by_noise = in_band * damping;
    let inflation = reduced.inflation(clusters, &rest, &inverse_clean, by_noise, cells)?;
    let excess = inflation.parts;
    let covariance = sandwich(&inverse_clean, &a, by_noise * excess);
    let curvature = correction(
        clusters.sums,
        [&reduced.combination[0], &reduced.combination[1]],
        &rest,
        by_noise,
        std::array::from_fn(|i| std::array::from_fn(|j| covariance[i][j] / excess)),
    );
    let (gain, offset) = reduced.light(&sums, light, &step);
    let [shared, size] = agreement(reduced.texture, gain, residual, light);
    Ok(Some(Affine {
        motion: step,
        covariance,
        alpha: gain,
        beta: offset,
        residual: (residual / degrees).sqrt(),
        correlation: shared / size.max(1e-12),
        samples: (count / PIXELS_PER_SAMPLE).min(
            count * (clean[0][0] + clean[1][1])
                / (std::f64::consts::TAU * reduced.texture.max(1e-12)),
        ),
        steady: false,
        curvature,
        excess,
    }))
}

/// The sums of all clusters.
struct Totals(Sums);

impl Totals {
    fn of(clusters: &[Sums]) -> Self {
        let mut sums = [0.0; _];
        for cluster in clusters {
            for (sum, more) in sums.iter_mut().zip(cluster) {
                *sum += more;
            }
        }
        Self(sums)
    }

    /// That of the product of two features.
    fn of_product(&self, i: usize, j: usize) -> f64 {
        self.0[index(i, j)]
    }
}

/// The products of what light leaves of the features.
struct Reduced {
    left: [[f64; FEATURES]; FEATURES],
    /// Each row: a feature less what light explains of it, as a combination of all features.
    combination: [[f64; FEATURES]; FEATURES],
    /// Pixels less unknowns.
    degrees: f64,
    /// What an offset leaves of the squared mean of both frames.
    texture: f64,
}

impl Reduced {
    /// Eliminate what light explains of motion's features and of the difference.
    fn new(sums: &Totals, light: Light) -> Self {
        let of = |i: usize, j: usize| sums.of_product(i, j);
        let count = of(ONE, ONE);
        let pivots = (ONE..DIFFERENCE).filter(|feature| {
            if *feature == MEAN {
                light.gain
            } else {
                light.offset
            }
        });
        let mut degrees = count - MOTION as f64;
        let mut left: [[f64; FEATURES]; FEATURES] =
            std::array::from_fn(|i| std::array::from_fn(|j| of(i, j)));
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
        Self {
            left,
            combination,
            degrees,
            texture,
        }
    }

    /// What light and a step leave of the difference, as a combination of all features.
    fn rest(&self, step: &[f64; MOTION]) -> [f64; FEATURES] {
        let mut rest = self.combination[DIFFERENCE];
        for i in 0..MOTION {
            for j in 0..FEATURES {
                rest[j] += step[i] * self.combination[i][j];
            }
        }
        rest
    }

    /// By how much the variance is larger than noise explains: what each cluster pulls, as the displacement feels it,
    /// beside what noise lets expect; see [`covariance_inflation`](crate::shift::robust_covariance).
    fn inflation(
        &self,
        Clusters { sums, across }: Clusters<'_>,
        rest: &[f64; FEATURES],
        inverse_clean: &Square,
        by_noise: f64,
        cells: &mut Vec<Cell>,
    ) -> Result<Inflation> {
        // What the displacement feels along each axis.
        let mut tells = [[0.0; FEATURES]; 2];
        for (tells, inverse) in tells.iter_mut().zip(inverse_clean) {
            for (weight, combination) in inverse.iter().zip(&self.combination) {
                for (to, from) in tells.iter_mut().zip(combination) {
                    *to += weight * from;
                }
            }
        }
        let felt = [0, 1].map(|axis| Form::of(&tells[axis], rest));
        let noise = [0, 1].map(|axis| Form::of(&tells[axis], &tells[axis]));
        let felt = sums.iter().map(|cluster| Cell {
            pull: [felt[0].at(cluster), felt[1].at(cluster)],
            noise: by_noise * (noise[0].at(cluster) + noise[1].at(cluster)),
        });
        replace("clusters", cells, felt)?;
        let found = Inflation::of(cells, across, [[1.0, 0.0], [0.0, 1.0]]);
        Ok(found)
    }

    /// Symmetric gain and offset after a step.
    fn light(&self, sums: &Totals, light: Light, step: &[f64; MOTION]) -> (f64, f64) {
        let left = &self.left;
        let contrast = left[MEAN][MEAN];
        let gain = if light.gain && contrast > 0.0 {
            (left[MEAN][DIFFERENCE] + (0..MOTION).map(|i| step[i] * left[MEAN][i]).sum::<f64>())
                / contrast
        } else {
            0.0
        };
        let offset = if light.offset {
            (sums.of_product(ONE, DIFFERENCE) - gain * sums.of_product(ONE, MEAN))
                / sums.of_product(ONE, ONE)
        } else {
            0.0
        };
        (gain, offset)
    }
}

/// The covariance of the motion, `inverse a inverse` times `scale`.
fn sandwich(inverse: &Square, a: &Square, scale: f64) -> Square {
    let mut covariance = [[0.0; MOTION]; MOTION];
    for i in 0..MOTION {
        for j in 0..MOTION {
            for k in 0..MOTION {
                for l in 0..MOTION {
                    covariance[i][j] += inverse[i][k] * a[k][l] * inverse[l][j];
                }
            }
            covariance[i][j] *= scale;
        }
    }
    // Rounding makes the two halves differ.
    for i in 0..MOTION {
        for j in 0..i {
            covariance[i][j] = covariance[j][i];
        }
    }
    covariance
}

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
