//! Pixels that count for nothing: masked out, or not finite.

use ndarray::ArrayView2;

use crate::error::Result;
use crate::frame::Plane;
use crate::pyramid::Pyramid;

/// Set `finite` to 1 where `plane` is finite and 0 elsewhere, and give the others the value of a neighbour, so that
/// they cannot spread.
pub(super) fn fill(plane: &mut Plane, finite: &mut Plane) -> Result<()> {
    let (width, height) = (plane.width(), plane.height());
    finite.resize(width, height)?;
    let first = plane
        .data()
        .iter()
        .copied()
        .find(|value| value.is_finite())
        .unwrap_or(0.0);
    for y in 0..height {
        let above = if y > 0 { plane.row(y - 1)[0] } else { first };
        let mut last = above;
        let (row, finite) = (plane.row_mut(y), finite.row_mut(y));
        for (value, finite) in row.iter_mut().zip(finite) {
            if value.is_finite() {
                last = *value;
                *finite = 1.0;
            } else {
                *value = last;
                *finite = 0.0;
            }
        }
    }
    Ok(())
}

/// The weight of every pixel of the frame: 0 where it is masked or not finite.
pub(super) fn given(
    mask: Option<ArrayView2<'_, bool>>,
    finite: Option<&Plane>,
    (width, height): (usize, usize),
    weight: &mut Plane,
) -> Result<()> {
    weight.resize(width, height)?;
    for y in 0..height {
        for (x, weight) in weight.row_mut(y).iter_mut().enumerate() {
            let masked = mask.is_some_and(|mask| !mask[(y, x)]);
            let finite = finite.is_none_or(|finite| finite.row(y)[x] > 0.0);
            *weight = if masked || !finite { 0.0 } else { 1.0 };
        }
    }
    Ok(())
}

/// The weight of every pixel of every level, from that of the finest: 0 where any pixel of the 2 x 2 below it is 0.
pub(super) fn pyramid(finest: &Plane, frame: &Pyramid, levels: &mut Vec<Plane>) -> Result<()> {
    levels.resize_with(frame.levels().len(), Plane::default);
    levels[0].copy_of(finest)?;
    for (level, of_frame) in frame.levels().iter().enumerate().skip(1) {
        let (width, height) = (of_frame.width(), of_frame.height());
        let (finer, coarser) = levels.split_at_mut(level);
        let (finer, target) = (&finer[level - 1], &mut coarser[0]);
        target.resize(width, height)?;
        for y in 0..height {
            let below = (2 * y + 1).min(finer.height() - 1);
            let (a, b) = (finer.row(2 * y), finer.row(below));
            for (x, weight) in target.row_mut(y).iter_mut().enumerate() {
                let right = (2 * x + 1).min(finer.width() - 1);
                *weight = a[2 * x].min(a[right]).min(b[2 * x]).min(b[right]);
            }
        }
    }
    Ok(())
}
