//! Sampling between pixels: bilinear, and cubic B-spline with its gradient.
//!
//! Outside of the picture the nearest pixel counts for bilinear sampling; the spline mirrors the picture at its border
//! pixels, as its prefilter assumes. Unser, "Splines: a perfect fit for signal and image processing", 1999.
//!
//! `docs/algorithms.md`, section "Sampling and gradients".

use crate::error::{Error, Result};
use crate::frame::Plane;
use crate::pyramid::mirror;

/// The grey level at (x, y), linear between the four pixels around it.
///
/// # Errors
///
/// [`Error::Shape`] if the plane is empty.
///
/// ```
/// use lk_core::{Plane, bilinear};
///
/// let mut plane = Plane::new(2, 1)?;
/// plane.data_mut().copy_from_slice(&[10.0, 20.0]);
/// assert_eq!(bilinear(&plane, 0.25, 0.0)?, 12.5);
/// assert_eq!(bilinear(&plane, 9.0, -3.0)?, 20.0);
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn bilinear(plane: &Plane, x: f32, y: f32) -> Result<f32> {
    expect_pixels(plane)?;
    let (last_x, last_y) = (plane.width() - 1, plane.height() - 1);
    let x = x.clamp(0.0, last_x as f32);
    let y = y.clamp(0.0, last_y as f32);
    let (column, row) = (x as usize, y as usize);
    let (fx, fy) = (x - column as f32, y - row as f32);
    let next_column = (column + 1).min(last_x);
    let (above, below) = (plane.row(row), plane.row((row + 1).min(last_y)));
    let top = above[column] + fx * (above[next_column] - above[column]);
    let bottom = below[column] + fx * (below[next_column] - below[column]);
    Ok(top + fy * (bottom - top))
}

/// There is nothing between the pixels of an empty plane.
fn expect_pixels(plane: &Plane) -> Result<()> {
    let (width, height) = (plane.width(), plane.height());
    if width == 0 || height == 0 {
        return Err(Error::shape(
            "plane",
            format!("({height}, {width})"),
            "one pixel or more",
        ));
    }
    Ok(())
}

/// A picture as a cubic B-spline: it passes through every pixel, and its slope and curvature have no jumps.
#[derive(Debug, Clone)]
pub struct Spline {
    coefficients: Plane,
}

impl Spline {
    /// The spline through the pixels of `plane`, mirrored at its border.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if the plane is empty, [`Error::Memory`].
    pub fn new(plane: &Plane) -> Result<Self> {
        expect_pixels(plane)?;
        let mut coefficients = Plane::default();
        coefficients.copy_of(plane)?;
        let (width, height) = (plane.width(), plane.height());
        for y in 0..height {
            prefilter(coefficients.row_mut(y), 1, width);
        }
        for x in 0..width {
            prefilter(&mut coefficients.data_mut()[x..], width, height);
        }
        Ok(Self { coefficients })
    }

    /// The grey level at (x, y).
    #[must_use]
    pub fn at(&self, x: f32, y: f32) -> f32 {
        self.sum(x, y, cubic, cubic)
    }

    /// The derivatives along x and along y at (x, y).
    #[must_use]
    pub fn gradient(&self, x: f32, y: f32) -> [f32; 2] {
        [
            self.sum(x, y, cubic_slope, cubic),
            self.sum(x, y, cubic, cubic_slope),
        ]
    }

    fn sum(
        &self,
        x: f32,
        y: f32,
        weights_x: fn(f32) -> [f32; 4],
        weights_y: fn(f32) -> [f32; 4],
    ) -> f32 {
        let (column, row) = (x.floor(), y.floor());
        let (across, down) = (weights_x(x - column), weights_y(y - row));
        let (width, height) = (self.coefficients.width(), self.coefficients.height());
        let columns: [usize; 4] = std::array::from_fn(|k| {
            mirror((column as isize).saturating_add(k as isize - 1), width)
        });
        let mut total = 0.0;
        for (k, weight) in down.into_iter().enumerate() {
            let values = self.coefficients.row(mirror(
                (row as isize).saturating_add(k as isize - 1),
                height,
            ));
            let line: f32 = columns
                .iter()
                .zip(across)
                .map(|(column, weight)| weight * values[*column])
                .sum();
            total += weight * line;
        }
        total
    }
}

