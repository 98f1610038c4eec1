//! The light of a segmenter's frame against its background, and the noise that is left.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::simd::{Kernel, Simd, dispatch};

use super::flow_evidence::quantile;
use super::light::{Light, Pair};
use super::morphology::{Element, dilate};
use super::segmenter::{GAP, Segmenter};

/// Standard deviation of a picture's noise, at least, in grey levels of 0 to 255.
const LEAST_NOISE: f32 = 0.7;
/// Of a camera that moves the tails are believed up to so many grey levels.
const QUIET: f32 = 1.2;
/// Shares of a normal distribution without its sign, and how many deviations they reach.
const NOISE_QUANTILES: [(f64, f32); 3] = [(0.5, 0.6745), (0.9, 1.645), (0.975, 2.241)];
/// Of what stands still less than one part in so many is in the shade of things.
const MOST_SHADED: usize = 5;
/// Where the light is more grey levels than this from the background's in more than one of so many places, each so many
/// pixels from the next, the background takes it over.
const FAR: f32 = 3.0;
const FAR_SHARE: usize = 20;
const FAR_STEP: usize = 16;

impl Segmenter {
    /// Fit the light of the frame where it shows the background, and take it out.
    pub(super) fn match_light(&mut self, execution: &Execution) -> Result<()> {
        let size = self.state.canvas.size;
        let pixels = size.0 * size.1;
        for mask in [
            &mut self.work.away,
            &mut self.work.still,
            &mut self.work.mask,
        ] {
            resize("masks", mask, pixels, 0)?;
        }
        for (mask, (moved, by_flow)) in self
            .work
            .mask
            .iter_mut()
            .zip(self.state.foreground.iter().zip(&self.work.by_flow))
        {
            *mask = moved | by_flow;
        }
        dilate(
            &self.work.mask,
            size,
            Element::Square(GAP),
            &mut self.work.away,
            execution,
        )?;
        let places = self.state.background.known.iter().zip(&self.state.seen);
        let mut sums = [0usize; 2];
        for (still, (((known, seen), away), shaded)) in self
            .work
            .still
            .iter_mut()
            .zip(places.zip(&self.work.away).zip(&self.state.shaded))
        {
            *still = known & seen & (1 - away);
            sums[0] += usize::from(*still);
            sums[1] += usize::from(*still & shaded);
        }
        // The shade of a thing says nothing of the light; what seems shaded nearly everywhere is another light.
        if sums[1] * MOST_SHADED < sums[0] {
            for (still, shaded) in self.work.still.iter_mut().zip(&self.state.shaded) {
                *still &= 1 - shaded;
            }
        }
        let pair = Pair {
            reference: &self.state.background.median,
            image: &self.work.raw,
            still: &self.work.still,
            size,
            range: [f32::NEG_INFINITY, f32::INFINITY],
        };
        self.work.light.fit(
            &pair,
            self.state.noise.max(2.0),
            self.state.light,
            execution,
        )?;
        let frame = self.work.light.frame();
        self.state.light = [frame.gain, frame.offset];
        self.work.lit = true;
        if self.is_far(execution)? {
            self.take_over_light(execution)?;
        }
        self.relight(execution)?;
        self.find_noise()
    }

    /// Whether the light is far from the background's somewhere: a cloud that has come a long way is not told from things.
    pub(super) fn is_far(&mut self, execution: &Execution) -> Result<bool> {
        let (width, height) = self.state.canvas.size;
        let level = execution.simd_level();
        let mut rows = Vec::new();
        resize("a row of light", &mut rows, 2 * width, 0.0)?;
        let (gain, offset) = rows.split_at_mut(width);
        let (mut far, mut all) = (0usize, 0usize);
        for y in (FAR_STEP / 2..height).step_by(FAR_STEP) {
            self.work.light.row(y, gain, offset, level);
            for x in (FAR_STEP / 2..width).step_by(FAR_STEP) {
                let at = y * width + x;
                if self.work.still[at] == 1 {
                    let value = self.state.background.median[at];
                    all += 1;
                    far += usize::from((value * gain[x] + offset[x] - value).abs() > FAR);
                }
            }
        }
        Ok(far * FAR_SHARE > all)
    }

