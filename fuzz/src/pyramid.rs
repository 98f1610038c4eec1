//! `Pyramid`, held to its definition in f64.

use arbitrary::Arbitrary;
use lk_core::{Plane, Pyramid};
use ndarray::Array2;

use crate::frames::{Frames, Grey};
use crate::{by_depth, others, plain};

/// A frame and how many levels.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    levels: u8,
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

/// The bits of every value; of all that is not a number the same, since IEEE 754 leaves its sign open.
fn bits(plane: &Plane) -> Vec<u32> {
    let canonical = |value: &f32| if value.is_nan() { f32::NAN } else { *value };
    plane
        .data()
        .iter()
        .map(|value| canonical(value).to_bits())
        .collect()
}
