//! Cubic B-splines: the coefficients that interpolate a plane, and its derivatives at pixel centres.
//!
//! M. Unser, A. Aldroubi and M. Eden, "B-spline signal processing", IEEE Transactions on Signal Processing 1993. The
//! recursive filter of the paper is written as the sum that it is, cut where its taps vanish in `f32`: every row then
//! stands for itself.
//!
//! `docs/explanation/algorithms.md`, section "Grid: displacement_grid".

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::{even_bands, for_each_band};
use crate::scratch::with_scratch;

/// Taps on each side: the next one would be 6e-8 of the first.
pub(super) const REACH: usize = 12;

/// The pole of the inverse of the cubic B-spline, sqrt(3) - 2.
const POLE: f64 = -0.267_949_192_431_122_7;

/// Taps at 0, 1, 2, .. of a filter that is symmetric, or antisymmetric.
#[derive(Debug, Clone)]
pub(super) struct Taps {
    side: Vec<f32>,
    odd: bool,
}

impl Taps {
    /// Those that give the coefficients of the spline through samples.
    pub(super) fn inverse() -> Self {
        Self {
            side: (0..=REACH).map(|tap| inverse_tap(tap) as f32).collect(),
            odd: false,
        }
    }

    /// Those that give the derivative of that spline at the samples.
    pub(super) fn derivative() -> Self {
        let tap = |tap: usize| 0.5 * (inverse_tap(tap.abs_diff(1)) - inverse_tap(tap + 1));
        // What stands after a sample adds to the derivative, what stands before it takes away.
        let mut side: Vec<f32> = (0..=REACH).map(|k| tap(k) as f32).collect();
        side[0] = 0.0;
        Self { side, odd: true }
    }

    /// Those that leave little of what is too fine for the samples, so that it does not pull towards whole pixels, and most
    /// of the rest: `1 - sin^4(w / 2)` at frequency `w`, which is zero at the finest, and a Gaussian of `deviation` pixels.
    pub(super) fn smoothing(deviation: f64) -> Self {
        const SHARP: [f64; 3] = [10.0 / 16.0, 4.0 / 16.0, -1.0 / 16.0];
        let gaussian = |at: isize| (-0.5 * (at as f64 / deviation).powi(2)).exp();
        let reach = (3.5 * deviation).ceil() as isize;
        let sum: f64 = (-reach..=reach).map(gaussian).sum();
        let tap = |at: isize| -> f64 {
            let shares = (-reach..=reach).map(|k| {
                let sharp = SHARP.get((at - k).unsigned_abs()).copied().unwrap_or(0.0);
                gaussian(k) / sum * sharp
            });
            shares.sum()
        };
        let last = reach + SHARP.len() as isize - 1;
        Self {
            side: (0..=last).map(|at| tap(at) as f32).collect(),
            odd: false,
        }
    }

    fn reach(&self) -> usize {
        self.side.len() - 1
    }

    /// Filter a row that has `reach` elements more on each side.
    fn row(&self, from: &[f32], to: &mut [f32]) {
        let (reach, width) = (self.reach(), to.len());
        for (to, from) in to.iter_mut().zip(&from[reach..]) {
            *to = self.side[0] * from;
        }
        for (tap, weight) in self.side.iter().enumerate().skip(1) {
            let (before, after) = (&from[reach - tap..][..width], &from[reach + tap..][..width]);
            self.add(*weight, before, after, to);
        }
    }

    fn add(&self, weight: f32, before: &[f32], after: &[f32], to: &mut [f32]) {
        let pairs = before.iter().zip(after);
        if self.odd {
            for (to, (before, after)) in to.iter_mut().zip(pairs) {
                *to += weight * (after - before);
            }
        } else {
            for (to, (before, after)) in to.iter_mut().zip(pairs) {
                *to += weight * (after + before);
            }
        }
    }
}

/// One tap of the inverse.
fn inverse_tap(tap: usize) -> f64 {
    -6.0 * POLE / (1.0 - POLE * POLE) * POLE.powi(tap as i32)
}

/// The index within `0..size` that stands at `at` where the frame is mirrored at its outermost pixels.
fn mirrored(at: isize, size: usize) -> usize {
    let period = 2 * (size as isize - 1).max(1);
    let at = at.rem_euclid(period);
    at.min(period - at).min(size as isize - 1) as usize
}

/// Filter the rows of `from` into `to`.
pub(super) fn along_rows(
    from: &Plane,
    taps: &Taps,
    to: &mut Plane,
    execution: &Execution,
) -> Result<()> {
    let (width, height, reach) = (from.width(), from.height(), taps.reach());
    to.resize(width, height)?;
    if width == 0 || height == 0 {
        return Ok(());
    }
    let min_rows = even_bands(execution, height, [16_384 / width, 8192 / width]);
    for_each_band(
        execution,
        height,
        min_rows,
        to.rows_mut(),
        |rows, mut part| {
            with_scratch(width + 2 * reach, |wide| {
                for (local, y) in rows.enumerate() {
                    let row = from.row(y);
                    wide[reach..reach + width].copy_from_slice(row);
                    for k in 1..=reach {
                        wide[reach - k] = row[mirrored(-(k as isize), width)];
                        wide[reach + width + k - 1] =
                            row[mirrored((width + k - 1) as isize, width)];
                    }
                    taps.row(wide, part.row_mut(local));
                }
            })
        },
    )
}

