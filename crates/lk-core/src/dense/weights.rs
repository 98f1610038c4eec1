//! Pixels that count for nothing: masked out, not finite, or led to such ones of the other frame or to clipped ones.

use ndarray::ArrayView2;

use crate::error::Result;
use crate::frame::Plane;
use crate::memory::resize;
use crate::pyramid::Pyramid;

use super::levels::CoarseToFine;
use super::padded_plane::PaddedPlane;
use super::workspace::Workspace;

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

impl CoarseToFine<'_> {
    /// Let the pixels count for nothing that the flow of level `from` leads to what is masked in `next`, or beside it.
    pub(super) fn drop_masked(&mut self, mask: ArrayView2<'_, bool>, from: usize) -> Result<()> {
        let Workspace {
            flow: [u, v],
            weights,
            unclipped,
            near,
            ..
        } = &mut *self.memory;
        let plane = &self.prev.levels()[0];
        let width = plane.width();
        near.clear();
        resize("masked pixels", near, width * plane.height(), 0)?;
        for (y, row) in near.chunks_exact_mut(width).enumerate() {
            for (x, near) in row.iter_mut().enumerate() {
                *near = u8::from(!mask[(y, x)]);
            }
        }
        widen(near, width);
        if self.weighted {
            unclipped.copy_of(&weights[0])?;
        } else {
            unclipped.resize(width, plane.height())?;
            unclipped.data_mut().fill(1.0);
        }
        drop_leading(unclipped, near, [u, v], from);
        self.weighted = true;
        pyramid(unclipped, self.prev, weights)
    }
}

/// Pixels that weigh nothing.
pub(super) fn zeros(weights: &Plane) -> usize {
    let nothing = |weight: &f32| u32::from(*weight == 0.0);
    let of_row = |y| weights.row(y).iter().map(nothing).sum::<u32>() as usize;
    (0..weights.height()).map(of_row).sum()
}

/// Pixels of `next` at its limits.
pub(super) fn at_limits(next: &Plane, [low, high]: [f32; 2]) -> usize {
    let beyond = |value: &f32| u32::from(*value <= low) | u32::from(*value >= high);
    let of_row = |y| next.row(y).iter().map(beyond).sum::<u32>() as usize;
    (0..next.height()).map(of_row).sum()
}

/// Write which pixels of `next` are at its limits, or beside one that is: smoothing has spread what was clipped by a pixel.
pub(super) fn near_limits(next: &Plane, [low, high]: [f32; 2], near: &mut Vec<u8>) -> Result<()> {
    let width = next.width();
    near.clear();
    resize("pixels at the limits", near, width * next.height(), 0)?;
    for y in 0..next.height() {
        let row = &mut near[y * width..][..width];
        for (near, value) in row.iter_mut().zip(next.row(y)) {
            *near = u8::from(*value <= low) | u8::from(*value >= high);
        }
    }
    widen(near, width);
    Ok(())
}

/// Write which pixels lie within a square of `radius` around one that does not count.
pub(super) fn near_uncounted(counts: &Plane, radius: usize, near: &mut Vec<u8>) -> Result<()> {
    let width = counts.width();
    near.clear();
    resize("pixels that do not count", near, width * counts.height(), 0)?;
    for y in 0..counts.height() {
        let row = &mut near[y * width..][..width];
        for (near, counts) in row.iter_mut().zip(counts.row(y)) {
            *near = u8::from(*counts == 0.0);
        }
    }
    for _ in 0..radius {
        widen(near, width);
        for near in near.iter_mut() {
            *near = u8::from(*near != 0);
        }
    }
    Ok(())
}

/// Mark what lies beside a marked pixel, in rows of `width`.
fn widen(near: &mut [u8], width: usize) {
    for row in near.chunks_exact_mut(width) {
        let mut before = 0;
        for x in 0..width {
            let here = row[x];
            row[x] |= before | row.get(x + 1).unwrap_or(&0);
            before = here;
        }
    }
    // Each row takes what the one above was, and the one below is.
    for y in 1..near.len() / width {
        let (above, here) = near[(y - 1) * width..][..2 * width].split_at_mut(width);
        for (above, here) in above.iter_mut().zip(here) {
            let own = *above & 1;
            *above |= *here & 1;
            *here |= own << 1;
        }
    }
}

