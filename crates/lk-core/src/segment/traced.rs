//! Where each pixel of a row was in the frame before, and what that showed there: sixteen pixels at a time.

use super::flow_kernels::{APART, Frames, NEAR_PX, TENSORS, bilinear, came_from, was_seen};
use super::sampling::bilinear_lanes;
use super::transform::{Map, applied};
use crate::simd::{Floats, Kernel, LANES, Simd};

/// A row of what is traced back.
pub(super) struct Row<'a> {
    pub(super) frames: &'a Frames<'a>,
    /// From pixels of the current frame to those of the one before, as the camera moved.
    pub(super) back: &'a Map,
    /// Whether the camera did not move.
    pub(super) rests: bool,
    pub(super) y: usize,
    /// What the camera's motion does not explain, x and y.
    pub(super) residual: &'a mut [f32],
    /// 1 where that is known.
    pub(super) known: &'a mut [u8],
    /// What the frame before showed at the place of rest, and at the place that the flow says.
    pub(super) stood: &'a mut [f32],
    pub(super) moved: &'a mut [f32],
}

impl Kernel for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        let width = self.frames.size.0;
        for x in (0..width).step_by(LANES) {
            if x + LANES > width || !self.block(s, x) {
                for x in x..(x + LANES).min(width) {
                    self.pixel(x);
                }
            }
        }
    }
}

