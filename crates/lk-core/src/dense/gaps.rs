//! Pixels of a frame that are not there: masked out, or not finite. They take grey levels from around them, so that neither
//! what they held nor an edge of the gap reaches the pixels beside them through smoothing and the pyramid.
//!
//! A gap takes the mean of ever larger squares around it until one holds a pixel (push and pull; Gortler, Grzeszczuk,
//! Szeliski and Cohen 1996).

use ndarray::ArrayView2;

use crate::error::Result;
use crate::frame::Plane;

/// Larger grey levels are no better than infinite ones: a sum of a few is more than a number holds.
pub(super) const LARGEST: f32 = f32::MAX / 8.0;

/// Whether there is a grey level to measure by.
pub(super) fn is_level(value: f32) -> bool {
    // Not if it is NaN.
    value.abs() <= LARGEST
}

/// Leave a gap wherever `mask` is false.
pub(super) fn cut(plane: &mut Plane, mask: ArrayView2<'_, bool>) {
    for (y, counts) in mask.rows().into_iter().enumerate() {
        for (value, counts) in plane.row_mut(y).iter_mut().zip(counts) {
            if !counts {
                *value = f32::NAN;
            }
        }
    }
}

/// Leave a gap wherever grey levels are beyond `low` and `high`.
pub(super) fn cut_beyond(plane: &mut Plane, [low, high]: [f32; 2]) {
    for value in plane.data_mut() {
        if !(low..=high).contains(value) {
            *value = f32::NAN;
        }
    }
}

/// Fill the pixels of `plane` that are no grey levels, and set `counts` to 1 at the others and to 0 at those; to no size where
/// all are levels.
pub(super) fn fill(plane: &mut Plane, counts: &mut Plane) -> Result<()> {
    counts.resize(0, 0)?;
    if !has_gaps(plane) {
        return Ok(());
    }
    counts.resize(plane.width(), plane.height())?;
    for y in 0..plane.height() {
        for (counts, value) in counts.row_mut(y).iter_mut().zip(plane.row(y)) {
            *counts = if is_level(*value) { 1.0 } else { 0.0 };
        }
    }
    let mut halves = vec![halved(plane)?];
    while let Some(last) = halves.last()
        && has_gaps(last)
        && last.width().max(last.height()) > 1
    {
        let coarser = halved(last)?;
        halves.push(coarser);
    }
    // What is left without any pixel: a frame of gaps alone.
    let mut coarser = halves.pop().unwrap_or_default();
    for value in coarser.data_mut() {
        if !is_level(*value) {
            *value = 0.0;
        }
    }
    while let Some(mut finer) = halves.pop() {
        take_from(&mut finer, &coarser);
        coarser = finer;
    }
    take_from(plane, &coarser);
    Ok(())
}

fn has_gaps(plane: &Plane) -> bool {
    (0..plane.height()).any(|y| !plane.row(y).iter().all(|value| is_level(*value)))
}

/// The mean of the levels among each 2 x 2, or a gap.
fn halved(finer: &Plane) -> Result<Plane> {
    let mut half = Plane::new(finer.width().div_ceil(2), finer.height().div_ceil(2))?;
    for y in 0..half.height() {
        let (above, below) = (
            finer.row(2 * y),
            finer.row((2 * y + 1).min(finer.height() - 1)),
        );
        let row = half.row_mut(y);
        let ((above, last), (below, last_below)) = (above.as_chunks::<2>(), below.as_chunks::<2>());
        for ((mean, above), below) in row.iter_mut().zip(above).zip(below) {
            *mean = mean_of([above[0], above[1], below[0], below[1]]);
        }
        if let ([last], [below], Some(mean)) = (last, last_below, row.last_mut()) {
            *mean = mean_of([*last, f32::NAN, *below, f32::NAN]);
        }
    }
    Ok(half)
}

/// The mean of those that are levels; NaN if none is. No sum is more than a number holds.
fn mean_of(four: [f32; 4]) -> f32 {
    let there = four.map(|value| if is_level(value) { 1.0 } else { 0.0 });
    // By nothing it gives NaN: nothing times infinity.
    let share = there.iter().sum::<f32>().recip();
    let mut mean = 0.0;
    for (value, there) in four.into_iter().zip(there) {
        mean += if there > 0.0 { value } else { 0.0 } * share;
    }
    mean
}

/// Interpolate the gaps of `finer` from `coarser`, which has none.
fn take_from(finer: &mut Plane, coarser: &Plane) {
    let near = |at: usize, size: usize| {
        let here = at / 2;
        let beside = if at.is_multiple_of(2) {
            here.saturating_sub(1)
        } else {
            (here + 1).min(size - 1)
        };
        (here, beside)
    };
    for y in 0..finer.height() {
        let (here, beside) = near(y, coarser.height());
        let (here, beside) = (coarser.row(here), coarser.row(beside));
        for (x, value) in finer.row_mut(y).iter_mut().enumerate() {
            if is_level(*value) {
                continue;
            }
            let (column, next) = near(x, here.len());
            *value = 0.75 * (0.75 * here[column] + 0.25 * here[next])
                + 0.25 * (0.75 * beside[column] + 0.25 * beside[next]);
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn gaps_lie_between_what_is_around_them_and_the_rest_stays(
            width in 1usize..40, height in 1usize..30, seed in any::<u32>(), share in 0u32..256
        ) {
            let value = |x: usize, y: usize| {
                ((y * width + x) as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) >> 8
            };
            let mask = Array2::from_shape_fn((height, width), |(y, x)| value(x, y) % 256 >= share);
            let mut plane = Plane::new(width, height).unwrap();
            for y in 0..height {
                for x in 0..width {
                    plane.row_mut(y)[x] = (value(x, y) / 256 % 200) as f32;
                }
            }
            let before = plane.clone();
            let mut counts = Plane::default();
            cut(&mut plane, mask.view());
            fill(&mut plane, &mut counts).unwrap();
            if mask.iter().all(|counts| *counts) {
                prop_assert_eq!(counts.width(), 0);
                prop_assert_eq!(&plane, &before);
                return Ok(());
            }
            let known = || mask.indexed_iter().filter(|(_, counts)| **counts)
                .map(|((y, x), _)| before.row(y)[x]);
            let (low, high) = (known().fold(f32::MAX, f32::min), known().fold(f32::MIN, f32::max));
            for ((y, x), there) in mask.indexed_iter() {
                let value = plane.row(y)[x];
                prop_assert_eq!(counts.row(y)[x] > 0.0, *there);
                if *there {
                    prop_assert_eq!(value, before.row(y)[x]);
                } else if known().next().is_none() {
                    prop_assert_eq!(value, 0.0);
                } else {
                    prop_assert!((low - 0.01..=high + 0.01).contains(&value), "{}", value);
                }
            }
        }
    }

    #[test]
    fn a_gap_in_a_slope_follows_it() {
        let mut plane = Plane::new(64, 48).unwrap();
        for y in 0..48 {
            for x in 0..64 {
                plane.row_mut(y)[x] = 2.0 * x as f32 + y as f32;
            }
        }
        let before = plane.clone();
        for y in 20..26 {
            plane.row_mut(y)[30..40].fill(f32::NAN);
        }
        fill(&mut plane, &mut Plane::default()).unwrap();
        for y in 20..26 {
            for x in 30..40 {
                assert!((plane.row(y)[x] - before.row(y)[x]).abs() < 8.0);
            }
        }
    }
}
