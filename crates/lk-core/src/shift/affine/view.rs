//! Both frames at the pixels of a window, each moved towards the other by half of what the motion leaves, and the
//! features of a pixel that the normal equations are made of.

use crate::frame::Plane;
use crate::shift::coordinates::Pair;
use crate::shift::filters::{DERIVATIVE, NoiseGain, RADIUS, Taps, noise_gain, reversed, taps};

/// dx, dy, and the gradient: du/dx, du/dy, dv/dx, dv/dy.
pub(super) const MOTION: usize = 6;
/// The light: one, x, y and the mean of both frames.
pub(super) const LIGHT: usize = 4;
/// Motion, light and the difference.
pub(super) const FEATURES: usize = MOTION + LIGHT + 1;
pub(super) const ONE: usize = MOTION;
pub(super) const X: usize = MOTION + 1;
pub(super) const Y: usize = MOTION + 2;
pub(super) const MEAN: usize = MOTION + 3;
pub(super) const DIFFERENCE: usize = MOTION + LIGHT;

/// The features of one pixel.
pub(super) type Sample = [f64; FEATURES];

/// What a call compares: a pair of planes, and the motion.
pub(super) struct View<'a> {
    pub(super) pair: Pair<'a>,
    pub(super) motion: [f64; MOTION],
    /// The centre of the window, in pixels of `prev`.
    pub(super) center: [f64; 2],
    /// Pixels from the centre to the border: the unit of x and y.
    pub(super) unit: f64,
}

/// How a pixel of `prev` is compared.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Match {
    /// The whole pixels to its counterpart.
    pub(super) whole: [isize; 2],
}

impl View<'_> {
    /// The displacement at a place halfway, less `whole`, halved; and the place from the centre, in the unit.
    #[inline(always)]
    fn half(&self, pixel: [isize; 2], whole: [isize; 2]) -> ([f64; 2], [f64; 2]) {
        let [dx, dy, xx, xy, yx, yy] = self.motion;
        let x = pixel[0] as f64 + whole[0] as f64 / 2.0 - self.center[0] - dx / 2.0;
        let y = pixel[1] as f64 + whole[1] as f64 / 2.0 - self.center[1] - dy / 2.0;
        let u = dx + xx * x + xy * y;
        let v = dy + yx * x + yy * y;
        (
            [(u - whole[0] as f64) / 2.0, (v - whole[1] as f64) / 2.0],
            [x / self.unit, y / self.unit],
        )
    }

    #[inline(always)]
    pub(super) fn whole(&self, pixel: [isize; 2]) -> [isize; 2] {
        let (half, _) = self.half(pixel, [0, 0]);
        half.map(|value| (2.0 * value).round() as isize)
    }

    /// Both frames at a pixel, moved towards each other; `None` outside of what they show.
    #[inline(always)]
    pub(super) fn sample(&self, pixel: [isize; 2], whole: [isize; 2]) -> Option<[f32; 2]> {
        let (half, _) = self.half(pixel, whole);
        let half = half.map(|value| value.clamp(-0.5, 0.5));
        let across = taps(half[0]);
        let down = taps(half[1]);
        let prev = filtered(self.pair.prev, pixel, reversed(across), reversed(down))?;
        let at = std::array::from_fn(|axis| pixel[axis] + whole[axis] - self.pair.origin[axis]);
        let next = filtered(self.pair.next, at, across, down)?;
        Some([prev, next])
    }

    /// What the filters do to noise, on average over the window.
    pub(super) fn noise(&self) -> NoiseGain {
        const PLACES: usize = 4;
        let mut mean = NoiseGain {
            sampled: 0.0,
            gradient: [0.0; 2],
            laplacian: 0.0,
        };
        let share = 1.0 / (PLACES * PLACES) as f64;
        for row in 0..PLACES {
            for column in 0..PLACES {
                let pixel: [isize; 2] = std::array::from_fn(|axis| {
                    let (low, high) = self.pair.window[axis];
                    let place = 2 * [column, row][axis] + 1;
                    (low + (high - low) * place / (2 * PLACES)) as isize
                });
                let (half, _) = self.half(pixel, self.whole(pixel));
                let one = noise_gain(&half.map(|value| taps(value.clamp(-0.26, 0.26))));
                mean.sampled += share * one.sampled;
                mean.gradient[0] += share * one.gradient[0];
                mean.gradient[1] += share * one.gradient[1];
                mean.laplacian += share * one.laplacian;
            }
        }
        mean
    }

    fn weight(&self, pixel: [isize; 2], whole: [isize; 2]) -> f64 {
        let of = |plane: Option<&Plane>, [x, y]: [isize; 2]| {
            plane.map_or(1.0, |plane| f64::from(plane.row(y as usize)[x as usize]))
        };
        let at = std::array::from_fn(|axis| pixel[axis] + whole[axis] - self.pair.origin[axis]);
        of(self.pair.prev_weight, pixel) * of(self.pair.next_weight, at)
    }

    /// The features of a pixel; `None` where it does not count.
    pub(super) fn features(&self, rows: &Sampled<'_>, x: usize, y: usize) -> Option<(Sample, f64)> {
        let pixel = rows.pixel(x, y);
        let whole = self.whole(pixel);
        let [prev, next] = rows.at(x, y, whole)?;
        let weight = self.weight(pixel, whole);
        if weight == 0.0 {
            return None;
        }
        let mean = |dx: isize, dy: isize| -> Option<f64> {
            let [prev, next] = rows.near(self, x, y, [dx, dy], whole)?;
            Some(f64::from(prev + next) / 2.0)
        };
        let (near, far) = (f64::from(DERIVATIVE[3]), f64::from(DERIVATIVE[4]));
        let gx = near * (mean(1, 0)? - mean(-1, 0)?) + far * (mean(2, 0)? - mean(-2, 0)?);
        let gy = near * (mean(0, 1)? - mean(0, -1)?) + far * (mean(0, 2)? - mean(0, -2)?);
        let (_, [px, py]) = self.half(pixel, whole);
        Some((
            [
                gx,
                gy,
                gx * px,
                gx * py,
                gy * px,
                gy * py,
                1.0,
                px,
                py,
                f64::from(prev + next) / 2.0,
                f64::from(next - prev),
            ],
            weight,
        ))
    }
}

