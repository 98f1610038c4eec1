//! One tile of a plane, sampled from both frames half of its displacement towards each other: what is left of the
//! displacement, with gain and offset of the light in the same least squares.
//!
//! `docs/explanation/algorithms.md`, section "Tiles of a plane".

#![allow(clippy::needless_range_loop, reason = "filter indices")]

use crate::frame::Plane;
use crate::shift::filters::{DERIVATIVE, Taps, reversed, taps};
use crate::simd::{EIGHT, Eight, Kernel, Packed, Simd};

/// Largest change of the gain between the frames, in parts of their mean: from 0.25 to 4.
const MOST_GAIN: f64 = 1.2;
/// Side of the largest tile, in pixels.
pub(super) const LARGEST: usize = 32;
/// Pixels around a tile that filters reach: two for the smoothing, two for the derivative.
pub(super) const REACH: usize = 4;
/// Rows of a tile with what the derivative reaches.
const ROWS: usize = LARGEST + REACH;
/// Values of such a row, up to a whole number of lanes.
const ROW: usize = LARGEST + 2 * REACH;

type Row = [f32; ROW];

/// What a thread keeps for its tiles.
#[derive(Debug)]
pub(super) struct Buffers {
    mean: [Row; ROWS],
    difference: [Row; ROWS],
    /// 1 where a pixel counts, 0 elsewhere; of the tile alone.
    pub(super) weight: [[f32; LARGEST]; LARGEST],
}

impl Default for Buffers {
    fn default() -> Self {
        Self {
            mean: [[0.0; ROW]; ROWS],
            difference: [[0.0; ROW]; ROWS],
            weight: [[1.0; LARGEST]; LARGEST],
        }
    }
}

/// Where a tile is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Top left pixel in either frame.
    pub(super) corners: [[usize; 2]; 2],
    /// What is left of the displacement, -0.5 to 0.5 in x and y.
    pub(super) fraction: [f64; 2],
    /// How the displacement grows, in pixels a pixel: u by x, u by y, v by x, v by y.
    pub(super) gradient: [f64; 4],
}

/// Sums over the pixels of a tile: of the gradient g = (x, y), of the mean m of both frames, from which a level is
/// taken, and of the difference t that the predicted motion leaves.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    pub(super) n: f64,
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) m: f64,
    pub(super) t: f64,
    pub(super) xx: f64,
    pub(super) xy: f64,
    pub(super) yy: f64,
    pub(super) xm: f64,
    pub(super) ym: f64,
    pub(super) mm: f64,
    pub(super) xt: f64,
    pub(super) yt: f64,
    pub(super) mt: f64,
    pub(super) tt: f64,
}

/// Sample a tile from both frames and sum it up.
#[derive(Debug)]
pub(super) struct SumTile<'a> {
    pub(super) frames: [&'a Plane; 2],
    pub(super) place: Place,
    /// A multiple of the lanes, at most [`LARGEST`].
    pub(super) side: usize,
    /// Whether the weights in `buffers` count.
    pub(super) weighted: bool,
    pub(super) buffers: &'a mut Buffers,
}

impl Kernel for SumTile<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run<S: Simd>(mut self, _: S) -> Sums {
        self.sample::<S::Eight>();
        self.sum::<S::Eight>()
    }
}

impl SumTile<'_> {
    /// Mean and difference of both frames, with two more pixels on each side.
    #[inline(always)]
    fn sample<L: Eight>(&mut self) {
        let [across, down] = [
            taps(0.5 * self.place.fraction[0]),
            taps(0.5 * self.place.fraction[1]),
        ];
        let rows = self.side + REACH;
        let (mut p, mut n): (Row, Row) = ([0.0; ROW], [0.0; ROW]);
        let [[px, py], [nx, ny]] = self.place.corners;
        let [prev, next] = self.frames;
        for row in 0..rows {
            columns::<L>(
                prev,
                [px - REACH, py + row - REACH],
                self.side,
                reversed(down),
                &mut p,
            );
            columns::<L>(
                next,
                [nx - REACH, ny + row - REACH],
                self.side,
                down,
                &mut n,
            );
            let (mean, difference) = (
                &mut self.buffers.mean[row],
                &mut self.buffers.difference[row],
            );
            let [ta, tb, tc, td, te] = across;
            let (ta, tb, tc) = (L::splat(ta), L::splat(tb), L::splat(tc));
            let (td, te) = (L::splat(td), L::splat(te));
            let half = L::splat(0.5);
            let mut at = 0;
            while at < rows {
                let x = at.min(rows - EIGHT);
                let outer = te * L::load(&p, x) + ta * L::load(&p, x + 4);
                let inner = td * L::load(&p, x + 1) + tb * L::load(&p, x + 3);
                let before = outer + inner + tc * L::load(&p, x + 2);
                let outer = ta * L::load(&n, x) + te * L::load(&n, x + 4);
                let inner = tb * L::load(&n, x + 1) + td * L::load(&n, x + 3);
                let after = outer + inner + tc * L::load(&n, x + 2);
                (half * (after + before)).store(mean, x);
                (after - before).store(difference, x);
                at += EIGHT;
            }
        }
    }

    #[inline(always)]
    fn sum<L: Eight>(&self) -> Sums {
        let side = self.side;
        let [a, b, _, d, e] = DERIVATIVE;
        let (ta, tb, td, te) = (L::splat(a), L::splat(b), L::splat(d), L::splat(e));
        let middle = side / 2 + 2;
        let level = self.buffers.mean[middle][middle];
        let lit = L::splat(level);
        let [ux, uy, vx, vy] = self.place.gradient.map(|value| value as f32);
        let centre = 0.5 * (side as f32 - 1.0);
        let mut sums = [L::zero(); 15];
        for row in 0..side {
            let y = row as f32 - centre;
            let (uy, vy) = (L::splat(uy * y), L::splat(vy * y));
            let rows: [&Row; 5] = std::array::from_fn(|k| &self.buffers.mean[row + k]);
            let difference = &self.buffers.difference[row + 2];
            let mut x = 0;
            while x < side {
                let off = L::splat(x as f32 - centre) + L::unpack(&Packed::STEPS);
                let middle = rows[2];
                let gx = (ta * L::load(middle, x) + te * L::load(middle, x + 4))
                    + (tb * L::load(middle, x + 1) + td * L::load(middle, x + 3));
                let gy = (ta * L::load(rows[0], x + 2) + te * L::load(rows[4], x + 2))
                    + (tb * L::load(rows[1], x + 2) + td * L::load(rows[3], x + 2));
                let m = L::load(middle, x + 2) - lit;
                // The tile grows and turns: what that does to the difference is known.
                let u = L::splat(ux) * off + uy;
                let v = L::splat(vx) * off + vy;
                let t = L::load(difference, x + 2) + (gx * u + gy * v);
                let (mut one, mut gx, mut gy, mut m, mut t) = (L::splat(1.0), gx, gy, m, t);
                if self.weighted {
                    let weight = L::load(&self.buffers.weight[row], x);
                    one = weight;
                    (gx, gy, m, t) = (gx * weight, gy * weight, m * weight, t * weight);
                }
                sums[0] += one;
                sums[1] += gx;
                sums[2] += gy;
                sums[3] += m;
                sums[4] += t;
                sums[5] += gx * gx;
                sums[6] += gx * gy;
                sums[7] += gy * gy;
                sums[8] += gx * m;
                sums[9] += gy * m;
                sums[10] += m * m;
                sums[11] += gx * t;
                sums[12] += gy * t;
                sums[13] += m * t;
                sums[14] += t * t;
                x += EIGHT;
            }
        }
        let [n, x, y, m, t, xx, xy, yy, xm, ym, mm, xt, yt, mt, tt] = L::sums(&sums);
        Sums {
            n,
            x,
            y,
            m,
            t,
            xx,
            xy,
            yy,
            xm,
            ym,
            mm,
            xt,
            yt,
            mt,
            tt,
        }
    }
}

