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

/// The pixels at `row` and `column` and right of them, then those below.
///
/// Where the flow is even, the places of sixteen pixels beside each other are beside each other too, or differ from that
/// by one at most: a few groups of pixels beside each other then hold all, and no lane must look up its own.
#[inline(always)]
fn corners<S: Simd>(
    s: S,
    data: &[f32],
    width: usize,
    (row, column): (S::F, S::F),
    ramp: S::F,
) -> [(S::F, S::F); 2] {
    let (zero, one) = (s.splat(0.0), s.splat(1.0));
    let shift = column - ramp;
    let (first_row, first_shift) = (row.first(), shift.first());
    let (down, right) = (row - s.splat(first_row), shift - s.splat(first_shift));
    let even = <S::F as Floats>::both(
        <S::F as Floats>::both(zero.le(down), down.le(zero)),
        <S::F as Floats>::both(zero.le(right), right.le(zero)),
    );
    if S::F::all(even) {
        let at = first_row as usize * width + first_shift as usize;
        if let (Some([a, b]), Some([c, d])) = (
            beside::<S, 2>(s, data, at),
            beside::<S, 2>(s, data, at + width),
        ) {
            return [(a, b), (c, d)];
        }
    } else if S::F::all(<S::F as Floats>::both(s.splat(-1.0).le(down), down.le(one))) && S::F::all(<S::F as Floats>::both(s.splat(-1.0).le(right), right.le(one))) {
        // One step up and left where some lane is behind the first one.
        let up = S::F::any(down.lt(zero));
        let left = S::F::any(right.lt(zero));
        let (up, left) = (f32::from(u8::from(up)), f32::from(u8::from(left)));
        let (down, right) = (down + s.splat(up), right + s.splat(left));
        let near = S::F::all(<S::F as Floats>::both(down.le(one), right.le(one)));
        let (first_row, first_shift) = (first_row - up, first_shift - left);
        if near && first_row >= 0.0 && first_shift >= 0.0 {
            let at = first_row as usize * width + first_shift as usize;
            let (lower, further) = (zero.lt(down), zero.lt(right));
            let upper = beside::<S, 3>(s, data, at);
            let middle = beside::<S, 3>(s, data, at + width);
            // The third row is not there below the last pair of rows, where no lane asks for it.
            let below = beside::<S, 3>(s, data, at + 2 * width);
            if let (Some([a, b, c]), Some([d, e, f]), Some([g, h, k])) = (upper, middle, below) {
                let pick = (lower, further);
                return [
                    (
                        choose::<S>(pick, [a, b, d, e]),
                        choose::<S>(pick, [b, c, e, f]),
                    ),
                    (
                        choose::<S>(pick, [d, e, g, h]),
                        choose::<S>(pick, [e, f, h, k]),
                    ),
                ];
            }
        }
    }
    [
        s.pairs(data, width, row, column),
        s.pairs(data, width, row + one, column),
    ]
}

/// Of four groups, upper left, upper right, lower left and lower right, what each lane asks for.
#[inline(always)]
fn choose<S: Simd>(
    (lower, further): (<S::F as Floats>::Mask, <S::F as Floats>::Mask),
    [a, b, c, d]: [S::F; 4],
) -> S::F {
    S::F::select(
        lower,
        S::F::select(further, d, c),
        S::F::select(further, b, a),
    )
}

/// The sixteen elements from `at` on, the sixteen from `at + 1` on, and so on.
#[inline(always)]
fn beside<S: Simd, const N: usize>(s: S, data: &[f32], at: usize) -> Option<[S::F; N]> {
    let from = data.get(at..at + LANES + N - 1)?;
    let mut groups = [s.splat(0.0); N];
    for (k, group) in groups.iter_mut().enumerate() {
        *group = s.get(from[k..].first_chunk()?);
    }
    Some(groups)
}
