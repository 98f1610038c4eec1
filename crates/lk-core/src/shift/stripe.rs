//! A stripe of tiles: both frames are sampled half a step towards each other into buffers that stay in the cache, then
//! summed.

use super::filters::{RADIUS, Taps, reversed};
use super::sums::{StripeSums, Tile, Tiling};
use super::view::View;
use crate::error::Result;
use crate::frame::Plane;
use crate::memory::resize;
use crate::simd::{EIGHT, Eight, Kernel, Packed, Simd};

/// A stripe of tiles, sampled: rows of the mean of both frames, with [`RADIUS`] more above, below and on each side, and
/// of their difference.
#[derive(Debug, Default)]
pub(super) struct Stripe {
    mean: Plane,
    difference: Plane,
    temporary: [Vec<f32>; 2],
}

/// Sample a stripe of tiles, and sum it up.
pub(super) struct EvaluateStripe<'a> {
    pub(super) view: &'a View<'a>,
    pub(super) tiling: &'a Tiling,
    pub(super) stripe: usize,
    pub(super) weight: Option<&'a Plane>,
    /// Whether the buffers hold the stripe before.
    pub(super) follows: bool,
    pub(super) buffers: &'a mut Stripe,
    pub(super) tiles: &'a mut [Tile],
}

impl Kernel for EvaluateStripe<'_> {
    type Output = Result<()>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Result<()> {
        let [width, height] = self.view.size;
        let padded = width.next_multiple_of(EIGHT);
        let rows = self.tiling.rows(self.stripe);
        let Stripe {
            mean,
            difference,
            temporary,
        } = self.buffers;
        let shared = 2 * RADIUS;
        let first = if self.follows {
            for plane in [&mut *mean, &mut *difference] {
                let from = (plane.height() - shared) * plane.width();
                plane.data_mut().copy_within(from.., 0);
            }
            rows.start + RADIUS
        } else {
            rows.start.saturating_sub(RADIUS)
        };
        let last = (rows.end + RADIUS).min(height);
        mean.resize(padded + 2 * RADIUS, rows.len() + shared)?;
        difference.resize(padded, rows.len() + shared)?;
        for row in temporary.iter_mut() {
            resize("a row", row, padded + 2 * RADIUS, 0.0)?;
        }
        // Row y of the region stands here.
        let at = |y: usize| y + RADIUS - rows.start;
        for y in first..last {
            let (mean, difference) = (mean.row_mut(at(y)), difference.row_mut(at(y)));
            sample::<S::Eight>(self.view, y, temporary, mean, difference);
            if !self.view.gain.is_none() {
                relight::<S::Eight>(self.view, y, mean, difference);
            }
        }
        // Outside of the region its border counts.
        for missing in 0..RADIUS.saturating_sub(rows.start) {
            repeat(mean, at(0), missing);
        }
        for missing in last..rows.end + RADIUS {
            repeat(mean, at(last - 1), at(missing));
        }
        StripeSums {
            mean,
            difference,
            weight: self.weight,
            tiling: self.tiling,
            stripe: self.stripe,
        }
        .run::<S::Eight>(self.tiles);
        Ok(())
    }
}

/// Copy row `from` to row `to`.
fn repeat(plane: &mut Plane, from: usize, to: usize) {
    let width = plane.width();
    plane
        .data_mut()
        .copy_within(from * width..(from + 1) * width, to * width);
}

/// Row `y` of the region in both frames, moved towards each other: their mean, padded by its border, and their
/// difference.
#[inline(always)]
fn sample<L: Eight>(
    view: &View<'_>,
    y: usize,
    temporary: &mut [Vec<f32>; 2],
    mean: &mut [f32],
    difference: &mut [f32],
) {
    let width = view.size[0];
    let [across, taps] = view.taps;
    let [p, n] = temporary;
    let length = width + 2 * RADIUS;
    let [prev, next] = view.starts;
    down::<L>(
        view.rows(view.pair.prev, prev, y),
        reversed(taps),
        &mut p[..length],
    );
    down::<L>(view.rows(view.pair.next, next, y), taps, &mut n[..length]);
    let (ta, tb, tc) = (
        L::splat(across[0]),
        L::splat(across[1]),
        L::splat(across[2]),
    );
    let (td, te) = (L::splat(across[3]), L::splat(across[4]));
    let half = L::splat(0.5);
    let padded = difference.len();
    let (p, n) = (&p[..padded + 2 * RADIUS], &n[..padded + 2 * RADIUS]);
    let mut x = 0;
    while x < padded {
        let outer = te * L::load(p, x) + ta * L::load(p, x + 4);
        let inner = td * L::load(p, x + 1) + tb * L::load(p, x + 3);
        let prev = outer + inner + tc * L::load(p, x + 2);
        let outer = ta * L::load(n, x) + te * L::load(n, x + 4);
        let inner = tb * L::load(n, x + 1) + td * L::load(n, x + 3);
        let next = outer + inner + tc * L::load(n, x + 2);
        (half * (next + prev)).store(mean, x + RADIUS);
        (next - prev).store(difference, x);
        x += EIGHT;
    }
    let (first, last) = (mean[RADIUS], mean[RADIUS + width - 1]);
    mean[..RADIUS].fill(first);
    mean[RADIUS + width..].fill(last);
    difference[width..].fill(0.0);
}

/// Take the known light out of row `y` of the difference.
#[inline(always)]
fn relight<L: Eight>(view: &View<'_>, y: usize, mean: &[f32], difference: &mut [f32]) {
    let [constant, along_x, along_y, curve] = view.gain.0;
    let start = constant + along_y * view.place[1].at(y);
    let step = along_x * view.place[0].step();
    let curve = L::splat((curve / 2.0) as f32);
    let steps = L::splat(step as f32) * L::unpack(&Packed::STEPS);
    let mut x = 0;
    while x < difference.len() {
        let at = (start + along_x * view.place[0].at(x)) as f32;
        let m = L::load(mean, x + RADIUS);
        let left = L::load(difference, x) - (L::splat(at) + steps + curve * m) * m;
        left.store(difference, x);
        x += EIGHT;
    }
    difference[view.size[0]..].fill(0.0);
}

/// The taps down the columns; outer pairs first, so that reversed taps on a mirrored picture give the same bits.
#[inline(always)]
fn down<L: Eight>(rows: [&[f32]; 2 * RADIUS + 1], taps: Taps, to: &mut [f32]) {
    let length = to.len();
    let (ta, tb, tc) = (L::splat(taps[0]), L::splat(taps[1]), L::splat(taps[2]));
    let (td, te) = (L::splat(taps[3]), L::splat(taps[4]));
    let [a, b, c, d, e] = rows;
    let mut x = 0;
    while x < length {
        // The last lanes overlap those before them: they hold the same values.
        let at = x.min(length - EIGHT);
        let outer = ta * L::load(a, at) + te * L::load(e, at);
        let inner = tb * L::load(b, at) + td * L::load(d, at);
        (outer + inner + tc * L::load(c, at)).store(to, at);
        x += EIGHT;
    }
}