impl Row<'_> {
    /// One pixel, plainly.
    #[inline(never)]
    pub(super) fn pixel(&mut self, x: usize) {
        let (frames, y) = (self.frames, self.y);
        let width = frames.size.0;
        let place = [x as f32, y as f32];
        let ([u, v], there) = came_from(frames, place);
        let at = [place[0] - u, place[1] - v];
        let by_camera = applied(frames.camera, at.map(f64::from));
        let mut r = [
            f64::from(place[0]) - by_camera[0],
            f64::from(place[1]) - by_camera[1],
        ];
        if let Some(parallax) = frames.parallax {
            r = parallax.unexplained(place.map(f64::from), r);
        }
        (self.residual[2 * x], self.residual[2 * x + 1]) = (r[0] as f32, r[1] as f32);
        let before = if self.rests {
            place
        } else {
            applied(self.back, place.map(f64::from)).map(|value| value as f32)
        };
        let seen = self.rests || was_seen(frames.size, [x, y], before);
        self.known[x] = u8::from(there && seen) & frames.counts[y * width + x];
        self.stood[x] = if self.rests {
            frames.prev[y * width + x]
        } else {
            bilinear(frames.prev, frames.size, before)
        };
        self.moved[x] = if self.rests && u.abs().max(v.abs()) < NEAR_PX {
            self.stood[x]
        } else {
            bilinear(frames.prev, frames.size, at)
        };
    }

    /// Sixteen pixels from `x` on; false, and nothing of use is written, where they have to be done one by one.
    #[inline(always)]
    fn block<S: Simd>(&mut self, s: S, x: usize) -> bool {
        let (frames, y) = (self.frames, self.y);
        let (width, height) = frames.size;
        let start = y * width + x;
        let place = [s.splat(x as f32) + s.ramp(), s.splat(y as f32)];
        let (motion, there) = self.motion(s, place, start);
        let at = [place[0] - motion[0], place[1] - motion[1]];
        let Some(moved) = bilinear_lanes(s, frames.prev, frames.size, at) else {
            return false;
        };
        let mut seen = there;
        let (stood, moved) = if self.rests {
            let stood = s.load(frames.prev, start);
            let near = abs(s, motion[0])
                .max(abs(s, motion[1]))
                .lt(s.splat(NEAR_PX));
            (stood, S::F::select(near, stood, moved))
        } else {
            let before = self.before(s, x);
            let Some(stood) = bilinear_lanes(s, frames.prev, frames.size, before) else {
                return false;
            };
            let reach = s.splat((TENSORS.size / 2) as f32);
            for (axis, count) in [width, height].into_iter().enumerate() {
                let last = s.splat((count - 1) as f32);
                let (low, high) = (place[axis].min(reach), (last - place[axis]).min(reach));
                let within = S::F::both(
                    (low - s.splat(0.01)).le(before[axis]),
                    before[axis].le(last - high + s.splat(0.01)),
                );
                seen = S::F::both(seen, within);
            }
            (stood, moved)
        };
        if let (Some(to), Some(from)) = (
            self.stood[x..].first_chunk_mut(),
            self.moved[x..].first_chunk_mut(),
        ) {
            stood.put(to);
            moved.put(from);
        }
        self.write_known(s, x, [place, motion], seen);
        self.write_residual(s, x, place, at);
        true
    }

    /// [`came_from`], but for the look at what is given where the motion begins.
    #[inline(always)]
    fn motion<S: Simd>(
        &self,
        s: S,
        place: [S::F; 2],
        start: usize,
    ) -> ([S::F; 2], <S::F as Floats>::Mask) {
        let frames = self.frames;
        let (width, height) = frames.size;
        let (uv, stride) = (frames.uv, 2 * width);
        let (zero, one, half) = (s.splat(0.0), s.splat(1.0), s.splat(0.5));
        let last = [s.splat((width - 1) as f32), s.splat((height - 1) as f32)];
        let (u, v) = s
            .load(uv, 2 * start)
            .deinterleave(s.load(uv, 2 * start + LANES));
        let (mut motion, mut before) = ([u, v], [u, v]);
        let goes = s.splat(NEAR_PX).le(abs(s, u).max(abs(s, v)));
        if S::F::any(goes) {
            for _ in 0..3 {
                before = motion;
                let px = (place[0] - motion[0]).max(zero).min(last[0]);
                let py = (place[1] - motion[1]).max(zero).min(last[1]);
                let (left, top) = (px.trunc(), py.trunc());
                let (right, down) = ((left + one).min(last[0]), (top + one).min(last[1]));
                let (fx, fy) = (px - left, py - top);
                let a = s.pairs(uv, stride, top, left + left);
                let b = s.pairs(uv, stride, top, right + right);
                let c = s.pairs(uv, stride, down, left + left);
                let d = s.pairs(uv, stride, down, right + right);
                let share = [fx, fy];
                motion = [
                    between(share, [a.0, b.0], [c.0, d.0]),
                    between(share, [a.1, b.1], [c.1, d.1]),
                ];
            }
            for (axis, start) in [u, v].into_iter().enumerate() {
                motion[axis] = S::F::select(goes, motion[axis], start);
                before[axis] = S::F::select(goes, before[axis], start);
            }
        }
        let apart = abs(s, motion[0] - before[0]).max(abs(s, motion[1] - before[1]));
        let longest = abs(s, motion[0]).max(abs(s, motion[1]));
        let settled = apart.le(s.splat(APART[0]) + s.splat(APART[1]) * longest);
        let (px, py) = (place[0] - motion[0] + half, place[1] - motion[1] + half);
        let low = S::F::both(zero.le(px), zero.le(py));
        let high = S::F::both(px.lt(s.splat(width as f32)), py.lt(s.splat(height as f32)));
        (motion, S::F::both(settled, S::F::both(low, high)))
    }

    /// Where pixels were, as the camera moved.
    #[inline(always)]
    fn before<S: Simd>(&self, s: S, x: usize) -> [S::F; 2] {
        let [[a, b, c], [d, e, f], [g, h, i]] = *self.back;
        let y = self.y as f64;
        let (mut to_x, mut to_y) = ([0.0f32; LANES], [0.0f32; LANES]);
        for (lane, (to_x, to_y)) in (x as i32..).zip(to_x.iter_mut().zip(&mut to_y)) {
            let x = f64::from(lane);
            let w = g * x + h * y + i;
            *to_x = ((a * x + b * y + c) / w) as f32;
            *to_y = ((d * x + e * y + f) / w) as f32;
        }
        [s.get(&to_x), s.get(&to_y)]
    }

    /// Whether the motion is given where a pixel came from, and that was seen.
    #[inline(always)]
    fn write_known<S: Simd>(
        &mut self,
        s: S,
        x: usize,
        [place, motion]: [[S::F; 2]; 2],
        seen: <S::F as Floats>::Mask,
    ) {
        let width = self.frames.size.0;
        let half = s.splat(0.5);
        // Beyond the frame nothing is seen: any place will do.
        let zero = s.splat(0.0);
        let (mut px, mut py) = ([0.0; LANES], [0.0; LANES]);
        S::F::select(seen, place[0] - motion[0] + half, zero).put(&mut px);
        S::F::select(seen, place[1] - motion[1] + half, zero).put(&mut py);
        let mut flags = [0.0; LANES];
        S::F::select(seen, s.splat(1.0), zero).put(&mut flags);
        let start = self.y * width + x;
        let to = self.known[x..][..LANES].iter_mut();
        let from = self.frames.counts[start..][..LANES].iter();
        for (lane, (to, counts)) in to.zip(from).enumerate() {
            let at = py[lane] as u32 as usize * width + px[lane] as u32 as usize;
            *to = u8::from(flags[lane] == 1.0) & self.frames.given[at] & counts;
        }
    }

    /// What the camera's motion does not explain.
    #[inline(always)]
    fn write_residual<S: Simd>(&mut self, _: S, x: usize, place: [S::F; 2], at: [S::F; 2]) {
        let residual = &mut self.residual[2 * x..][..2 * LANES];
        if self.rests && self.frames.parallax.is_none() {
            let (first, second) = (place[0] - at[0]).interleave(place[1] - at[1]);
            let (low, high) = residual.split_at_mut(LANES);
            if let (Some(low), Some(high)) = (low.first_chunk_mut(), high.first_chunk_mut()) {
                first.put(low);
                second.put(high);
            }
            return;
        }
        let (mut px, mut py) = ([0.0; LANES], [0.0; LANES]);
        at[0].put(&mut px);
        at[1].put(&mut py);
        let [[a, b, c], [d, e, f], [g, h, i]] = *self.frames.camera;
        let y = self.y as f64;
        let (mut rx, mut ry) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let (at_x, at_y) = (f64::from(px[lane]), f64::from(py[lane]));
            let w = g * at_x + h * at_y + i;
            rx[lane] = f64::from(x as i32 + lane as i32) - (a * at_x + b * at_y + c) / w;
            ry[lane] = y - (d * at_x + e * at_y + f) / w;
        }
        if let Some(parallax) = self.frames.parallax {
            for lane in 0..LANES {
                let place = [(x + lane) as f64, y];
                [rx[lane], ry[lane]] = parallax.unexplained(place, [rx[lane], ry[lane]]);
            }
        }
        for (lane, to) in residual.as_chunks_mut::<2>().0.iter_mut().enumerate() {
            *to = [rx[lane] as f32, ry[lane] as f32];
        }
    }
}

