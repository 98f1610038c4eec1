//! Sampling `next` where the flow says that each pixel of a row went.

use crate::frame::Plane;
use crate::simd::{Floats, LANES, LaneKernel, Simd, blocks, blocks_mut};

use super::grid::PAD;

/// `next` at (x + u, y + v) for a row of pixels, bilinear, and whether that lies inside of the picture.
///
/// All rows are padded; the room to the right is written up to a whole number of lanes.
pub(super) struct WarpRow<'a> {
    /// At least 2 x 2 pixels.
    pub(super) next: &'a Plane,
    pub(super) y: usize,
    pub(super) u: &'a [f32],
    pub(super) v: &'a [f32],
    /// The samples; outside of the picture those of its edge.
    pub(super) warped: &'a mut [f32],
    /// 1 inside of the picture, 0 outside.
    pub(super) inside: &'a mut [f32],
    /// Becomes whether all samples of the row are inside.
    pub(super) full: &'a mut bool,
}

impl LaneKernel for WarpRow<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (width, height) = (self.next.width(), self.next.height());
        let data = self.next.data();
        let y = s.splat(self.y as f32);
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let (right, bottom) = (s.splat((width - 1) as f32), s.splat((height - 1) as f32));
        let (last_column, last_row) = (s.splat((width - 2) as f32), s.splat((height - 2) as f32));
        let ramp = s.ramp();
        let count = width.div_ceil(LANES);
        let (u, v) = (blocks(self.u, PAD, count), blocks(self.v, PAD, count));
        let warped = blocks_mut(self.warped, PAD, count);
        let inside = blocks_mut(self.inside, PAD, count);
        let mut least = one;
        for i in 0..count {
            let x = s.splat((i * LANES) as f32) + ramp;
            let at_x = x + s.get(&u[i]);
            let at_y = y + s.get(&v[i]);
            let across = <S::F as Floats>::both(zero.le(at_x), at_x.le(right));
            let down = <S::F as Floats>::both(zero.le(at_y), at_y.le(bottom));
            let within = S::F::select(<S::F as Floats>::both(across, down), one, zero);
            within.put(&mut inside[i]);
            least = least.min(S::F::select(x.le(right), within, one));
            // In this order a NaN becomes 0.
            let at_x = at_x.max(zero).min(right);
            let at_y = at_y.max(zero).min(bottom);
            let (column, row) = (at_x.trunc().min(last_column), at_y.trunc().min(last_row));
            let (fx, fy) = (at_x - column, at_y - row);
            let [(a, b), (c, d)] = corners(s, data, width, (row, column), ramp);
            // In this form a sample on a pixel is that pixel, to the bit, on the last column and row too.
            let (rest_x, rest_y) = (one - fx, one - fy);
            let upper = a * rest_x + b * fx;
            let lower = c * rest_x + d * fx;
            (upper * rest_y + lower * fy).put(&mut warped[i]);
        }
        *self.full = S::F::all(zero.lt(least));
    }
}

/// The pixels at `row` and `column` and right of them, then those below. Where the flow is even, sixteen pixels beside
/// each other come from sixteen beside each other, and no lane must look up its own.
#[inline(always)]
fn corners<S: Simd>(
    s: S,
    data: &[f32],
    width: usize,
    (row, column): (S::F, S::F),
    ramp: S::F,
) -> [(S::F, S::F); 2] {
    let (first_row, first_column) = (row.first(), column.first());
    let (same_row, in_turn) = (s.splat(first_row), s.splat(first_column) + ramp);
    let rows = <S::F as Floats>::both(row.le(same_row), same_row.le(row));
    let columns = <S::F as Floats>::both(column.le(in_turn), in_turn.le(column));
    if S::F::all(<S::F as Floats>::both(rows, columns)) {
        let at = first_row as usize * width + first_column as usize;
        let upper = data.get(at..).and_then(|from| pair(s, from));
        let lower = data.get(at + width..).and_then(|from| pair(s, from));
        if let (Some(upper), Some(lower)) = (upper, lower) {
            return [upper, lower];
        }
    }
    [
        s.pairs(data, width, row, column),
        s.pairs(data, width, row + s.splat(1.0), column),
    ]
}

/// The first sixteen elements, and the sixteen that begin with the second.
#[inline(always)]
fn pair<S: Simd>(s: S, from: &[f32]) -> Option<(S::F, S::F)> {
    let (_, after) = from.split_first()?;
    Some((s.get(from.first_chunk()?), s.get(after.first_chunk()?)))
}
