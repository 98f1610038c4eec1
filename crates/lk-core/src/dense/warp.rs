//! Sampling `next` where the flow says that each pixel of a row went.

use crate::frame::Plane;
use crate::simd::{Floats, LANES, LaneKernel, Simd};

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
}

impl LaneKernel for WarpRow<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (width, height) = (self.next.width(), self.next.height());
        let y = s.splat(self.y as f32);
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let (right, bottom) = (s.splat((width - 1) as f32), s.splat((height - 1) as f32));
        let (last_column, last_row) = (s.splat((width - 2) as f32), s.splat((height - 2) as f32));
        let ramp = s.ramp();
        for x in (0..width).step_by(LANES) {
            let at_x = s.splat(x as f32) + ramp + s.load(self.u, PAD + x);
            let at_y = y + s.load(self.v, PAD + x);
            let across = <S::F as Floats>::both(zero.le(at_x), at_x.le(right));
            let down = <S::F as Floats>::both(zero.le(at_y), at_y.le(bottom));
            let inside = S::F::select(<S::F as Floats>::both(across, down), one, zero);
            // In this order a NaN becomes 0.
            let at_x = at_x.max(zero).min(right);
            let at_y = at_y.max(zero).min(bottom);
            let (column, row) = (at_x.trunc().min(last_column), at_y.trunc().min(last_row));
            let (fx, fy) = (at_x - column, at_y - row);
            let (a, b) = s.pairs(self.next.data(), width, row, column);
            let (c, d) = s.pairs(self.next.data(), width, row + one, column);
            // In this form a sample on a pixel is that pixel, to the bit, on the last column and row too.
            let (rest_x, rest_y) = (one - fx, one - fy);
            let upper = a * rest_x + b * fx;
            let lower = c * rest_x + d * fx;
            (upper * rest_y + lower * fy).store(self.warped, PAD + x);
            inside.store(self.inside, PAD + x);
        }
    }
}
