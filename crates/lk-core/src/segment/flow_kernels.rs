//! Rows of what a flow says, and where a pixel came from.

use super::box_filter::Window;
use super::morphology::Size;
use super::parallax::Parallax;
use super::slopes::gradient;
use super::transform::Map;
use crate::parallel::{RowsMut, SplitRows};
use crate::simd::{Kernel, Simd};

/// A residual shorter than this, in pixels, needs no search for where it came from.
pub(super) const NEAR_PX: f32 = 0.05;

pub(super) const TENSORS: Window = Window { size: 7 };

/// Two frames and the flow between them, all of one size.
pub(crate) struct Frames<'a> {
    pub(crate) size: Size,
    pub(crate) prev: &'a [f32],
    pub(crate) current: &'a [f32],
    /// Motion of each pixel of `prev`, x and y.
    pub(crate) uv: &'a [f32],
    /// 1 where it is given.
    pub(crate) given: &'a [u8],
    /// 0 where a pixel of `current` does not count.
    pub(crate) counts: &'a [u8],
    /// 1 where something moved in `prev`, carried along by the camera's motion.
    pub(crate) kept: &'a [u8],
    /// The camera's motion and its standard deviation, in pixels of this size.
    pub(crate) camera: &'a Map,
    pub(crate) sigma_px: f64,
    pub(crate) parallax: Option<&'a Parallax>,
    /// Motion below this many pixels is not told from rest.
    pub(crate) least_px: f32,
    /// Pixels of the full frame in one of these.
    pub(crate) scale: f32,
    /// Standard deviation of rounding.
    pub(crate) rounding: f32,
    pub(crate) range: [f32; 2],
}

/// Share of the gradient that a difference may have from interpolation and registration, in pixels.
const REGISTRATION_PX: f32 = 0.15;
/// Steps that go on by more than so many pixels and this share of the motion have not settled.
pub(super) const APART: [f32; 2] = [0.5, 0.1];

/// What is written row by row when pixels are traced back.
pub(super) struct Traced<'a> {
    pub(super) residual: RowsMut<'a, f32>,
    pub(super) known: RowsMut<'a, u8>,
    pub(super) stood: RowsMut<'a, f32>,
    pub(super) moved: RowsMut<'a, f32>,
}

impl SplitRows for Traced<'_> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (r, k) = (
            self.residual.split_at_row(row),
            self.known.split_at_row(row),
        );
        let (s, m) = (self.stood.split_at_row(row), self.moved.split_at_row(row));
        (
            Self {
                residual: r.0,
                known: k.0,
                stood: s.0,
                moved: m.0,
            },
            Self {
                residual: r.1,
                known: k.1,
                stood: s.1,
                moved: m.1,
            },
        )
    }
}

/// The motion that brought something to a place, x + b = place - motion, and whether it is given there: three steps
/// of a fixed point.
#[inline(always)]
pub(super) fn came_from(frames: &Frames<'_>, [x, y]: [f32; 2]) -> ([f32; 2], bool) {
    let (width, height) = frames.size;
    let at = |x: usize, y: usize| {
        let at = y * width + x;
        let known = frames.given[at] == 1;
        if known {
            [frames.uv[2 * at], frames.uv[2 * at + 1]]
        } else {
            [0.0; 2]
        }
    };
    let start = at(x as usize, y as usize);
    let (mut motion, mut before) = (start, start);
    if start[0].abs().max(start[1].abs()) >= NEAR_PX {
        for _ in 0..3 {
            before = motion;
            let px = (x - motion[0]).max(0.0).min((width - 1) as f32);
            let py = (y - motion[1]).max(0.0).min((height - 1) as f32);
            let (left, top) = (px as usize, py as usize);
            let (right, down) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
            let (fx, fy) = (px - left as f32, py - top as f32);
            let corners = [
                at(left, top),
                at(right, top),
                at(left, down),
                at(right, down),
            ];
            motion = [0, 1].map(|k| {
                let [a, b, c, d] = corners.map(|corner: [f32; 2]| corner[k]);
                let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
                upper + fy * (lower - upper)
            });
        }
    }
    // What was hidden before came from nowhere: its steps go to and fro between what hid it and what is beside that.
    let apart = (motion[0] - before[0])
        .abs()
        .max((motion[1] - before[1]).abs());
    let settled = apart <= APART[0] + APART[1] * motion[0].abs().max(motion[1].abs());
    let (px, py) = (x - motion[0] + 0.5, y - motion[1] + 0.5);
    let inside = px >= 0.0 && py >= 0.0 && px < width as f32 && py < height as f32;
    let known = settled && inside && frames.given[py as usize * width + px as usize] == 1;
    (motion, known)
}

/// Whether the frame before shows the window around a pixel, as far as this frame has it.
pub(super) fn was_seen((width, height): Size, [x, y]: [usize; 2], [px, py]: [f32; 2]) -> bool {
    let reach = (TENSORS.size / 2) as f32;
    let along = |at: usize, p: f32, count: usize| {
        let (low, high) = ((at as f32).min(reach), ((count - 1 - at) as f32).min(reach));
        p >= low - 0.01 && p <= (count - 1) as f32 - high + 0.01
    };
    along(x, px, width) && along(y, py, height)
}

