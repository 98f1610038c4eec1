//! The still scene as the last frame would show it.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};

use super::placed::places;
use super::sampling::Known;
use super::segmenter::Segmenter;
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, dispatch};

impl Segmenter {
    /// Write the still scene at the pixels of the last frame, in its light; NaN where nothing is known.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if `to` has not as many elements as a frame has pixels; those of the execution; [`Error::Memory`].
    pub(super) fn scene(&mut self, to: &mut [f32], execution: &Execution) -> Result<()> {
        let state = &self.state;
        let (width, height) = state.canvas.frame;
        if to.len() != width * height {
            let expected = format!("{}, the pixels of a frame", width * height);
            return Err(Error::shape("scene", to.len().to_string(), expected));
        }
        let size = state.canvas.size;
        let share = 1.0 / self.options.scale;
        let mut lit = std::mem::take(&mut self.work.raw);
        resize("a picture", &mut lit, size.0 * size.1, 0.0)?;
        let (light, background) = (&self.work.light, &state.background);
        let (level, lit_anew) = (execution.simd_level(), self.work.lit);
        let rows = even_bands(execution, size.1, [32_768 / size.0, 16_384 / size.0]);
        for_each_band(
            execution,
            size.1,
            rows,
            RowsMut::new(&mut lit, size.0),
            |band, mut part| {
                let (mut gain, mut offset) =
                    (vec![state.light[0]; size.0], vec![state.light[1]; size.0]);
                for (local, y) in band.enumerate() {
                    if lit_anew {
                        light.row(y, &mut gain, &mut offset, level);
                    }
                    let place = y * size.0..(y + 1) * size.0;
                    let kernel = Lit {
                        median: &background.median[place.clone()],
                        known: &background.known[place],
                        light: [&gain, &offset],
                        share,
                        to: part.row_mut(local),
                    };
                    dispatch(level, kernel);
                }
            },
        )?;
        let map = state.canvas.to_canvas;
        let rows = even_bands(execution, height, [32_768 / width, 16_384 / width]);
        for_each_band(
            execution,
            height,
            rows,
            RowsMut::new(to, width),
            |band, mut part| {
                with_scratch(2 * width, |spare| {
                    for (local, y) in band.enumerate() {
                        let row = part.row_mut(local);
                        if state.canvas.rests() {
                            row.copy_from_slice(&lit[y * width..][..width]);
                            continue;
                        }
                        let kernel = Known {
                            from: &lit,
                            size,
                            places: places(&map, y, 0..width, spare, level),
                            to: row,
                        };
                        dispatch(level, kernel);
                    }
                })
            },
        )?;
        self.work.raw = lit;
        Ok(())
    }
}

/// A row of the background in a light; NaN where it is not known.
struct Lit<'a> {
    median: &'a [f32],
    known: &'a [u8],
    light: [&'a [f32]; 2],
    share: f32,
    to: &'a mut [f32],
}

impl Kernel for Lit<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [gain, offset] = self.light;
        let from = self
            .median
            .iter()
            .zip(self.known)
            .zip(gain.iter().zip(offset));
        for (to, ((median, known), (gain, offset))) in self.to.iter_mut().zip(from) {
            let value = (median * gain + offset) * self.share;
            *to = if *known == 1 { value } else { f32::NAN };
        }
    }
}
