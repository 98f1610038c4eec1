//! The still scene as the last frame would show it.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};

use super::segmenter::Segmenter;
use super::transform::along_row;

impl Segmenter {
    /// Write the still scene at the pixels of the last frame, in its light; NaN where nothing is known.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if `to` has not as many elements as a frame has pixels; those of the execution; [`Error::Memory`].
    pub fn scene(&mut self, to: &mut [f32], execution: &Execution) -> Result<()> {
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
                    let from = background.median[place.clone()]
                        .iter()
                        .zip(&background.known[place]);
                    let light = gain.iter().zip(&offset);
                    for ((to, (median, known)), (gain, offset)) in
                        part.row_mut(local).iter_mut().zip(from).zip(light)
                    {
                        *to = if *known == 1 {
                            (median * gain + offset) * share
                        } else {
                            f32::NAN
                        };
                    }
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
                for (local, y) in band.enumerate() {
                    let row = part.row_mut(local);
                    if state.canvas.rests() {
                        row.copy_from_slice(&lit[y * width..][..width]);
                        continue;
                    }
                    along_row(&map, y, width, |x, px, py| {
                        row[x] = seen_at(&lit, size, px, py)
                    });
                }
            },
        )?;
        self.work.raw = lit;
        Ok(())
    }
}

/// Between four pixels, or the nearest where one of them is not known.
fn seen_at(plane: &[f32], (width, height): (usize, usize), x: f32, y: f32) -> f32 {
    if !(x > -0.5 && y > -0.5 && x < width as f32 - 0.5 && y < height as f32 - 0.5) {
        return f32::NAN;
    }
    let (cx, cy) = (
        x.max(0.0).min((width - 1) as f32),
        y.max(0.0).min((height - 1) as f32),
    );
    let (left, top) = (cx as usize, cy as usize);
    let (right, down) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (fx, fy) = (cx - left as f32, cy - top as f32);
    let [a, b, c, d] =
        [(left, top), (right, top), (left, down), (right, down)].map(|(x, y)| plane[y * width + x]);
    let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
    let between = upper + fy * (lower - upper);
    if between.is_nan() {
        plane[(cy + 0.5) as usize * width + (cx + 0.5) as usize]
    } else {
        between
    }
}