/// Set the weight of pixels to 0 that the flow of level `from` leads to what is `near` limits of `next` or masked there: where
/// the light is not found that bright or dark, it still says nothing.
pub(super) fn drop_leading(
    unclipped: &mut Plane,
    near: &[u8],
    [u, v]: [&PaddedPlane; 2],
    from: usize,
) {
    let (width, height) = (unclipped.width(), unclipped.height());
    let (scale, step) = ((1usize << from) as f32, 1usize << from);
    for y in 0..height {
        let coarse = (y >> from).min(u.height() - 1);
        let (row_u, row_v) = (u.row(coarse), v.row(coarse));
        let weights = unclipped.row_mut(y);
        for (cell, (du, dv)) in row_u.iter().zip(row_v).enumerate() {
            let [du, dv] = [du, dv].map(|value| (value * scale).round() as isize);
            let Some(row) = y.checked_add_signed(dv).filter(|row| *row < height) else {
                continue;
            };
            let columns = (cell * step).min(width)..((cell + 1) * step).min(width);
            // Those that stay within the row.
            let first = columns.start.max(0usize.saturating_add_signed(-du));
            let last = columns.end.min(width.saturating_add_signed(-du));
            let Some(to) = first.checked_add_signed(du).filter(|_| first < last) else {
                continue;
            };
            let near = &near[row * width + to..];
            for (weight, near) in weights[first..last].iter_mut().zip(near) {
                if *near != 0 {
                    *weight = 0.0;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::padded_plane::{PAD, extend};
    use super::*;

    proptest! {
        #[test]
        fn what_leads_to_clipped_pixels_or_beside_them_weighs_nothing(
            width in 1usize..40, height in 1usize..20, seed in any::<u32>(), from in 0usize..3
        ) {
            let value = |k: usize| (k as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) >> 16;
            let mut next = Plane::new(width, height).unwrap();
            for y in 0..height {
                for x in 0..width {
                    next.row_mut(y)[x] = (value(y * width + x) % 30) as f32;
                }
            }
            let size = (width.div_ceil(1 << from), height.div_ceil(1 << from));
            let flow = [1, 2].map(|axis| {
                let mut grid = PaddedPlane::default();
                grid.resize(size.0, size.1).unwrap();
                for y in 0..size.1 {
                    let row = grid.padded_mut(y);
                    for x in 0..size.0 {
                        row[PAD + x] = (value(axis * 977 + y * size.0 + x) % 9) as f32 - 4.0;
                    }
                    extend(row, size.0);
                }
                grid
            });
            let [low, high] = [0.5, 28.5];
            let mut near = Vec::new();
            near_limits(&next, [low, high], &mut near).unwrap();
            let mut weights = Plane::new(width, height).unwrap();
            weights.data_mut().fill(1.0);
            drop_leading(&mut weights, &near, flow.each_ref(), from);
            for y in 0..height {
                for x in 0..width {
                    let [dx, dy] = flow.each_ref().map(|grid| {
                        (grid.row(y >> from)[x >> from] * (1 << from) as f32).round() as isize
                    });
                    let (to_x, to_y) = (x as isize + dx, y as isize + dy);
                    let inside = |x: isize, y: isize| {
                        (0..width as isize).contains(&x) && (0..height as isize).contains(&y)
                    };
                    let clipped = inside(to_x, to_y) && (-1..=1).any(|dy| (-1..=1).any(|dx| {
                        let (x, y) = (to_x + dx, to_y + dy);
                        inside(x, y) && {
                            let value = next.row(y as usize)[x as usize];
                            value <= low || value >= high
                        }
                    }));
                    prop_assert_eq!(weights.row(y)[x] == 0.0, clipped, "{} {}", x, y);
                }
            }
            let clipped = next.data().iter().filter(|value| **value <= low || **value >= high).count();
            prop_assert_eq!(at_limits(&next, [low, high]), clipped);
        }
    }
}