/// Filter the columns of `from` into `to`.
pub(super) fn along_columns(
    from: &Plane,
    taps: &Taps,
    to: &mut Plane,
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (from.width(), from.height());
    to.resize(width, height)?;
    if width == 0 || height == 0 {
        return Ok(());
    }
    let min_rows = even_bands(execution, height, [16_384 / width, 8192 / width]);
    for_each_band(
        execution,
        height,
        min_rows,
        to.rows_mut(),
        |rows, mut part| {
            for (local, y) in rows.enumerate() {
                let to = part.row_mut(local);
                for (to, from) in to.iter_mut().zip(from.row(y)) {
                    *to = taps.side[0] * from;
                }
                for (tap, weight) in taps.side.iter().enumerate().skip(1) {
                    let before = from.row(mirrored(y as isize - tap as isize, height));
                    let after = from.row(mirrored((y + tap) as isize, height));
                    taps.add(*weight, before, after, to);
                }
            }
        },
    )
}

/// Filter rows and columns in place; `other` is memory.
pub(super) fn both(
    plane: &mut Plane,
    taps: &Taps,
    other: &mut Plane,
    execution: &Execution,
) -> Result<()> {
    along_rows(plane, taps, other, execution)?;
    along_columns(other, taps, plane, execution)
}

/// Copy `plane` with `margin` pixels more on each side, mirrored.
pub(super) fn widened(plane: &Plane, margin: usize, to: &mut Plane) -> Result<()> {
    let (width, height) = (plane.width(), plane.height());
    to.resize(width + 2 * margin, height + 2 * margin)?;
    for y in 0..to.height() {
        let from = plane.row(mirrored(y as isize - margin as isize, height));
        let row = to.row_mut(y);
        row[margin..margin + width].copy_from_slice(from);
        for k in 1..=margin {
            row[margin - k] = from[mirrored(-(k as isize), width)];
            row[margin + width + k - 1] = from[mirrored((width + k - 1) as isize, width)];
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The spline of coefficients `c` and its derivative at `x`, by the definition.
    fn spline(c: impl Fn(isize) -> f64, x: f64) -> (f64, f64) {
        let first = x.floor() as isize;
        let mut sums = (0.0, 0.0);
        for k in first - 1..=first + 2 {
            let d: f64 = x - k as f64;
            let a = d.abs();
            let (value, slope) = if a < 1.0 {
                (
                    2.0 / 3.0 - a * a + a * a * a / 2.0,
                    (-2.0 * a + 1.5 * a * a) * d.signum(),
                )
            } else {
                (
                    (2.0 - a).powi(3) / 6.0,
                    -(2.0 - a).powi(2) / 2.0 * d.signum(),
                )
            };
            sums = (sums.0 + value * c(k), sums.1 + slope * c(k));
        }
        sums
    }

    fn noise(width: usize, height: usize) -> Plane {
        let mut plane = Plane::new(width, height).unwrap();
        for (i, value) in plane.data_mut().iter_mut().enumerate() {
            *value = ((i * 7919 + 13) % 251) as f32 - 125.0;
        }
        plane
    }

    #[test]
    fn coefficients_interpolate_and_derivatives_are_theirs() {
        let execution = Execution::default();
        for (width, height) in [(40, 3), (17, 9), (5, 4), (2, 2), (1, 1)] {
            let plane = noise(width, height);
            let (mut c, mut slope) = (Plane::default(), Plane::default());
            along_rows(&plane, &Taps::inverse(), &mut c, &execution).unwrap();
            along_rows(&plane, &Taps::derivative(), &mut slope, &execution).unwrap();
            for y in 0..height {
                let at = |k: isize| f64::from(c.row(y)[mirrored(k, width)]);
                for x in 0..width {
                    let (value, derivative) = spline(at, x as f64);
                    assert!(
                        (value - f64::from(plane.row(y)[x])).abs() < 2e-3,
                        "{width} {x}"
                    );
                    assert!((derivative - f64::from(slope.row(y)[x])).abs() < 2e-3);
                }
            }
        }
    }

    #[test]
    fn columns_are_filtered_as_rows_are() {
        let execution = Execution::default();
        let plane = noise(23, 31);
        let mut turned = Plane::new(31, 23).unwrap();
        for y in 0..31 {
            for x in 0..23 {
                turned.row_mut(x)[y] = plane.row(y)[x];
            }
        }
        for taps in [Taps::inverse(), Taps::derivative(), Taps::smoothing(0.5)] {
            let (mut rows, mut columns) = (Plane::default(), Plane::default());
            along_rows(&turned, &taps, &mut rows, &execution).unwrap();
            along_columns(&plane, &taps, &mut columns, &execution).unwrap();
            for y in 0..31 {
                for x in 0..23 {
                    assert_eq!(columns.row(y)[x].to_bits(), rows.row(x)[y].to_bits());
                }
            }
        }
    }

    #[test]
    fn a_widened_plane_is_mirrored() {
        let plane = noise(4, 3);
        let mut wide = Plane::default();
        widened(&plane, 2, &mut wide).unwrap();
        assert_eq!((wide.width(), wide.height()), (8, 7));
        assert_eq!(wide.row(2)[2..6], *plane.row(0));
        assert_eq!(wide.row(1)[2..6], *plane.row(1));
        assert_eq!(
            (wide.row(2)[1], wide.row(2)[6]),
            (plane.row(0)[1], plane.row(0)[2])
        );
    }
}
