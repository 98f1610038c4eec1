//! The pixels under a window: the plane's own, or a mirrored copy where the window reaches over the border.

use super::MAX_SIDE;
use super::sampling::SPLINE_TAPS;
use crate::frame::Plane;
use crate::pyramid::mirror;
use crate::simd::EIGHT;

/// A template has one more sample on each side, for its gradient.
pub(super) const MAX_SAMPLED: usize = (MAX_SIDE + 2).next_multiple_of(EIGHT);
const MAX_REGION: usize = MAX_SAMPLED + SPLINE_TAPS;

/// Memory for windows that reach over the border.
#[derive(Debug)]
pub(crate) struct BorderScratch([f32; MAX_REGION * MAX_REGION]);

impl BorderScratch {
    pub(crate) fn new() -> Self {
        Self([0.0; MAX_REGION * MAX_REGION])
    }
}

/// Pixels of a plane from a first one on, in rows `stride` apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct Region<'a> {
    pub(super) data: &'a [f32],
    pub(super) stride: usize,
}

impl Region<'_> {
    /// `N` pixels of `row` from `column` on.
    #[inline(always)]
    pub(super) fn reach<const N: usize>(&self, row: usize, column: usize) -> &[f32; N] {
        let start = row * self.stride + column;
        match self.data[start..start + N].first_chunk() {
            Some(reach) => reach,
            // The slice above has this very length.
            None => &[0.0; N],
        }
    }
}

/// The `columns` by `rows` pixels of `plane` from (x, y) on, and memory to load whole lanes from after them: the
/// plane's own where it has them all, a mirrored copy where it has not.
#[inline(always)]
pub(super) fn region<'a>(
    plane: &'a Plane,
    (x, y): (isize, isize),
    columns: usize,
    rows: usize,
    scratch: &'a mut BorderScratch,
) -> Region<'a> {
    let (width, height) = (plane.width(), plane.height());
    if x >= 0 && y >= 0 && x as usize + columns <= width && y as usize + rows <= height {
        let start = y as usize * width + x as usize;
        let data = &plane.data()[start..];
        // What is loaded beyond a row's end is the next row's start, and has no weight.
        if (rows - 1) * width + columns + EIGHT <= data.len() {
            return Region {
                data,
                stride: width,
            };
        }
    }
    mirrored(plane, (x, y), columns, rows, scratch)
}

/// [`region`] where the plane has not all of it.
#[cold]
#[inline(never)]
fn mirrored<'a>(
    plane: &Plane,
    (x, y): (isize, isize),
    columns: usize,
    rows: usize,
    scratch: &'a mut BorderScratch,
) -> Region<'a> {
    let (width, height) = (plane.width(), plane.height());
    let mut source = [0usize; MAX_REGION];
    for (column, from) in source[..columns].iter_mut().enumerate() {
        *from = mirror(x + column as isize, width);
    }
    for row in 0..rows {
        let from = plane.row(mirror(y + row as isize, height));
        let to = &mut scratch.0[row * MAX_REGION..row * MAX_REGION + columns];
        for (to, column) in to.iter_mut().zip(&source) {
            *to = from[*column];
        }
    }
    Region {
        data: &scratch.0,
        stride: MAX_REGION,
    }
}

/// The whole and the fractional part of a coordinate.
#[inline(always)]
pub(super) fn split(coordinate: f32) -> (isize, f32) {
    let floor = coordinate.floor();
    (floor as isize, coordinate - floor)
}