#[inline(always)]
fn between<F: Floats>([fx, fy]: [F; 2], [a, b]: [F; 2], [c, d]: [F; 2]) -> F {
    let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
    upper + fy * (lower - upper)
}

#[inline(always)]
fn abs<S: Simd>(s: S, value: S::F) -> S::F {
    value.max(s.splat(0.0) - value)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::transform::{IDENTITY, inverse};
    use super::*;
    use crate::segment::made::{Numbers, bits, greys, mask};
    use crate::simd::{SimdLevel, dispatch};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn lanes_trace_as_single_pixels_do(
            w in 1usize..70, h in 1usize..12, seed in any::<u64>(), length in 0.0f64..9.0, moves in any::<bool>()
        ) {
            let size = (w, h);
            let mut numbers = Numbers::new(seed);
            let camera = if moves {
                [[1.0 + 0.02 * numbers.normal(), 0.01 * numbers.normal(), numbers.normal()],
                 [0.01 * numbers.normal(), 1.0, 0.3], [1e-4 * numbers.normal(), 1e-5, 1.0]]
            } else {
                IDENTITY
            };
            let given = mask(size, 0.9, seed ^ 1);
            let uv: Vec<f32> = (0..2 * w * h)
                .map(|at| if given[at / 2] == 1 { (length * numbers.normal()) as f32 } else { 0.0 })
                .collect();
            let (prev, current) = (greys(size, seed ^ 2), greys(size, seed ^ 3));
            let (counts, kept) = (mask(size, 0.95, seed ^ 4), vec![0; w * h]);
            let frames = Frames {
                size, prev: &prev, current: &current, uv: &uv, given: &given, counts: &counts, kept: &kept,
                camera: &camera, sigma_px: 0.1, parallax: None, least_px: 0.3, scale: 1.0, rounding: 0.3,
                range: [f32::NEG_INFINITY, f32::INFINITY],
            };
            let back = inverse(&camera).unwrap_or(IDENTITY);
            for y in 0..h {
                let run = |level: Option<SimdLevel>| {
                    let (mut residual, mut known) = (vec![0.0; 2 * w], vec![0; w]);
                    let (mut stood, mut moved) = (vec![0.0; w], vec![0.0; w]);
                    let mut row = Row {
                        frames: &frames, back: &back, rests: !moves, y, residual: &mut residual, known: &mut known,
                        stood: &mut stood, moved: &mut moved,
                    };
                    match level {
                        Some(level) => dispatch(level, row),
                        None => (0..w).for_each(|x| row.pixel(x)),
                    }
                    (bits(&residual), known, bits(&stood), bits(&moved))
                };
                let want = run(None);
                for level in SimdLevel::available() {
                    prop_assert_eq!(&run(Some(level)), &want);
                }
            }
        }
    }
}
