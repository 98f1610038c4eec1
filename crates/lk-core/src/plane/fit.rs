//! One motion over a plane from many displacements: robust least squares with what is known of the rotation.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::motion::{PlaneMotion, UNKNOWNS};

/// Tukey's biweight keeps 95 % of the efficiency of least squares under Gaussian noise with this constant.
const TUKEY: f64 = 4.685;
/// Under Gaussian noise the squares of residuals, weighted by the biweight, come to this part of the unweighted share.
const TRIMMED: f64 = 0.87;
/// Median length of two unit Gaussians: sqrt(2 ln 2).
const MEDIAN_LENGTH: f64 = 1.17741;
/// Weight, in degrees of freedom, of the displacements' own covariances against the residuals when both judge the noise.
const PRIOR_DOF: f64 = 10.0;

/// A square matrix over the unknowns.
pub type Normal = [[f64; UNKNOWNS]; UNKNOWNS];

/// One displacement beside what a motion predicts for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Equation {
    /// Measured less predicted, x and y, in pixels.
    pub(super) residual: [f64; 2],
    /// Inverse of its covariance: xx, xy, yy.
    pub(super) information: [f64; 3],
    /// Slopes of the prediction: of x, of y.
    pub(super) slopes: [[f64; UNKNOWNS]; 2],
}

impl Equation {
    /// Residual after a step, as a number of standard deviations.
    fn length(&self, step: &PlaneMotion) -> f64 {
        let [x, y] = self.left(step);
        let [xx, xy, yy] = self.information;
        (xx * x * x + 2.0 * xy * x * y + yy * y * y).max(0.0).sqrt()
    }

    pub(super) fn left(&self, step: &PlaneMotion) -> [f64; 2] {
        std::array::from_fn(|axis| {
            let moved: f64 = (0..UNKNOWNS).map(|k| self.slopes[axis][k] * step[k]).sum();
            self.residual[axis] - moved
        })
    }

    /// Information times a vector over x and y.
    pub(super) fn informed(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [xx, xy, yy] = self.information;
        [xx * x + xy * y, xy * x + yy * y]
    }
}

/// What is known of a rotation vector: zero, give or take these standard deviations.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    /// Inverse covariance of the six unknowns.
    pub(super) precision: Normal,
    /// Where each unknown is, from where the equations are.
    pub(super) at: PlaneMotion,
}

/// A step of the motion, and what it was found from.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub(super) step: PlaneMotion,
    /// Normal matrix of the displacements alone, divided by the square of `scale`.
    pub(super) normal: Normal,
    /// Standard deviations of the residuals, in those that the displacements came with.
    pub(super) scale: f64,
    /// Of each equation, 0 to 1.
    pub(super) weights: Vec<f64>,
}

/// Solve for a step; none where displacements and knowledge leave a direction open.
pub(super) fn robust(equations: &[Equation], known: &Known, rounds: [usize; 2]) -> Option<Step> {
    let count = equations.len();
    if count < 3 {
        return None;
    }
    let expected = MEDIAN_LENGTH * (1.0 - UNKNOWNS as f64 / (2.0 * count as f64)).max(0.2);
    let mut lengths: Vec<f64> = equations
        .iter()
        .map(|e| e.length(&[0.0; UNKNOWNS]))
        .collect();
    let mut sorted = lengths.clone();
    let mut weights = vec![1.0; count];
    let (mut scale, mut step) = (1.0, [0.0; UNKNOWNS]);
    let [lengths_first, then] = rounds;
    for round in 0..lengths_first + then {
        sorted.copy_from_slice(&lengths);
        let middle = median(&mut sorted);
        if round < lengths_first {
            let least = (0.3 * middle).max(1e-9);
            for (weight, length) in weights.iter_mut().zip(&lengths) {
                *weight = least / length.max(least);
            }
        } else {
            scale = (middle / expected).max(0.05);
            for (weight, length) in weights.iter_mut().zip(&lengths) {
                *weight = biweight(*length / scale);
            }
        }
        let (normal, right) = normal(equations, &weights, &step);
        let added = with_known(&normal, &right, known, &step, scale)?;
        for (value, by) in step.iter_mut().zip(added) {
            *value += by;
        }
        let mut moved: f64 = 0.0;
        for (length, equation) in lengths.iter_mut().zip(equations) {
            let before = *length;
            *length = equation.length(&step);
            moved = moved.max((before - *length).abs());
        }
        if round >= lengths_first && moved < 1e-3 * scale {
            break;
        }
    }
    let squares: f64 = weights.iter().zip(&lengths).map(|(w, l)| w * l * l).sum();
    let freedom = (2.0 * weights.iter().sum::<f64>() - UNKNOWNS as f64).max(0.0);
    let variance = (squares / TRIMMED + PRIOR_DOF) / (freedom + PRIOR_DOF);
    let (mut found, _) = normal(equations, &weights, &step);
    for value in found.iter_mut().flatten() {
        *value /= variance;
    }
    Some(Step {
        step,
        normal: found,
        scale: variance.sqrt(),
        weights,
    })
}

