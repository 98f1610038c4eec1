//! From sums down the columns to the moments of whole windows.
#![allow(clippy::needless_range_loop, reason = "several arrays run along")]

use crate::simd::{Floats, Kernel, LANES, Simd, blocks, blocks_mut};

use super::padded_plane::PAD;
use super::sum_down::{SUMS, Split};
use super::tiles::Columns;

/// A row of sums, with those down the columns.
pub(super) struct Sums<'a> {
    pub(super) split: Split,
    /// Elements of each half row before the first that is wanted, and groups of lanes from there on.
    pub(super) skipped: usize,
    pub(super) count: usize,
    pub(super) centre: f32,
    /// Split rows.
    pub(super) number: &'a [f32],
    pub(super) inverse: &'a [f32],
    pub(super) sums: &'a [f32],
}

impl Sums<'_> {
    /// Those of the columns that are wanted alone.
    pub(super) fn of(self, columns: Columns) -> Self {
        Self {
            skipped: columns.skipped(),
            count: columns.groups(),
            ..self
        }
    }
}

/// What one quantity's sums across are made of: groups of lanes that begin a little to the left or right.
type Parts<'a> = [&'a [[f32; LANES]]; 5];

/// The parts of the `q`-th quantity.
#[inline(always)]
fn parts<'a, const N: usize>(sums: &Sums<'a>, q: usize) -> Parts<'a> {
    let (half, first) = (sums.split.half, PAD + sums.skipped);
    let at = |part: usize, offset: isize| {
        let at = ((3 * q + part) * half + first).wrapping_add_signed(offset);
        blocks(sums.sums, at, sums.count)
    };
    let (even, odd, pair) = (0, 1, 2);
    match N {
        7 => [
            at(pair, -1),
            at(pair, 0),
            at(pair, 1),
            at(odd, -2),
            at(even, 2),
        ],
        5 => [
            at(odd, -1),
            at(pair, 0),
            at(even, 1),
            at(even, -1),
            at(odd, 1),
        ],
        _ => [
            at(pair, 0),
            at(pair, 0),
            at(pair, 0),
            at(odd, -1),
            at(even, 1),
        ],
    }
}

/// The sums over the windows of sixteen even pixels and of the sixteen odd ones right of them.
#[inline(always)]
fn across<S: Simd, const N: usize>(s: S, parts: &Parts<'_>, i: usize) -> [S::F; 2] {
    let [a, b, c, left, right] = parts;
    let shared = if N == 3 {
        s.get(&b[i])
    } else {
        (s.get(&a[i]) + s.get(&b[i])) + s.get(&c[i])
    };
    [shared + s.get(&left[i]), shared + s.get(&right[i])]
}

/// The number of pixels that count in each window.
pub(super) struct Count<'a, const N: usize> {
    /// All of its columns.
    pub(super) sums: Sums<'a>,
    pub(super) number: [&'a mut [f32]; 2],
}

impl<const N: usize> Kernel for Count<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.sums.count;
        let parts = parts::<N>(&self.sums, SUMS - 1);
        let [even, odd] = self.number.map(|row| blocks_mut(row, PAD, count));
        for i in 0..count {
            let [e, o] = across::<S, N>(s, &parts, i);
            e.put(&mut even[i]);
            o.put(&mut odd[i]);
        }
    }
}

/// Means over windows: pixels that count, then gx gx, gx gy, gy gy, gx d, gy d, d d, without the product of the means
/// where windows are centred.
pub(super) type Moments<F> = [F; 7];

/// A row of windows, to read in groups of lanes.
pub(super) struct Reader<'a, S: Simd, const N: usize> {
    s: S,
    centre: S::F,
    parts: [Parts<'a>; SUMS - 1],
    number: [&'a [[f32; LANES]]; 2],
    inverse: [&'a [[f32; LANES]]; 2],
}

impl<'a, S: Simd, const N: usize> Reader<'a, S, N> {
    #[inline(always)]
    pub(super) fn new(s: S, row: &Sums<'a>) -> Self {
        let first = PAD + row.skipped;
        let halves = |half: &'a [f32]| {
            [
                blocks(half, first, row.count),
                blocks(half, row.split.half + first, row.count),
            ]
        };
        Self {
            s,
            centre: s.splat(row.centre),
            parts: [
                parts::<N>(row, 0),
                parts::<N>(row, 1),
                parts::<N>(row, 2),
                parts::<N>(row, 3),
                parts::<N>(row, 4),
                parts::<N>(row, 5),
                parts::<N>(row, 6),
                parts::<N>(row, 7),
                parts::<N>(row, 8),
            ],
            number: halves(row.number),
            inverse: halves(row.inverse),
        }
    }

    /// The moments of sixteen even pixels and of the sixteen odd ones right of them.
    #[inline(always)]
    pub(super) fn moments(&self, i: usize) -> [Moments<S::F>; 2] {
        let s = self.s;
        let p = &self.parts;
        let gx = across::<S, N>(s, &p[0], i);
        let gy = across::<S, N>(s, &p[1], i);
        let d = across::<S, N>(s, &p[2], i);
        let xx = across::<S, N>(s, &p[3], i);
        let xy = across::<S, N>(s, &p[4], i);
        let yy = across::<S, N>(s, &p[5], i);
        let xd = across::<S, N>(s, &p[6], i);
        let yd = across::<S, N>(s, &p[7], i);
        let dd = across::<S, N>(s, &p[8], i);
        let mut both = [[self.centre; 7]; 2];
        for half in 0..2 {
            let per = s.get(&self.inverse[half][i]);
            let scaled = per * self.centre;
            let (mx, my, md) = (gx[half] * scaled, gy[half] * scaled, d[half] * scaled);
            both[half] = [
                s.get(&self.number[half][i]),
                (xx[half] - gx[half] * mx) * per,
                (xy[half] - gx[half] * my) * per,
                (yy[half] - gy[half] * my) * per,
                (xd[half] - d[half] * mx) * per,
                (yd[half] - d[half] * my) * per,
                (dd[half] - d[half] * md) * per,
            ];
        }
        both
    }
}