/// The taps down the columns of `plane` from `place`, x and y of their first row, on: as many values as the tile and the
/// reach on both of its sides.
#[inline(always)]
fn columns<L: Eight>(plane: &Plane, place: [usize; 2], side: usize, taps: Taps, to: &mut Row) {
    let [x, y] = place;
    let length = side + 2 * REACH;
    let rows: [&[f32]; 5] = [0, 1, 2, 3, 4].map(|k| &plane.row(y + k)[x..x + length]);
    let [ta, tb, tc, td, te] = taps;
    let (ta, tb, tc, td, te) = (
        L::splat(ta),
        L::splat(tb),
        L::splat(tc),
        L::splat(td),
        L::splat(te),
    );
    let mut at = 0;
    while at < length {
        let outer = ta * L::load(rows[0], at) + te * L::load(rows[4], at);
        let inner = tb * L::load(rows[1], at) + td * L::load(rows[3], at);
        (outer + inner + tc * L::load(rows[2], at)).store(to, at);
        at += EIGHT;
    }
}

/// What a tile says of its displacement.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Solved {
    /// What is to be added to the displacement at which it was sampled.
    pub(super) step: [f64; 2],
    /// Products of the gradients after the light was taken out of them: xx, xy, yy.
    pub(super) structure: [f64; 3],
    /// Mean square of the difference that motion and light leave.
    pub(super) left: f64,
    /// Mean square of the tile's own texture.
    pub(super) texture: f64,
    /// Pixels that count.
    pub(super) count: f64,
}

impl Sums {
    /// Least squares of step, gain and offset; none where the tile shows nothing, or one direction alone.
    pub(super) fn solve(&self) -> Option<Solved> {
        if self.n < 16.0 {
            return None;
        }
        let n = 1.0 / self.n;
        // The offset taken out, then the gain.
        let mm = self.mm - self.m * self.m * n;
        let mt = self.mt - self.m * self.t * n;
        let xm = self.xm - self.x * self.m * n;
        let ym = self.ym - self.y * self.m * n;
        let share = if mm > 1e-9 * self.n { 1.0 / mm } else { 0.0 };
        let take = |ab: f64, a: f64, b: f64, am: f64, bm: f64| ab - a * b * n - am * bm * share;
        let xx = take(self.xx, self.x, self.x, xm, xm);
        let xy = take(self.xy, self.x, self.y, xm, ym);
        let yy = take(self.yy, self.y, self.y, ym, ym);
        let xt = take(self.xt, self.x, self.t, xm, mt);
        let yt = take(self.yt, self.y, self.t, ym, mt);
        let tt = take(self.tt, self.t, self.t, mt, mt);
        let determinant = xx * yy - xy * xy;
        let trace = xx + yy;
        if determinant.is_nan() || determinant <= 1e-4 * trace * trace || trace <= 1e-6 * self.n {
            return None;
        }
        // The difference is minus the gradient times what is missing.
        let step = [
            -(yy * xt - xy * yt) / determinant,
            -(xx * yt - xy * xt) / determinant,
        ];
        let mut left = (tt + step[0] * xt + step[1] * yt).max(0.0) / (self.n - 4.0);
        // A gain that turns one picture into nothing, or into its opposite, explains nothing.
        let gain = (mt + step[0] * xm + step[1] * ym) * share;
        if gain.abs() > MOST_GAIN {
            left += gain * gain * mm * n;
        }
        Some(Solved {
            step,
            structure: [xx, xy, yy],
            left,
            texture: mm * n,
            count: self.n,
        })
    }
}
