//! How the light of a picture differs from a reference's: a gain and an offset for the frame, and ones over it that vary
//! slowly, with what is left where these do not fit.
//!
//! The slow ones are fitted over tiles of 16 x 16 pixels on means of 4 x 4 ("cells"), see `cells`.
//! `docs/explanation/algorithms.md`, section "What moves: MotionSegmenter".

mod cells;
mod frame_light;
mod pair;
mod tile_sums;
mod tiles;

use crate::error::Result;
use crate::execution::Execution;
use crate::simd::{Floats, Kernel, LANES, Simd, SimdLevel, dispatch};

#[cfg(test)]
use super::morphology::Size;
use cells::Cells;
pub(crate) use frame_light::FrameLight;
use frame_light::Sample;
pub(crate) use pair::Pair;
use tiles::{TILE, Tiles};

const _: () = assert!(TILE == LANES);

/// The light of a picture, as gains and offsets for each pixel of its reference. Memory is kept from frame to frame.
#[derive(Debug)]
pub(crate) struct Light {
    frame: FrameLight,
    sample: Sample,
    cells: Cells,
    tiles: Tiles,
}

impl Default for Light {
    fn default() -> Self {
        Self {
            frame: FrameLight::NONE,
            sample: Sample::default(),
            cells: Cells::default(),
            tiles: Tiles::default(),
        }
    }
}

impl Light {
    /// Fit the light in which the reference looks as the picture does. `noise` is the standard deviation of the difference
    /// of two pictures of the same, 0 where it is not known; `start` is a gain and an offset that are likely, as those of
    /// the frame before.
    ///
    /// Where nothing counts there is no change of light.
    ///
    /// # Errors
    ///
    /// Those of the execution; [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn fit(
        &mut self,
        pair: &Pair<'_>,
        noise: f32,
        start: [f32; 2],
        execution: &Execution,
    ) -> Result<()> {
        self.frame = self.sample.fit(pair, start)?;
        self.tiles.reset(pair.size)?;
        self.cells.reduce(pair, &self.frame, execution)?;
        if pair.size.0 == 0 || pair.size.1 == 0 {
            return Ok(());
        }
        let noise = match self.frame.spread {
            spread if noise <= 0.0 && spread.is_finite() => spread,
            _ => noise.max(0.0),
        };
        self.tiles
            .fit(&mut self.cells, &self.frame, noise, execution)
    }

    /// Gain and offset of the whole frame, and how well they fit.
    pub(crate) fn frame(&self) -> &FrameLight {
        &self.frame
    }

    /// How far the means of blocks of 4 x 4 pixels are from the reference in this light, without their sign, in grey
    /// levels, and their columns and rows; NaN where fewer than half of a block's pixels count. Where it is far above
    /// the noise, as at the edge of a shadow, this light does not hold.
    #[cfg(test)]
    pub(crate) fn misfit(&self) -> (Size, &[f32]) {
        (self.cells.size, &self.cells.misfit)
    }

    /// Write what row `y` of the reference is multiplied by, and what is then added, to look as the picture does.
    pub(crate) fn row(&self, y: usize, gain: &mut [f32], offset: &mut [f32], level: SimdLevel) {
        let (gains, offsets) = (self.tiles.gains(), self.tiles.offsets());
        for (values, to) in [(gains, gain), (offsets, offset)] {
            let (above, below, down) = self.tiles.around(y, values);
            dispatch(
                level,
                Between {
                    above,
                    below,
                    down,
                    to,
                },
            );
        }
    }

    /// Write what row `y` of the picture is multiplied by, and what is then added, to look as the reference does.
    pub(crate) fn inverse_row(
        &self,
        y: usize,
        gain: &mut [f32],
        offset: &mut [f32],
        level: SimdLevel,
    ) {
        self.row(y, gain, offset, level);
        dispatch(level, Invert { gain, offset });
    }
}

/// A row between two rows of tiles, whose values stand at the tiles' middles.
struct Between<'a> {
    above: &'a [f32],
    below: &'a [f32],
    /// How far down from the one to the other.
    down: f32,
    to: &'a mut [f32],
}

impl Kernel for Between<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let last = self.above.len() - 1;
        let half = s.splat(0.5);
        let along = (s.ramp() + half) * s.splat(1.0 / TILE as f32);
        let (first, rest) = self.to.split_at_mut(self.to.len().min(TILE / 2));
        let mut here = self.above[0] + (self.below[0] - self.above[0]) * self.down;
        for value in first {
            *value = here;
        }
        let mut tile = 0;
        let (whole, part) = rest.as_chunks_mut::<LANES>();
        for to in whole {
            tile = last.min(tile + 1);
            let next = self.above[tile] + (self.below[tile] - self.above[tile]) * self.down;
            (s.splat(here) + s.splat(next - here) * along).put(to);
            here = next;
        }
        tile = last.min(tile + 1);
        let next = self.above[tile] + (self.below[tile] - self.above[tile]) * self.down;
        let mut lanes = [0.0; LANES];
        (s.splat(here) + s.splat(next - here) * along).put(&mut lanes);
        for (to, value) in part.iter_mut().zip(&lanes) {
            *to = *value;
        }
    }
}

/// The gain and the offset that undo others.
struct Invert<'a> {
    gain: &'a mut [f32],
    offset: &'a mut [f32],
}

impl Kernel for Invert<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        for (gain, offset) in self.gain.iter_mut().zip(self.offset) {
            *gain = 1.0 / *gain;
            *offset = -*offset * *gain;
        }
    }
}

#[cfg(test)]
mod tests;