/// Tukey's weight of a residual of so many standard deviations.
pub(super) fn biweight(length: f64) -> f64 {
    let share = length / TUKEY;
    if share < 1.0 {
        (1.0 - share * share).powi(2)
    } else {
        0.0
    }
}

/// Weighted normal equations about a step.
fn normal(equations: &[Equation], weights: &[f64], step: &PlaneMotion) -> (Normal, PlaneMotion) {
    let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
    let mut right = [0.0; UNKNOWNS];
    for (equation, weight) in equations.iter().zip(weights) {
        if *weight == 0.0 {
            continue;
        }
        let left = equation.informed(equation.left(step));
        for i in 0..UNKNOWNS {
            let slope = [equation.slopes[0][i], equation.slopes[1][i]];
            right[i] += weight * (slope[0] * left[0] + slope[1] * left[1]);
            let informed = equation.informed(slope);
            for j in i..UNKNOWNS {
                matrix[i][j] += weight
                    * (informed[0] * equation.slopes[0][j] + informed[1] * equation.slopes[1][j]);
            }
        }
    }
    for i in 0..UNKNOWNS {
        for j in 0..i {
            matrix[i][j] = matrix[j][i];
        }
    }
    (matrix, right)
}

/// The solution of normal equations, with the squared `scale` on what is known.
fn with_known(
    normal: &Normal,
    right: &PlaneMotion,
    known: &Known,
    step: &PlaneMotion,
    scale: f64,
) -> Option<PlaneMotion> {
    let (mut matrix, mut right) = (*normal, *right);
    for i in 0..UNKNOWNS {
        for j in 0..UNKNOWNS {
            let precision = known.precision[i][j] * scale * scale;
            matrix[i][j] += precision;
            right[i] += precision * (known.at[j] - step[j]);
        }
    }
    solve(&matrix, &right)
}

/// Solve a symmetric positive system by Cholesky, after scaling each unknown to a unit diagonal; none where singular.
pub(super) fn solve(matrix: &Normal, right: &PlaneMotion) -> Option<PlaneMotion> {
    let mut size = [0.0; UNKNOWNS];
    for k in 0..UNKNOWNS {
        let value = matrix[k][k];
        if value.is_nan() || value <= 0.0 || value.is_infinite() {
            return None;
        }
        size[k] = value.sqrt();
    }
    let mut factor = [[0.0; UNKNOWNS]; UNKNOWNS];
    for i in 0..UNKNOWNS {
        for j in 0..=i {
            let mut value = matrix[i][j] / (size[i] * size[j]);
            for k in 0..j {
                value -= factor[i][k] * factor[j][k];
            }
            if i == j {
                if value.is_nan() || value < 1e-11 {
                    return None;
                }
                factor[i][i] = value.sqrt();
            } else {
                factor[i][j] = value / factor[j][j];
            }
        }
    }
    let mut found = [0.0; UNKNOWNS];
    for i in 0..UNKNOWNS {
        let mut value = right[i] / size[i];
        for k in 0..i {
            value -= factor[i][k] * found[k];
        }
        found[i] = value / factor[i][i];
    }
    for i in (0..UNKNOWNS).rev() {
        let mut value = found[i];
        for k in i + 1..UNKNOWNS {
            value -= factor[k][i] * found[k];
        }
        found[i] = value / factor[i][i];
    }
    for k in 0..UNKNOWNS {
        found[k] /= size[k];
    }
    Some(found)
}

/// The value that half of the others do not exceed; 0 of none. Order is changed.
pub(super) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
