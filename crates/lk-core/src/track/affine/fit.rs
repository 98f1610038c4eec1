//! The affine motion of a neighbourhood.

use crate::track::affine::warp::Warp;

/// So many points at least fix an affine motion with one to spare.
const LEAST_POINTS: f64 = 4.0;

/// Root mean square of what a fit may leave, in pixels: more are points of several motions.
const MOST_LEFT: f64 = 1.0;

/// Least squares of displacements over offsets: u = a + b x + c y on both axes.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::track) struct Fit {
    /// Of 1, x, y, xx, xy, yy.
    sums: [f64; 6],
    /// Of each displacement with 1, x, y, and squared.
    with: [[f64; 4]; 2],
}

impl Fit {
    /// Add a point at `offset` that moves by `shift`.
    pub(in crate::track) fn add(&mut self, [x, y]: [f64; 2], shift: [f64; 2]) {
        let terms = [1.0, x, y, x * x, x * y, y * y];
        for (sum, term) in self.sums.iter_mut().zip(terms) {
            *sum += term;
        }
        for (with, shift) in self.with.iter_mut().zip(shift) {
            for (sum, term) in with.iter_mut().zip([1.0, x, y, shift]) {
                *sum += shift * term;
            }
        }
    }

    /// The warp of the point that the offsets are from, if they fix one that they agree on.
    pub(in crate::track) fn warp(&self) -> Option<Warp> {
        let [count, x, y, xx, xy, yy] = self.sums;
        if count < LEAST_POINTS {
            return None;
        }
        let mean = [x / count, y / count];
        let (xx, xy, yy) = (xx - x * mean[0], xy - x * mean[1], yy - y * mean[1]);
        let determinant = xx * yy - xy * xy;
        // Points along one line say nothing across it.
        if determinant <= 0.02 * (xx + yy) * (xx + yy) {
            return None;
        }
        let mut shift = [0.0; 2];
        let mut matrix = Warp::IDENTITY;
        let mut left = 0.0;
        for axis in 0..2 {
            let [one, with_x, with_y, square] = self.with[axis];
            let (with_x, with_y) = (with_x - mean[0] * one, with_y - mean[1] * one);
            let across = (yy * with_x - xy * with_y) / determinant;
            let down = (xx * with_y - xy * with_x) / determinant;
            shift[axis] = one / count - across * mean[0] - down * mean[1];
            matrix[axis][0] += across;
            matrix[axis][1] += down;
            left += square - one * one / count - across * with_x - down * with_y;
        }
        let warp = Warp { shift, matrix };
        let near = left <= MOST_LEFT * MOST_LEFT * count;
        (near && warp.is_plausible()).then_some(warp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_affine_motion_is_found_and_two_motions_are_not_one() {
        let offsets = [
            [3.0, 9.0],
            [-12.0, 4.0],
            [8.0, -11.0],
            [15.0, 6.0],
            [-5.0, -7.0],
        ];
        let moves = Warp {
            shift: [4.5, -2.25],
            matrix: [[0.95, -0.2], [0.15, 1.1]],
        };
        let mut fit = Fit::default();
        for offset in offsets {
            fit.add(offset, moves.displacement(offset));
        }
        let found = fit.warp().unwrap();
        for axis in 0..2 {
            assert!((found.shift[axis] - moves.shift[axis]).abs() < 1e-9);
            for column in 0..2 {
                assert!((found.matrix[axis][column] - moves.matrix[axis][column]).abs() < 1e-9);
            }
        }
        let mut two = Fit::default();
        for (number, offset) in offsets.into_iter().enumerate() {
            two.add(offset, [if number % 2 == 0 { 5.0 } else { -5.0 }, 0.0]);
        }
        assert!(two.warp().is_none());
        let mut line = Fit::default();
        for step in 0..6 {
            line.add([f64::from(step), 2.0 * f64::from(step)], [1.0, 2.0]);
        }
        assert!(line.warp().is_none());
    }
}