#[inline(always)]
pub(super) fn bilinear(from: &[f32], (width, height): Size, [x, y]: [f32; 2]) -> f32 {
    let (x, y) = (
        x.max(0.0).min((width - 1) as f32),
        y.max(0.0).min((height - 1) as f32),
    );
    let (left, top) = (x as usize, y as usize);
    let (right, down) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (fx, fy) = (x - left as f32, y - top as f32);
    let (upper, lower) = (top * width, down * width);
    let above = from[upper + left] + fx * (from[upper + right] - from[upper + left]);
    let below = from[lower + left] + fx * (from[lower + right] - from[lower + left]);
    above + fy * (below - above)
}

pub(super) struct Two<'a>(pub(super) RowsMut<'a, f32>, pub(super) RowsMut<'a, f32>);

impl SplitRows for Two<'_> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (a, b) = (self.0.split_at_row(row), self.1.split_at_row(row));
        (Self(a.0, b.0), Self(a.1, b.1))
    }
}

pub(super) struct Three<'a>(pub(super) Two<'a>, pub(super) RowsMut<'a, f32>);

impl SplitRows for Three<'_> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (a, b) = (self.0.split_at_row(row), self.1.split_at_row(row));
        (Self(a.0, b.0), Self(a.1, b.1))
    }
}

pub(super) struct Relit<'a> {
    pub(super) light: [&'a [f32]; 2],
    pub(super) current: &'a [f32],
    pub(super) planes: [&'a mut [f32]; 2],
}

impl Kernel for Relit<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [gain, offset] = self.light;
        for plane in self.planes {
            for (((value, current), gain), offset) in
                plane.iter_mut().zip(self.current).zip(gain).zip(offset)
            {
                *value = current - (*value * gain + offset);
            }
        }
    }
}

pub(super) struct Scaled<'a> {
    pub(super) rows: [&'a [f32]; 3],
    pub(super) counts: &'a [u8],
    pub(super) differences: [&'a [f32]; 2],
    pub(super) variance: f32,
    pub(super) to: [&'a mut [f32]; 2],
}

impl Kernel for Scaled<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [stood, moved] = self.differences;
        let [rest, motion] = self.to;
        gradient(self.rows, rest, motion);
        let part = REGISTRATION_PX * REGISTRATION_PX;
        let differences = stood.iter().zip(moved).zip(self.counts);
        for ((rest, motion), ((stood, moved), counts)) in
            rest.iter_mut().zip(motion.iter_mut()).zip(differences)
        {
            let scale = self.variance + part * (*rest * *rest + *motion * *motion);
            let share = f32::from(*counts) / scale;
            *rest = stood * stood * share;
            *motion = moved * moved * share;
        }
    }
}

pub(super) struct Products<'a> {
    pub(super) rows: [&'a [f32]; 3],
    pub(super) to: [&'a mut [f32]; 3],
}

impl Kernel for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [xx, xy, yy] = self.to;
        gradient(self.rows, xx, yy);
        for ((xx, xy), yy) in xx.iter_mut().zip(xy.iter_mut()).zip(yy.iter_mut()) {
            *xy = *xx * *yy;
            *xx *= *xx;
            *yy *= *yy;
        }
    }
}

/// A difference of this many mean squares is one beside a stronger one.
const WEAK_MISMATCH: f32 = 2.5;
/// Of so many something else is seen, whatever its motion.
const CHANGED: f32 = 25.0;

/// What the differences of pixels say, on their own.
pub(super) struct Verdict<'a> {
    /// Squared motion that is told from rest.
    pub(super) least: f32,
    pub(super) depth: bool,
    /// From the picture at rest, and from that moved by the flow.
    pub(super) differences: [&'a [f32]; 2],
    pub(super) residual: &'a [f32],
    pub(super) known: &'a [u8],
    pub(super) kept: &'a [u8],
    /// What may move, what may belong to it, and what is surely something else.
    pub(super) to: [&'a mut [u8]; 3],
}

impl Kernel for Verdict<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [rest, motion] = self.differences;
        let [seeds, possible, certain] = self.to;
        let from = rest
            .iter()
            .zip(motion)
            .zip(self.residual.as_chunks::<2>().0);
        let from = from.zip(self.known.iter().zip(self.kept));
        let to = seeds.iter_mut().zip(possible).zip(certain);
        for (((seed, possible), certain), (((rest, motion), [u, v]), (known, kept))) in to.zip(from)
        {
            let long = known & u8::from(u * u + v * v > self.least);
            // Near the edge of a thing its flow reaches over the surroundings: there rest explains the picture as well.
            let kept = *kept == 1;
            let limit = if kept {
                0.9 * motion
            } else {
                1.3 * motion + 0.7
            };
            *seed = long & u8::from(*rest > WEAK_MISMATCH) & u8::from(*rest > limit);
            // Where there is no texture, both explain it: that alone is no evidence, but it fills a thing.
            *possible = long & u8::from(*motion < WEAK_MISMATCH);
            // Depth changes what is seen at the plane's places, too.
            let moves = if self.depth { long } else { *known };
            *certain = moves & u8::from(*rest > CHANGED);
        }
    }
}
