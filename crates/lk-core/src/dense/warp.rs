//! Sampling `next` where the flow says that each pixel of a row went.

use crate::frame::Plane;
use crate::simd::{Floats, Kernel, LANES, Simd, blocks, blocks_mut};

use super::padded_plane::PAD;

/// `next` at (x + u, y + v) for a row of pixels, bilinear, beside `prev`, and whether that lies inside of the picture.
///
/// All rows are padded; the room to the right is written up to a whole number of lanes.
pub(super) struct WarpRow<'a> {
    /// The first column of all rows here.
    pub(super) from: usize,
    /// The row itself.
    pub(super) prev: &'a [f32],
    /// At least 2 x 2 pixels.
    pub(super) next: &'a Plane,
    pub(super) y: usize,
    pub(super) u: &'a [f32],
    pub(super) v: &'a [f32],
    /// Sample plus `prev`; outside of the picture the sample is that of its edge.
    pub(super) sum: &'a mut [f32],
    /// Sample minus `prev`.
    pub(super) difference: &'a mut [f32],
    /// 1 inside of the picture, 0 outside.
    pub(super) inside: &'a mut [f32],
    /// Becomes whether all samples of the row are inside.
    pub(super) full: &'a mut bool,
}

impl Kernel for WarpRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (width, height) = (self.next.width(), self.next.height());
        let data = self.next.data();
        let y = s.splat(self.y as f32);
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        let (right, bottom) = (s.splat((width - 1) as f32), s.splat((height - 1) as f32));
        let (last_column, last_row) = (s.splat((width - 2) as f32), s.splat((height - 2) as f32));
        let ramp = s.ramp();
        let count = self.prev.len().div_ceil(LANES);
        let (u, v) = (blocks(self.u, PAD, count), blocks(self.v, PAD, count));
        let (prev, rest) = self.prev.as_chunks::<LANES>();
        let mut tail = [0.0; LANES];
        tail[..rest.len()].copy_from_slice(rest);
        let sum = blocks_mut(self.sum, PAD, count);
        let difference = blocks_mut(self.difference, PAD, count);
        let inside = blocks_mut(self.inside, PAD, count);
        let mut least = one;
        for i in 0..count {
            let x = s.splat((self.from + i * LANES) as f32) + ramp;
            let at_x = x + s.get(&u[i]);
            let at_y = y + s.get(&v[i]);
            let here = s.get(prev.get(i).unwrap_or(&tail));
            let frame = (data, width, height);
            let sample = if let Some(sample) = even(s, frame, (at_x, at_y), ramp) {
                one.put(&mut inside[i]);
                sample
            } else if let Some(sample) = close(s, frame, (at_x, at_y)) {
                one.put(&mut inside[i]);
                sample
            } else {
                let across = <S::F as Floats>::both(zero.le(at_x), at_x.le(right));
                let down = <S::F as Floats>::both(zero.le(at_y), at_y.le(bottom));
                let within = S::F::select(<S::F as Floats>::both(across, down), one, zero);
                within.put(&mut inside[i]);
                least = least.min(S::F::select(x.le(right), within, one));
                // In this order a NaN becomes 0.
                let at_x = at_x.max(zero).min(right);
                let at_y = at_y.max(zero).min(bottom);
                let (column, row) = (at_x.trunc().min(last_column), at_y.trunc().min(last_row));
                let corners = [
                    s.pairs(data, width, row, column),
                    s.pairs(data, width, row + one, column),
                ];
                bilinear(s, corners, (at_x - column, at_y - row))
            };
            (sample + here).put(&mut sum[i]);
            (sample - here).put(&mut difference[i]);
        }
        *self.full = S::F::all(zero.lt(least));
    }
}

/// Adds to bilinear samples what they lack of cubic ones in phase: samples at a fraction f of a pixel are off by
/// f (1 - f) (1 - 2 f) / 6 of the third derivative, which moves texture of a few pixels by up to a sixtieth of one. Where the flow
/// is nearly right the third derivative is that of `prev`, whose pixels need not be looked up. What samples lack of contrast
/// moves nothing and stays.
pub(super) struct Rephase<'a> {
    /// Rows y - 2 to y + 2 of `prev`, whole; fewer and the row alone beside the border.
    pub(super) rows: [&'a [f32]; 5],
    /// The first column of the rows below.
    pub(super) from: usize,
    pub(super) flow: [&'a [f32]; 2],
    /// Sample plus `prev`, and sample minus `prev`.
    pub(super) sum: &'a mut [f32],
    pub(super) difference: &'a mut [f32],
}

impl Kernel for Rephase<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [above_2, above, row, below, below_2] = self.rows;
        let [u, v] = self.flow;
        let columns = self.from..self.from + self.sum.len();
        let outer = above_2[columns.clone()]
            .iter()
            .zip(&below_2[columns.clone()]);
        let inner = above[columns.clone()].iter().zip(&below[columns.clone()]);
        let to = self.sum.iter_mut().zip(self.difference.iter_mut());
        for (((sum, difference), v), (outer, inner)) in to.zip(v).zip(outer.zip(inner)) {
            let third = (outer.1 - outer.0) - 2.0 * (inner.1 - inner.0);
            let change = lost(*v) * third;
            *sum -= change;
            *difference -= change;
        }
        // Two columns at either end of the row have no neighbours.
        let first = self.from.max(2);
        let last = columns.end.min(row.len().saturating_sub(2));
        if first >= last {
            return;
        }
        let own = first - self.from..last - self.from;
        let outer = row[first - 2..last - 2]
            .iter()
            .zip(&row[first + 2..last + 2]);
        let inner = row[first - 1..last - 1]
            .iter()
            .zip(&row[first + 1..last + 1]);
        let to = self.sum[own.clone()].iter_mut();
        let to = to.zip(self.difference[own.clone()].iter_mut());
        for (((sum, difference), u), (outer, inner)) in to.zip(&u[own]).zip(outer.zip(inner)) {
            let third = (outer.1 - outer.0) - 2.0 * (inner.1 - inner.0);
            let change = lost(*u) * third;
            *sum -= change;
            *difference -= change;
        }
    }
}