/// The weights of the four coefficients around a position `t` after the second of them.
#[inline(always)]
pub(crate) fn cubic(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        s * s * s / 6.0,
        2.0 / 3.0 - t * t * (1.0 - t / 2.0),
        2.0 / 3.0 - s * s * (1.0 - s / 2.0),
        t * t * t / 6.0,
    ]
}

/// Their derivatives.
fn cubic_slope(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        -s * s / 2.0,
        t * (1.5 * t - 2.0),
        -s * (1.5 * s - 2.0),
        t * t / 2.0,
    ]
}

/// Turn every `stride`-th of `values`, `count` of them, from samples into coefficients: a causal and an anticausal
/// pass with the pole of the cubic spline.
fn prefilter(values: &mut [f32], stride: usize, count: usize) {
    if count < 2 {
        return;
    }
    let pole = 3.0f32.sqrt() - 2.0;
    // The mirrored past, to where the powers of the pole vanish in f32.
    let mut first = 0.0;
    let mut power = 1.0;
    for index in 0..24 {
        first += power * values[mirror(index, count) * stride];
        power *= pole;
    }
    let mut last = first * 6.0;
    values[0] = last;
    for index in 1..count {
        last = 6.0 * values[index * stride] + pole * last;
        values[index * stride] = last;
    }
    let end = (count - 1) * stride;
    last = pole / (pole * pole - 1.0) * (values[end] + pole * values[end - stride]);
    values[end] = last;
    for index in (0..count - 1).rev() {
        last = pole * (last - values[index * stride]);
        values[index * stride] = last;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn plane(width: usize, height: usize, value: impl Fn(f32, f32) -> f32) -> Plane {
        let mut plane = Plane::new(width, height).unwrap();
        for y in 0..height {
            for (x, to) in plane.row_mut(y).iter_mut().enumerate() {
                *to = value(x as f32, y as f32);
            }
        }
        plane
    }

    proptest! {
        #[test]
        fn both_pass_through_the_pixels(width in 1usize..20, height in 1usize..20, seed in 0u32..1000) {
            let source = plane(width, height, |x, y| ((x * 7.3 + y * 3.1 + seed as f32) * 1.7).sin() * 100.0);
            let spline = Spline::new(&source).unwrap();
            for y in 0..height {
                for x in 0..width {
                    let want = source.row(y)[x];
                    prop_assert_eq!(bilinear(&source, x as f32, y as f32).unwrap(), want);
                    prop_assert!((spline.at(x as f32, y as f32) - want).abs() < 1e-3);
                }
            }
        }

        #[test]
        fn the_spline_repeats_at_its_mirrors(x in 0.0f32..7.0, y in 0.0f32..5.0) {
            let spline = Spline::new(&plane(8, 6, |x, y| (x * 1.3).sin() + y * y)).unwrap();
            prop_assert!((spline.at(x, y) - spline.at(-x, y)).abs() < 1e-4);
            prop_assert!((spline.at(x, y) - spline.at(x, 10.0 - y)).abs() < 1e-4);
        }
    }

    #[test]
    fn the_spline_follows_a_smooth_picture_and_its_slope() {
        let wave = |x: f32, y: f32| 50.0 * (0.5 * x).sin() * (0.4 * y).cos();
        let spline = Spline::new(&plane(40, 30, wave)).unwrap();
        for (x, y) in [(10.25, 12.5), (20.5, 7.75), (15.1, 20.9)] {
            assert!((spline.at(x, y) - wave(x, y)).abs() < 0.02);
            let [gx, gy] = spline.gradient(x, y);
            assert!((gx - 25.0 * (0.5 * x).cos() * (0.4 * y).cos()).abs() < 0.05);
            assert!((gy + 20.0 * (0.5 * x).sin() * (0.4 * y).sin()).abs() < 0.05);
        }
    }
}
