//! The point on whose lines things move against a plane: candidates, and the best for weighted lines.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::things::Cell;

/// Two directions differ by this angle at least, in radians, however sure flow is: lens and plane are not ideal.
pub(super) const ANGLE: f64 = 0.035;
/// Rounds in which lines are weighted by how far the point is.
const ROUNDS: usize = 3;

/// A homogeneous point of unit length.
pub(super) type Point = [f64; 3];

/// Towards a point from a place; its length says how far, next to 1 for points far away.
#[inline]
pub(super) fn toward(point: &Point, place: [f64; 2]) -> [f64; 2] {
    [
        point[0] - point[2] * place[0],
        point[1] - point[2] * place[1],
    ]
}

/// A direction at a place, with the inverse variance of its angle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) place: [f64; 2],
    pub(super) motion: [f64; 2],
    pub(super) weight: f64,
}

impl Line {
    pub(super) fn of(cell: &Cell) -> Self {
        let square = cell.motion[0] * cell.motion[0] + cell.motion[1] * cell.motion[1];
        Self {
            place: cell.place,
            motion: cell.motion,
            weight: 1.0 / (cell.variance / square + ANGLE * ANGLE),
        }
    }

    fn line(&self) -> Point {
        let length = self.motion[0].hypot(self.motion[1]).max(1e-12);
        let [dx, dy] = self.motion.map(|part| part / length);
        // (place, 1) x (direction, 0)
        [-dy, dx, self.place[0] * dy - self.place[1] * dx]
    }
}

/// Where two lines cross, also far away; none of one line.
pub(super) fn crossing(a: &Line, b: &Line) -> Option<Point> {
    let (a, b) = (a.line(), b.line());
    normalised([
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ])
}

/// The point nearest in angle to all lines, and to a point that is known, by the inverse variance of its angle.
pub(super) fn nearest<'a>(
    lines: impl Iterator<Item = &'a Line> + Clone,
    start: Option<&Point>,
    known: Option<(&Point, f64)>,
) -> Option<Point> {
    let mut point = start.copied();
    for _ in 0..ROUNDS {
        let mut sum = [[0.0; 3]; 3];
        for line in lines.clone() {
            let l = line.line();
            let far = point.map_or(1.0, |point| {
                let [x, y] = toward(&point, line.place);
                (x * x + y * y).max(1e-3)
            });
            for i in 0..3 {
                for j in 0..3 {
                    sum[i][j] += line.weight / far * l[i] * l[j];
                }
            }
        }
        if let Some((known, weight)) = known {
            for i in 0..3 {
                sum[i][i] += weight;
                for j in 0..3 {
                    sum[i][j] -= weight * known[i] * known[j];
                }
            }
        }
        let found = least(sum)?;
        // The same way round as at the start.
        let flip = point.is_some_and(|point| dot(&point, &found) < 0.0);
        point = Some(if flip { found.map(|part| -part) } else { found });
    }
    point
}

pub(super) fn dot(a: &Point, b: &Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn normalised(point: Point) -> Option<Point> {
    let length = dot(&point, &point).sqrt();
    (length > 1e-9 && length.is_finite()).then(|| point.map(|part| part / length))
}

/// The eigenvector of the least eigenvalue of a symmetric matrix, by Jacobi's rotations.
fn least(mut a: [[f64; 3]; 3]) -> Option<Point> {
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q].abs() < 1e-300 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let t = if theta == 0.0 { 1.0 } else { t };
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for k in 0..3 {
                let (kp, kq) = (a[k][p], a[k][q]);
                a[k][p] = c * kp - s * kq;
                a[k][q] = s * kp + c * kq;
            }
            for k in 0..3 {
                let (pk, qk) = (a[p][k], a[q][k]);
                a[p][k] = c * pk - s * qk;
                a[q][k] = s * pk + c * qk;
            }
            for row in &mut v {
                let (p_part, q_part) = (row[p], row[q]);
                row[p] = c * p_part - s * q_part;
                row[q] = s * p_part + c * q_part;
            }
        }
    }
    let k = (0..3).min_by(|&i, &j| a[i][i].total_cmp(&a[j][j]))?;
    normalised([v[0][k], v[1][k], v[2][k]])
}

/// Solve a small symmetric system by elimination; none where it is open.
pub(super) fn solved<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    for k in 0..N {
        let pivot = (k..N).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        a.swap(k, pivot);
        b.swap(k, pivot);
        if a[k][k].is_nan() || a[k][k].abs() < 1e-300 {
            return None;
        }
        for i in k + 1..N {
            let factor = a[i][k] / a[k][k];
            for j in k..N {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for i in (0..N).rev() {
        let known: f64 = (i + 1..N).map(|j| a[i][j] * b[j]).sum();
        b[i] = (b[i] - known) / a[i][i];
    }
    Some(b)
}
