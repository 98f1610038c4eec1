//! The pixels under a window: the plane's own, or a mirrored copy where the window reaches over the border.

use super::MAX_SIDE;
use crate::frame::Plane;
use crate::pyramid::mirror;
use crate::simd::EIGHT;

/// Taps of the cubic B-spline, and the pixels that it reaches before a position.
pub(super) const SPLINE_TAPS: usize = 4;
pub(super) const SPLINE_BEFORE: isize = 1;

/// A template has one more sample on each side, for its gradient.
pub(super) const MAX_SAMPLED: usize = (MAX_SIDE + 2).next_multiple_of(EIGHT);
pub(super) const MAX_REGION: usize = MAX_SAMPLED + SPLINE_TAPS;

/// The most pixels of a row that are taken at once.
pub(super) const LEAST_STRIDE: usize = EIGHT + SPLINE_TAPS;

/// A row more than a region has: the last one too is followed by so much memory.
const SCRATCH: usize = (MAX_REGION + 1) * MAX_REGION;

/// Memory for windows that reach over the border.
#[derive(Debug)]
pub(crate) struct BorderScratch([f32; SCRATCH]);

impl BorderScratch {
    pub(crate) fn new() -> Self {
        Self([0.0; SCRATCH])
    }
}

/// Pixels of a plane from a first one on, in rows `stride` apart. A stride's worth of memory follows the start of every
/// row and of every block of lanes in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Region<'a> {
    pub(super) data: &'a [f32],
    pub(super) stride: usize,
}

/// The same columns of one row after the other.
#[derive(Debug)]
pub(super) struct Rows<'a, const N: usize> {
    data: &'a [f32],
    stride: usize,
}

impl<'a, const N: usize> Rows<'a, N> {
    /// Those of the next row.
    #[inline(always)]
    pub(super) fn below(&mut self) -> &'a [f32; N] {
        let (row, rest) = self.data.split_at(self.stride);
        self.data = rest;
        match row.first_chunk() {
            Some(row) => row,
            // A row is at least so long, see `Region::rows`.
            None => &[0.0; N],
        }
    }
}

impl<'a> Region<'a> {
    /// `N` pixels of each row from `column` on, from the top row down.
    #[inline(always)]
    pub(super) fn rows<const N: usize>(&self, column: usize) -> Rows<'a, N> {
        assert!(N <= self.stride);
        Rows {
            data: &self.data[column..],
            stride: self.stride,
        }
    }

    /// One pixel.
    #[inline(always)]
    pub(super) fn at(&self, row: usize, column: usize) -> f32 {
        self.data[row * self.stride + column]
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
    let wide = width >= LEAST_STRIDE;
    if wide && x >= 0 && y >= 0 && x as usize + columns <= width && y as usize + rows <= height {
        let start = y as usize * width + x as usize;
        let data = &plane.data()[start..];
        // What is loaded beyond a row's end is the next row's start, and has no weight.
        if rows * width + columns <= data.len() {
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
    // Columns that the plane has, from the first to the last but one; the others are mirrored.
    let first = (-x).clamp(0, columns as isize) as usize;
    let end = (width as isize - x).clamp(first as isize, columns as isize) as usize;
    let mut source = [0usize; MAX_REGION];
    for column in (0..first).chain(end..columns) {
        source[column] = mirror(x + column as isize, width);
    }
    let own = if first < end {
        let start = (x + first as isize) as usize;
        start..start + end - first
    } else {
        0..0
    };
    let [left, right] = [&source[..first], &source[end..columns]];
    for (row, to) in scratch
        .0
        .chunks_exact_mut(MAX_REGION)
        .take(rows)
        .enumerate()
    {
        let y = y + row as isize;
        let within = y >= 0 && y < height as isize;
        let from = plane.row(if within {
            y as usize
        } else {
            mirror(y, height)
        });
        to[first..end].copy_from_slice(&from[own.clone()]);
        for (to, column) in to.iter_mut().zip(left) {
            *to = from[*column];
        }
        for (to, column) in to[end..].iter_mut().zip(right) {
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