    /// Keep the background in the light of this frame from now on.
    pub(super) fn take_over_light(&mut self, execution: &Execution) -> Result<()> {
        self.state.background.relight(&self.work.light, execution)?;
        self.state.earlier.forget();
        let (picture, width) = (&mut self.state.picture, self.state.canvas.size.0);
        relit(&self.work.light, Way::To, picture, width, execution)?;
        self.state.light = [1.0, 0.0];
        self.work.lit = false;
        Ok(())
    }

    /// Take the light out of the picture.
    pub(super) fn relight(&mut self, execution: &Execution) -> Result<()> {
        if !self.work.lit {
            return Ok(());
        }
        let (picture, width) = (&mut self.work.raw, self.state.canvas.size.0);
        relit(&self.work.light, Way::From, picture, width, execution)
    }

    pub(super) fn find_noise(&mut self) -> Result<()> {
        let width = self.state.canvas.size.0;
        self.work.values.clear();
        let values = &mut self.work.values;
        crate::memory::reserve("a sample", values, self.work.raw.len() / 12 + 2 * width)?;
        for (y, row) in self.work.raw.chunks_exact(width).enumerate().step_by(4) {
            let place = y * width..(y + 1) * width;
            let others = self.state.background.median[place.clone()]
                .iter()
                .zip(&self.work.still[place]);
            let kept = row
                .iter()
                .zip(others)
                .skip((y / 4) % 3)
                .step_by(3)
                .filter(|(_, (_, still))| **still == 1);
            values.extend(kept.map(|(value, (median, _))| (value - median).abs()));
        }
        if values.len() > 50 {
            // Of a normal distribution all are the same; compression leaves most pixels too quiet and a tail.
            let told =
                NOISE_QUANTILES.map(|(share, deviations)| quantile(values, share) / deviations);
            // Edges that are not quite where they were have a tail too, before a camera that moves.
            let most = if self.options.camera_moves {
                told[0].max(QUIET)
            } else {
                f32::INFINITY
            };
            self.state.noise = told.into_iter().fold(LEAST_NOISE, f32::max).min(most);
        }
        Ok(())
    }
}

/// Which light a picture has: it is shown in another, or another is taken out.
#[derive(Clone, Copy)]
enum Way {
    To,
    From,
}

/// Change the light of a picture, all of whose rows have `width` pixels.
fn relit(
    light: &Light,
    way: Way,
    picture: &mut [f32],
    width: usize,
    execution: &Execution,
) -> Result<()> {
    let (height, level) = (picture.len() / width, execution.simd_level());
    let rows = even_bands(execution, height, [32_768 / width, 16_384 / width]);
    for_each_band(
        execution,
        height,
        rows,
        RowsMut::new(picture, width),
        |band, mut part| {
            let (mut gain, mut offset) = (vec![1.0; width], vec![0.0; width]);
            for (local, y) in band.enumerate() {
                match way {
                    Way::To => light.row(y, &mut gain, &mut offset, level),
                    Way::From => light.inverse_row(y, &mut gain, &mut offset, level),
                }
                let kernel = Relit {
                    gain: &gain,
                    offset: &offset,
                    row: part.row_mut(local),
                };
                dispatch(level, kernel);
            }
        },
    )
}

struct Relit<'a> {
    gain: &'a [f32],
    offset: &'a [f32],
    row: &'a mut [f32],
}

impl Kernel for Relit<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        for ((value, gain), offset) in self.row.iter_mut().zip(self.gain).zip(self.offset) {
            *value = *value * gain + offset;
        }
    }
}
