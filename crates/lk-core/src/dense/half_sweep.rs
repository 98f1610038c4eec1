//! What [`relax`](super::relax) does to a row of its system: pixels are joined to their neighbours once, then every second
//! one is relaxed in each half-sweep.
//!
//! `docs/explanation/algorithms.md`, section "Refinement".

use crate::simd::{Floats, Kernel, LANES, Simd, blocks, blocks_mut};

use super::padded_plane::PAD;
use super::sum_down::Split;
use super::trend::Slopes;

/// Joins each pixel to its neighbours, adds what it differs from them by on the slopes to its right side, and inverts its
/// matrix.
pub(super) struct Join<'a> {
    pub(super) split: Split,
    /// The systems of the rows above and below.
    pub(super) smooth: [&'a [f32]; 2],
    pub(super) slopes: Slopes,
    /// 1 for a row above or below that lies there, -1 for one that is mirrored.
    pub(super) sides: [f32; 2],
    pub(super) here: &'a mut [f32],
}

impl Kernel for Join<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Split { half, count } = self.split;
        let (smooth, rest) = self.here.split_at_mut(2 * half);
        let smooth = &*smooth;
        let (xx, rest) = rest.split_at_mut(2 * half);
        let (xy, rest) = rest.split_at_mut(2 * half);
        let (yy, rest) = rest.split_at_mut(2 * half);
        let (bu, rest) = rest.split_at_mut(2 * half);
        let bv = &mut rest[..2 * half];
        let one = s.splat(1.0);
        let zero = s.splat(0.0);
        let [[u_x, u_y], [v_x, v_y]] = self.slopes.map(|axis| axis.map(|slope| s.splat(slope)));
        let [side_above, side_below] = self.sides.map(|side| s.splat(side));
        for odd in 0..2 {
            let at = odd * half + PAD;
            let joints = Joints::new(&self.split, odd, smooth, self.smooth);
            let xx = blocks_mut(xx, at, count);
            let xy = blocks_mut(xy, at, count);
            let yy = blocks_mut(yy, at, count);
            let bu = blocks_mut(bu, at, count);
            let bv = blocks_mut(bv, at, count);
            for i in 0..count {
                let [left, right, above, below] = joints.get(s, i);
                let joined = (left + right) + (above + below);
                let across = left - right;
                let down = above * side_above - below * side_below;
                (s.get(&bu[i]) + (across * u_x + down * u_y)).put(&mut bu[i]);
                (s.get(&bv[i]) + (across * v_x + down * v_y)).put(&mut bv[i]);
                let (a, b, c) = (
                    s.get(&xx[i]) + joined,
                    s.get(&xy[i]),
                    s.get(&yy[i]) + joined,
                );
                let scale = one / (a * c - b * b);
                (c * scale).put(&mut xx[i]);
                ((zero - b) * scale).put(&mut xy[i]);
                (a * scale).put(&mut yy[i]);
            }
        }
    }
}

/// The weights that join the even or odd pixels of a row to their neighbours.
struct Joints<'a> {
    here: &'a [[f32; LANES]],
    /// Left, right, above, below.
    near: [&'a [[f32; LANES]]; 4],
}

impl<'a> Joints<'a> {
    #[inline(always)]
    fn new(split: &Split, odd: usize, smooth: &'a [f32], near: [&'a [f32]; 2]) -> Self {
        let Split { half, count } = *split;
        let at = odd * half + PAD;
        let other = (1 - odd) * half + PAD + odd;
        Self {
            here: blocks(smooth, at, count),
            near: [
                blocks(smooth, other - 1, count),
                blocks(smooth, other, count),
                blocks(near[0], at, count),
                blocks(near[1], at, count),
            ],
        }
    }

    #[inline(always)]
    fn get<S: Simd>(&self, s: S, i: usize) -> [S::F; 4] {
        let here = s.get(&self.here[i]);
        [
            here + s.get(&self.near[0][i]),
            here + s.get(&self.near[1][i]),
            here + s.get(&self.near[2][i]),
            here + s.get(&self.near[3][i]),
        ]
    }
}

/// Relaxes the even or the odd pixels of a row.
pub(super) struct HalfSweep<'a> {
    pub(super) split: Split,
    /// 0 for the even pixels, 1 for the odd ones.
    pub(super) first: usize,
    /// The systems of the rows above and below.
    pub(super) smooth: [&'a [f32]; 2],
    pub(super) system: &'a [f32],
    /// The flow of the rows above and below.
    pub(super) near: [&'a [f32]; 2],
    pub(super) relaxation: f32,
    pub(super) flow: &'a mut [f32],
}

impl Kernel for HalfSweep<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Split { half, count } = self.split;
        let odd = self.first;
        let at = odd * half + PAD;
        let joints = Joints::new(&self.split, odd, &self.system[..2 * half], self.smooth);
        let row = 2 * half;
        let system = self.system;
        let (xx, xy, yy) = (
            blocks(system, row + at, count),
            blocks(system, 2 * row + at, count),
            blocks(system, 3 * row + at, count),
        );
        let (bu, bv) = (
            blocks(system, 4 * row + at, count),
            blocks(system, 5 * row + at, count),
        );
        let [above, below] = self.near;
        let (above_u, above_v) = (blocks(above, at, count), blocks(above, row + at, count));
        let (below_u, below_v) = (blocks(below, at, count), blocks(below, row + at, count));
        let (u, v) = self.flow.split_at_mut(row);
        let (u, beside_u) = one_half(u, half, odd);
        let (v, beside_v) = one_half(v, half, odd);
        let (u, v) = (blocks_mut(u, PAD, count), blocks_mut(v, PAD, count));
        let (left, right) = (PAD + odd - 1, PAD + odd);
        let (left_u, right_u) = (
            blocks(beside_u, left, count),
            blocks(beside_u, right, count),
        );
        let (left_v, right_v) = (
            blocks(beside_v, left, count),
            blocks(beside_v, right, count),
        );
        let relaxation = s.splat(self.relaxation);
        for i in 0..count {
            let [left, right, above, below] = joints.get(s, i);
            let bu = s.get(&bu[i])
                + (left * s.get(&left_u[i]) + right * s.get(&right_u[i]))
                + (above * s.get(&above_u[i]) + below * s.get(&below_u[i]));
            let bv = s.get(&bv[i])
                + (left * s.get(&left_v[i]) + right * s.get(&right_v[i]))
                + (above * s.get(&above_v[i]) + below * s.get(&below_v[i]));
            let (xx, xy, yy) = (s.get(&xx[i]), s.get(&xy[i]), s.get(&yy[i]));
            let (now_u, now_v) = (s.get(&u[i]), s.get(&v[i]));
            (now_u + relaxation * ((xx * bu + xy * bv) - now_u)).put(&mut u[i]);
            (now_v + relaxation * ((xy * bu + yy * bv) - now_v)).put(&mut v[i]);
        }
    }
}

/// The half to write and the other one.
#[inline(always)]
fn one_half(row: &mut [f32], half: usize, odd: usize) -> (&mut [f32], &[f32]) {
    let (even, odds) = row.split_at_mut(half);
    if odd == 0 { (even, odds) } else { (odds, even) }
}
