//! What is compared at a motion, and the features of a pixel that the normal equations are made of.

use crate::shift::coordinates::Pair;
use crate::shift::filters::{NoiseGain, noise_gain, taps};

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

/// What a call compares: a pair of planes, and the motion.
pub(super) struct View<'a> {
    pub(super) pair: Pair<'a>,
    pub(super) motion: [f64; MOTION],
    /// The centre of the window, in pixels of `prev`.
    pub(super) center: [f64; 2],
    /// Pixels from the centre to the border: the unit of x and y.
    pub(super) unit: f64,
}

impl View<'_> {
    /// The displacement at a place halfway, less `whole`, halved; and the place from the centre, in the unit.
    #[inline(always)]
    pub(super) fn half(&self, pixel: [isize; 2], whole: [isize; 2]) -> ([f64; 2], [f64; 2]) {
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
}