/// A plane at a pixel, filtered; `None` where the filter does not fit.
#[inline(always)]
fn filtered(plane: &Plane, [x, y]: [isize; 2], across: Taps, down: Taps) -> Option<f32> {
    let radius = RADIUS as isize;
    let inside = |at: isize, size: usize| at >= radius && at + radius < size as isize;
    if !inside(x, plane.width()) || !inside(y, plane.height()) {
        return None;
    }
    let (left, top) = (x as usize - RADIUS, y as usize - RADIUS);
    let mut sum = 0.0;
    for (k, tap) in down.iter().enumerate() {
        let row = &plane.row(top + k)[left..left + 2 * RADIUS + 1];
        let outer = across[0] * row[0] + across[4] * row[4];
        let inner = across[1] * row[1] + across[3] * row[3];
        sum += tap * (outer + inner + across[2] * row[2]);
    }
    Some(sum)
}

/// Both frames at all pixels of the window and around it.
pub(super) struct Sampled<'a> {
    /// The first pixel, and columns with those around them.
    pub(super) start: [isize; 2],
    pub(super) width: usize,
    /// For each pixel prev and next, NaN where they do not show it, and the whole pixels between them.
    pub(super) values: &'a [([f32; 2], Match)],
}

impl Sampled<'_> {
    fn pixel(&self, x: usize, y: usize) -> [isize; 2] {
        [self.start[0] + x as isize, self.start[1] + y as isize]
    }

    fn at(&self, x: usize, y: usize, whole: [isize; 2]) -> Option<[f32; 2]> {
        let (values, found) = self.values[y * self.width + x];
        (found.whole == whole && !values[0].is_nan() && !values[1].is_nan()).then_some(values)
    }

    /// The pixel `by` away, compared over the same whole pixels.
    #[inline(always)]
    fn near(
        &self,
        view: &View<'_>,
        x: usize,
        y: usize,
        by: [isize; 2],
        whole: [isize; 2],
    ) -> Option<[f32; 2]> {
        let (nx, ny) = (x.wrapping_add_signed(by[0]), y.wrapping_add_signed(by[1]));
        self.at(nx, ny, whole)
            .or_else(|| view.sample(self.pixel(nx, ny), whole))
    }
}