/// What a sample this far from the pixels lacks, over twice the third derivative. The same whether the fraction is that from the
/// pixel before, or, negative, from the one after.
#[inline(always)]
fn lost(flow: f32) -> f32 {
    let part = flow - flow as i32 as f32;
    part * (1.0 - part.abs()) * (1.0 - 2.0 * part.abs()) / 12.0
}

/// In this form a sample on a pixel is that pixel, to the bit, on the last column and row too.
#[inline(always)]
fn bilinear<S: Simd>(s: S, [(a, b), (c, d)]: [(S::F, S::F); 2], (fx, fy): (S::F, S::F)) -> S::F {
    let (rest_x, rest_y) = (s.splat(1.0) - fx, s.splat(1.0) - fy);
    let upper = a * rest_x + b * fx;
    let lower = c * rest_x + d * fx;
    upper * rest_y + lower * fy
}

/// The samples, if the places of all lanes are as far from their own pixels in whole pixels, and inside of the picture:
/// sixteen pixels beside each other then come from sixteen beside each other.
#[inline(always)]
fn even<S: Simd>(
    s: S,
    (data, width, height): (&[f32], usize, usize),
    (at_x, at_y): (S::F, S::F),
    ramp: S::F,
) -> Option<S::F> {
    let zero = s.splat(0.0);
    let (column, row) = (at_x.trunc(), at_y.trunc());
    let (first_column, first_row) = (column.first(), row.first());
    let shift = column - ramp - s.splat(first_column);
    let rows = row - s.splat(first_row);
    let within = <S::F as Floats>::both(zero.le(at_x), zero.le(at_y));
    let columns = <S::F as Floats>::both(zero.le(shift), shift.le(zero));
    let rows = <S::F as Floats>::both(zero.le(rows), rows.le(zero));
    if !S::F::all(<S::F as Floats>::both(
        within,
        <S::F as Floats>::both(columns, rows),
    )) {
        return None;
    }
    let (first_column, first_row) = (first_column as usize, first_row as usize);
    if first_column + LANES >= width || first_row + 1 >= height {
        return None;
    }
    let at = first_row * width + first_column;
    let [a, b] = beside::<S, 2>(s, data, at)?;
    let [c, d] = beside::<S, 2>(s, data, at + width)?;
    Some(bilinear(s, [(a, b), (c, d)], (at_x - column, at_y - row)))
}

/// How far left of the place of the first lane the pixels begin that are looked at for sixteen lanes.
const MARGIN: f32 = 7.0;

/// The samples, if the places of all lanes are inside of the picture, in a row or two that touch, and not far from beside
/// each other: a few groups of pixels then hold all of them, and no lane must look up its own in memory.
#[inline(always)]
fn close<S: Simd>(
    s: S,
    (data, width, height): (&[f32], usize, usize),
    (at_x, at_y): (S::F, S::F),
) -> Option<S::F> {
    let (zero, one) = (s.splat(0.0), s.splat(1.0));
    let (column, row) = (at_x.trunc(), at_y.trunc());
    let first_row = row.first();
    let most = width.checked_sub(2 * LANES)? as f32;
    let base = (column.first() - MARGIN).max(0.0).min(most);
    let (index, down) = (column - s.splat(base), row - s.splat(first_row));
    let within = <S::F as Floats>::both(zero.le(at_x), zero.le(at_y));
    let near = <S::F as Floats>::both(zero.le(index), index.le(s.splat((2 * LANES - 2) as f32)));
    if !S::F::all(<S::F as Floats>::both(within, near)) {
        return None;
    }
    let parts = (at_x - column, at_y - row);
    let above = S::F::any(down.lt(zero));
    let below = S::F::any(zero.lt(down));
    if above && below {
        return None;
    }
    let row = (first_row - f32::from(u8::from(above))) as usize;
    let at = row * width + base as usize;
    let next = index + one;
    let (low, high) = two(s, data, at)?;
    let upper = (s.lookup(low, high, index), s.lookup(low, high, next));
    if row + 1 >= height {
        return None;
    }
    let (low, high) = two(s, data, at + width)?;
    let lower = (s.lookup(low, high, index), s.lookup(low, high, next));
    if !above && !below {
        return Some(bilinear(s, [upper, lower], parts));
    }
    if row + 2 >= height || !S::F::all(<S::F as Floats>::both(s.splat(-1.0).le(down), down.le(one)))
    {
        return None;
    }
    let (low, high) = two(s, data, at + 2 * width)?;
    let third = (s.lookup(low, high, index), s.lookup(low, high, next));
    let sinks = if above {
        // The first lane is in the lower row of the two.
        s.splat(-0.5).lt(down)
    } else {
        zero.lt(down)
    };
    let corners = [
        (
            S::F::select(sinks, lower.0, upper.0),
            S::F::select(sinks, lower.1, upper.1),
        ),
        (
            S::F::select(sinks, third.0, lower.0),
            S::F::select(sinks, third.1, lower.1),
        ),
    ];
    Some(bilinear(s, corners, parts))
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

/// The sixteen elements from `at` on, and the sixteen after them.
#[inline(always)]
fn two<S: Simd>(s: S, data: &[f32], at: usize) -> Option<(S::F, S::F)> {
    let from = data.get(at..at + 2 * LANES)?;
    Some((s.get(from.first_chunk()?), s.get(from.last_chunk()?)))
}
