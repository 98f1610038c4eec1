//! What the windows of the last step or round say of the flow that it leaves: whether it was measured, and how well it
//! fits.
//!
//! Windows of some pixels change little from a pixel to the next: one in each 2 x 2 speaks for the four.
//!
//! `docs/explanation/algorithms.md`, section "Confidence and validity".

use crate::error::Result;
use crate::simd::{Floats, LANES, Simd, blocks_mut};

use super::moments::Moments;
use super::padded_plane::{PAD, PaddedPlane, extend};

/// The smaller eigenvalue of the structure tensor (mean over a window of `size` x `size` pixels, squared grey levels)
/// below which motion along one direction is noise even where the frames are quiet. On the same texture smaller windows
/// have less.
pub(super) fn least_texture(size: usize) -> f32 {
    match size {
        7 => 0.075,
        5 => 0.045,
        _ => 0.03,
    }
}

/// Mean squared differences above this share of the texture are not explained by an error of the flow of a pixel or so.
const MISFIT: f32 = 1.0;

/// Mean squared differences that noise explains, in squared grey levels.
const NOISE: f32 = 16.0;

/// A window whose mean squared difference is above this many times its texture may hold noise and nothing else: noise alone
/// gives 16 times.
const DROWNED: f32 = 3.0;

/// Mean squared differences that a blur leaves, as a share of the trace of the structure tensor, above those of strong
/// noise, in squared grey levels: what is uncovered, or has no match, leaves more.
const BLUR: f32 = 2.0;
const STRONG_NOISE: f32 = 32.0;

/// What is said of windows that are not all there, or hold too little texture.
pub(super) const NOTHING: f32 = f32::MIN;

/// What was found, at pixel (2x, 2y) of the level.
#[derive(Debug, Default)]
pub(super) struct Judged {
    /// At least 0 where all is well, [`NOTHING`] where the window has nothing to measure.
    pub(super) fit: PaddedPlane,
    /// At least 0 where the window does not speak against the flow: it may be drowned or blurred.
    pub(super) bearable: PaddedPlane,
    /// The root mean square difference, in grey levels of the planes.
    pub(super) misfit: PaddedPlane,
}

impl Judged {
    /// Take the size that belongs to a level of `width` x `height`.
    pub(super) fn resize(&mut self, width: usize, height: usize) -> Result<()> {
        for grid in [&mut self.fit, &mut self.bearable, &mut self.misfit] {
            grid.resize(width.div_ceil(2), height.div_ceil(2))?;
        }
        Ok(())
    }
}

impl Judged {
    /// Bring what was found on the level of half the size to frames of `width` x `height`; `spare` is memory.
    pub(super) fn spread(
        &mut self,
        (width, height): (usize, usize),
        spare: &mut PaddedPlane,
    ) -> Result<()> {
        let (width, height) = (width.div_ceil(2), height.div_ceil(2));
        for grid in [&mut self.fit, &mut self.bearable, &mut self.misfit] {
            spare.resize(width, height)?;
            for y in 0..height {
                let from = grid.row((y / 2).min(grid.height() - 1));
                let row = spare.padded_mut(y);
                for x in 0..width {
                    row[PAD + x] = from[(x / 2).min(from.len() - 1)];
                }
                extend(row, width);
            }
            std::mem::swap(grid, spare);
        }
        Ok(())
    }
}

/// Judges groups of windows, one after the other along a row.
pub(super) struct Judge<'a, F> {
    fit: &'a mut [[f32; LANES]],
    bearable: &'a mut [[f32; LANES]],
    misfit: &'a mut [[f32; LANES]],
    enough: F,
    texture: F,
    misfit_share: F,
    noise: F,
    drowned: F,
    blur: F,
    strong_noise: F,
    zero: F,
    half: F,
    nothing: F,
}

impl<'a, F: Floats> Judge<'a, F> {
    /// Of windows of `size` x `size` pixels, into padded rows.
    #[inline(always)]
    pub(super) fn new<S: Simd<F = F>>(
        s: S,
        size: usize,
        count: usize,
        [fit, bearable, misfit]: [&'a mut [f32]; 3],
    ) -> Self {
        Self {
            fit: blocks_mut(fit, PAD, count),
            bearable: blocks_mut(bearable, PAD, count),
            misfit: blocks_mut(misfit, PAD, count),
            enough: s.splat(0.5 * (size * size) as f32),
            texture: s.splat(least_texture(size)),
            misfit_share: s.splat(MISFIT),
            noise: s.splat(NOISE),
            drowned: s.splat(DROWNED),
            blur: s.splat(BLUR),
            strong_noise: s.splat(STRONG_NOISE),
            zero: s.splat(0.0),
            half: s.splat(0.5),
            nothing: s.splat(NOTHING),
        }
    }

    /// Write what the `i`-th group is judged by instead: pixels that count, texture, and mean squared difference after a
    /// step along x and y.
    #[inline(always)]
    pub(super) fn put_measures(&mut self, i: usize, moments: Moments<F>, step: [F; 2]) {
        let [texture, energy] = self.measures(moments, step);
        (moments[0] - self.enough).put(&mut self.fit[i]);
        texture.put(&mut self.bearable[i]);
        energy.put(&mut self.misfit[i]);
    }

    /// The smaller eigenvalue of the structure tensor, and what the least squares say of the mean squared difference after
    /// the step.
    #[inline(always)]
    fn measures(
        &self,
        [_, xx, xy, yy, xd, yd, dd]: Moments<F>,
        [step_x, step_y]: [F; 2],
    ) -> [F; 2] {
        let difference = (xx - yy) * self.half;
        let root = (difference * difference + xy * xy).sqrt();
        let texture = ((xx + yy) * self.half - root).max(self.zero);
        let change = step_x * (xx * step_x + xy * step_y + xd + xd)
            + step_y * (xy * step_x + yy * step_y + yd + yd);
        [texture, (dd + change).max(self.zero)]
    }

    /// Judge the `i`-th group, of the moments before a step along x and y.
    #[inline(always)]
    pub(super) fn put(&mut self, i: usize, moments: Moments<F>, step: [F; 2]) {
        let [texture, energy] = self.measures(moments, step);
        let [n, xx, _, yy, ..] = moments;
        // Each term is negative where something is amiss.
        let fits = (self.noise + self.misfit_share * texture).min(self.drowned * texture) - energy;
        let all_there = n - self.enough;
        let told = all_there.min(texture - self.texture);
        F::select(self.zero.le(told), fits, self.nothing).put(&mut self.fit[i]);
        let most = self.strong_noise + self.blur * (xx + yy);
        all_there.min(most - energy).put(&mut self.bearable[i]);
        energy.sqrt().put(&mut self.misfit[i]);
    }
}
