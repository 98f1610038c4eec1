//! What the windows of the last step or round say of the flow that it leaves: whether it was measured, and how well it
//! fits.
//!
//! Windows of some pixels change little from a pixel to the next: one in each 2 x 2 speaks for the four.

use crate::error::Result;
use crate::simd::{Floats, LANES, Simd, blocks_mut};

use super::grid::{Grid, PAD};
use super::moments::Moments;

/// The smaller eigenvalue of the structure tensor (mean over a window of `size` x `size` pixels, squared grey levels)
/// below which motion along one direction is noise. Noise of one grey level alone gives 1/8: four differences of weight
/// 1/4, in one direction, twice the variance. On the same texture smaller windows have less.
pub(super) fn least_texture(size: usize) -> f32 {
    match size {
        7 => 0.25,
        5 => 0.15,
        _ => 0.1,
    }
}

/// Mean squared differences above this share of the texture are not explained by an error of the flow of a pixel or so.
const MISFIT: f32 = 1.0;

/// Mean squared differences that noise explains, in squared grey levels.
const NOISE: f32 = 16.0;

/// A window whose mean squared difference is above this many times its texture holds noise and nothing else: noise alone
/// gives 16 times.
const DROWNED: f32 = 6.0;

/// What was found, at pixel (2x, 2y) of the level.
#[derive(Debug, Default)]
pub(super) struct Judged {
    /// At least 0 where all is well.
    pub(super) fit: Grid,
    /// The root mean square difference, in grey levels of the planes.
    pub(super) misfit: Grid,
}

impl Judged {
    /// Take the size that belongs to a level of `width` x `height`.
    pub(super) fn resize(&mut self, width: usize, height: usize) -> Result<()> {
        for grid in [&mut self.fit, &mut self.misfit] {
            grid.resize(width.div_ceil(2), height.div_ceil(2))?;
        }
        Ok(())
    }
}

/// Judges groups of windows, one after the other along a row.
pub(super) struct Judge<'a, F> {
    fit: &'a mut [[f32; LANES]],
    misfit: &'a mut [[f32; LANES]],
    enough: F,
    texture: F,
    misfit_share: F,
    noise: F,
    drowned: F,
    zero: F,
    half: F,
}

impl<'a, F: Floats> Judge<'a, F> {
    /// Of windows of `size` x `size` pixels, into padded rows.
    #[inline(always)]
    pub(super) fn new<S: Simd<F = F>>(
        s: S,
        size: usize,
        count: usize,
        [fit, misfit]: [&'a mut [f32]; 2],
    ) -> Self {
        Self {
            fit: blocks_mut(fit, PAD, count),
            misfit: blocks_mut(misfit, PAD, count),
            enough: s.splat(0.5 * (size * size) as f32),
            texture: s.splat(least_texture(size)),
            misfit_share: s.splat(MISFIT),
            noise: s.splat(NOISE),
            drowned: s.splat(DROWNED),
            zero: s.splat(0.0),
            half: s.splat(0.5),
        }
    }

    /// Judge the `i`-th group, of the moments before a step along x and y.
    #[inline(always)]
    pub(super) fn put(
        &mut self,
        i: usize,
        [n, xx, xy, yy, xd, yd, dd]: Moments<F>,
        [step_x, step_y]: [F; 2],
    ) {
        let difference = (xx - yy) * self.half;
        let root = (difference * difference + xy * xy).sqrt();
        let texture = ((xx + yy) * self.half - root).max(self.zero);
        // What the least squares say of the difference after the step.
        let change = step_x * (xx * step_x + xy * step_y + xd + xd)
            + step_y * (xy * step_x + yy * step_y + yd + yd);
        let energy = (dd + change).max(self.zero);
        // Each term is negative where something is amiss.
        let fits = (self.noise + self.misfit_share * texture).min(self.drowned * texture) - energy;
        let good = (n - self.enough).min(texture - self.texture).min(fits);
        good.put(&mut self.fit[i]);
        energy.sqrt().put(&mut self.misfit[i]);
    }
}
