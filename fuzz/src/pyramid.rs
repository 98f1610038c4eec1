//! `Pyramid`, `bilinear` and `Spline`, held to their definitions in f64.

use arbitrary::Arbitrary;
use lk_core::{Plane, Pyramid, Spline, bilinear};
use ndarray::Array2;

use crate::frames::{Frames, Grey};
use crate::{by_depth, others, plain};

/// A frame, and places to look at.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    levels: u8,
    /// In 1/64 px from the corner at (-8, -8).
    places: Vec<(u16, u16)>,
}

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

fn check_as<T: Grey>(case: &Case) {
    let (frame, _) = case.frames.pair::<T>();
    let levels = usize::from(case.levels % 7);
    let pyramid = Pyramid::new(frame.view(), levels, &plain());
    assert_eq!(pyramid.is_ok(), levels > 0);
    let Ok(pyramid) = pyramid else { return };
    for execution in others() {
        let other = Pyramid::new(frame.view(), levels, &execution).unwrap();
        assert!(
            pyramid
                .levels()
                .iter()
                .map(bits)
                .eq(other.levels().iter().map(bits))
        );
    }
    let greys = frame.rows().mapv(|grey| f64::from(grey.to_f32()));
    let largest = greys
        .iter()
        .fold(0.0, |most: f64, grey| most.max(grey.abs()));
    if greys.iter().any(|grey| !grey.is_finite()) || largest > 1e30 {
        return;
    }
    // Each level adds the rounding of its sums.
    let rounding = 1e-6 * largest.max(1.0);
    let mut want = greys.clone();
    for (number, plane) in pyramid.levels().iter().enumerate() {
        assert_eq!((plane.height(), plane.width()), want.dim());
        for ((y, x), value) in want.indexed_iter() {
            let error = (f64::from(plane.row(y)[x]) - value).abs();
            assert!(
                error <= (1.0 + number as f64) * rounding,
                "level {number} at ({x}, {y}): {error}"
            );
        }
        if number + 1 < pyramid.levels().len() {
            want = reduced(&want);
        }
    }
    if greys.is_empty() {
        return;
    }
    let plane = &pyramid.levels()[0];
    let spline = Spline::new(plane).unwrap();
    for (x, y) in &case.places {
        let (x, y) = (
            f32::from(x % 7168) / 64.0 - 8.0,
            f32::from(y % 7168) / 64.0 - 8.0,
        );
        let error = (f64::from(bilinear(plane, x, y).unwrap())
            - between(&greys, f64::from(x), f64::from(y)))
        .abs();
        assert!(error <= 4.0 * rounding, "bilinear at ({x}, {y}): {error}");
        // A spline passes through its pixels.
        let (column, row) = (
            (x.abs() as usize) % plane.width(),
            (y.abs() as usize) % plane.height(),
        );
        let error = f64::from(spline.at(column as f32, row as f32)) - greys[(row, column)];
        assert!(
            error.abs() <= 1e-4 * largest.max(1.0),
            "spline at ({column}, {row}): {error}"
        );
    }
}

/// The 5-tap binomial filter at every second pixel, the border mirrored.
fn reduced(frame: &Array2<f64>) -> Array2<f64> {
    let (height, width) = frame.dim();
    let weights = [1.0, 4.0, 6.0, 4.0, 1.0];
    Array2::from_shape_fn((height.div_ceil(2), width.div_ceil(2)), |(y, x)| {
        let mut sum = 0.0;
        for (j, wy) in (-2..=2).zip(weights) {
            for (i, wx) in (-2..=2).zip(weights) {
                sum += wy
                    * wx
                    * frame[(
                        mirror(2 * y as isize + j, height),
                        mirror(2 * x as isize + i, width),
                    )];
            }
        }
        sum / 256.0
    })
}

fn mirror(index: isize, size: usize) -> usize {
    let last = size as isize - 1;
    let mut index = index;
    while last > 0 && (index < 0 || index > last) {
        index = if index < 0 { -index } else { 2 * last - index };
    }
    if last == 0 { 0 } else { index as usize }
}

/// Linear between four pixels; the nearest counts outside.
fn between(frame: &Array2<f64>, x: f64, y: f64) -> f64 {
    let (height, width) = frame.dim();
    let (x, y) = (
        x.clamp(0.0, (width - 1) as f64),
        y.clamp(0.0, (height - 1) as f64),
    );
    let (left, top) = (x.floor() as usize, y.floor() as usize);
    let (fx, fy) = (x - left as f64, y - top as f64);
    let at = |row: usize, column: usize| frame[(row.min(height - 1), column.min(width - 1))];
    let across = |row: usize| (1.0 - fx) * at(row, left) + fx * at(row, left + 1);
    (1.0 - fy) * across(top) + fy * across(top + 1)
}

/// The bits of every value; of all that is not a number the same, since IEEE 754 leaves its sign open.
fn bits(plane: &Plane) -> Vec<u32> {
    let canonical = |value: &f32| if value.is_nan() { f32::NAN } else { *value };
    plane
        .data()
        .iter()
        .map(|value| canonical(value).to_bits())
        .collect()
}
