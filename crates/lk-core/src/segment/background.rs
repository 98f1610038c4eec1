//! What was seen at each place of the canvas when nothing moved there: sixteen samples a pixel, replaced at random, their
//! median and deviation. O. Barnich and M. Van Droogenbroeck, "ViBe: a universal background subtraction algorithm for
//! video sequences", IEEE Trans. Image Processing 20(6), 2011.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, SplitRows, even_bands, for_each_band};
use crate::simd::dispatch;

use super::background_kernels::{
    BLOCK, Distances, Refresh, RelitSamples, SAMPLES, UNITS, one_sample_of,
};
use super::light::Light;
use super::morphology::Size;
use super::placed::nearest;
use super::transform::Map;
/// One pixel in so many takes a sample a frame, in each row one of so many side by side.
const RATE: usize = 8;
/// Frames after which all samples of a pixel are its own.
pub(super) const OLD: u8 = SAMPLES as u8;
/// Medians are made anew after so many frames, of pixels that are not young.
const REFRESH: usize = 4;

/// The model.
#[derive(Debug, Default, Clone)]
pub(crate) struct Background {
    pub(crate) size: Size,
    /// Plane after plane.
    pub(crate) samples: Vec<i16>,
    /// 1 where something was learned.
    pub(crate) known: Vec<u8>,
    /// Frames that were learned, at most 255.
    pub(crate) age: Vec<u8>,
    /// Median of the samples, in grey levels.
    pub(crate) median: Vec<f32>,
    /// Standard deviation of the samples from their quartiles.
    pub(crate) deviation: Vec<f32>,
    pub(crate) frame: u64,
}

impl Background {
    /// Nothing is known.
    pub(crate) fn reset(&mut self, size: Size) -> Result<()> {
        let pixels = size.0 * size.1;
        self.size = size;
        self.frame = 0;
        self.samples.clear();
        resize("samples", &mut self.samples, SAMPLES * pixels, 0)?;
        for bytes in [&mut self.known, &mut self.age] {
            bytes.clear();
            resize("samples", bytes, pixels, 0)?;
        }
        for plane in [&mut self.median, &mut self.deviation] {
            plane.clear();
            resize("samples", plane, pixels, 0.0)?;
        }
        Ok(())
    }

    /// See the canvas anew: `map` takes a pixel of it to the old one's.
    pub(crate) fn moved(&mut self, map: &Map, execution: &Execution) -> Result<()> {
        let (size, pixels) = (self.size, self.size.0 * self.size.1);
        let mut samples = Vec::new();
        resize("samples", &mut samples, pixels, 0i16)?;
        for plane in self.samples.chunks_exact_mut(pixels) {
            nearest((plane, size), map, (&mut samples, size), 0, execution)?;
            plane.copy_from_slice(&samples);
        }
        for bytes in [&mut self.known, &mut self.age] {
            moved(bytes, size, map, 0, execution)?;
        }
        for plane in [&mut self.median, &mut self.deviation] {
            moved(plane, size, map, 0.0, execution)?;
        }
        Ok(())
    }

    /// Write, for each pixel, how far the second nearest sample is from a picture in the background's light; of pixels of
    /// which it is within `enough` grey levels perhaps that of another one that is.
    pub(crate) fn distances(
        &self,
        picture: &[f32],
        enough: f32,
        to: &mut [f32],
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = self.size;
        let pixels = width * height;
        let level = execution.simd_level();
        let enough = (enough * UNITS).floor() as i16;
        let rows = even_bands(execution, height, [32_768 / width, 16_384 / width]);
        for_each_band(
            execution,
            height,
            rows,
            RowsMut::new(to, width),
            |band, part| {
                let start = band.start * width;
                let places = start..start + part.data.len();
                dispatch(
                    level,
                    Distances {
                        samples: &self.samples,
                        pixels,
                        start,
                        picture: &picture[places],
                        enough,
                        to: part.data,
                    },
                );
            },
        )
    }

    /// Take a picture in the background's light: where `seen` is 1 and `away` is not. Where `adopt` is 1 what was known is
    /// forgotten first.
    pub(crate) fn learn(
        &mut self,
        picture: &[f32],
        [seen, away, adopt]: [&[u8]; 3],
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = self.size;
        self.frame += 1;
        let frame = self.frame;
        let level = execution.simd_level();
        let part = self.rows();
        let rows = even_bands(execution, height, [32_768 / width, 16_384 / width]);
        for_each_band(execution, height, rows, part, |band, mut part| {
            for (local, y) in band.enumerate() {
                let row = y * width..(y + 1) * width;
                let masks = [seen, away, adopt].map(|mask| &mask[row.clone()]);
                part.learn_row(local, &picture[row], masks, (frame, y));
                part.refresh_row(local, (frame as usize + y).is_multiple_of(REFRESH), level);
            }
        })
    }

    /// All rows, to divide between threads.
    fn rows(&mut self) -> Part<'_> {
        let (width, height) = self.size;
        Part {
            samples: self.samples.chunks_exact_mut(width * height).collect(),
            known: &mut self.known,
            age: &mut self.age,
            median: &mut self.median,
            deviation: &mut self.deviation,
            width,
        }
    }

    /// Show all that is known in another light.
    pub(crate) fn relight(&mut self, light: &Light, execution: &Execution) -> Result<()> {
        let (width, height) = self.size;
        let level = execution.simd_level();
        let part = self.rows();
        let rows = even_bands(execution, height, [16_384 / width, 8192 / width]);
        for_each_band(execution, height, rows, part, |band, mut part| {
            let (mut gain, mut offset) = (vec![1.0; width], vec![0.0; width]);
            for (local, y) in band.enumerate() {
                light.row(y, &mut gain, &mut offset, level);
                let row = local * width..(local + 1) * width;
                for plane in &mut part.samples {
                    dispatch(
                        level,
                        RelitSamples {
                            gain: &gain,
                            offset: &offset,
                            samples: &mut plane[row.clone()],
                        },
                    );
                }
                let planes = part.median[row.clone()]
                    .iter_mut()
                    .zip(&mut part.deviation[row]);
                for ((median, deviation), (gain, offset)) in planes.zip(gain.iter().zip(&offset)) {
                    *median = *median * gain + offset;
                    *deviation *= gain;
                }
            }
        })
    }
}

/// Move one plane.
pub(crate) fn moved<T: Copy + Send + Sync>(
    plane: &mut [T],
    size: Size,
    map: &Map,
    missing: T,
    execution: &Execution,
) -> Result<()> {
    let mut old = Vec::new();
    crate::memory::replace("a moved plane", &mut old, plane.iter().copied())?;
    nearest((&old, size), map, (plane, size), missing, execution)
}

/// Rows of the model that one band owns.
struct Part<'a> {
    samples: Vec<&'a mut [i16]>,
    known: &'a mut [u8],
    age: &'a mut [u8],
    median: &'a mut [f32],
    deviation: &'a mut [f32],
    width: usize,
}

impl SplitRows for Part<'_> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let at = row * self.width;
        let (mut above, mut below) = (Vec::with_capacity(SAMPLES), Vec::with_capacity(SAMPLES));
        for plane in self.samples {
            let (a, b) = plane.split_at_mut(at);
            above.push(a);
            below.push(b);
        }
        let (known, age) = (self.known.split_at_mut(at), self.age.split_at_mut(at));
        let (median, deviation) = (
            self.median.split_at_mut(at),
            self.deviation.split_at_mut(at),
        );
        let width = self.width;
        (
            Self {
                samples: above,
                known: known.0,
                age: age.0,
                median: median.0,
                deviation: deviation.0,
                width,
            },
            Self {
                samples: below,
                known: known.1,
                age: age.1,
                median: median.1,
                deviation: deviation.1,
                width,
            },
        )
    }
}

impl Part<'_> {
    fn learn_row(
        &mut self,
        local: usize,
        picture: &[f32],
        [seen, away, adopt]: [&[u8]; 3],
        (frame, y): (u64, usize),
    ) {
        let start = local * self.width;
        for (block, pixels) in picture.chunks(RATE).enumerate() {
            let first = block * RATE;
            let random = hashed(frame, y as u64, block as u64);
            let chosen = (random % RATE as u64) as usize;
            let slot = (random >> 32) as usize % SAMPLES;
            if self.all_old(start, first, [seen, away, adopt]) {
                let at = start + first + chosen;
                self.samples[slot][at] = one_sample_of(pixels[chosen]);
                for age in &mut self.age[start + first..][..RATE] {
                    *age = age.saturating_add(1);
                }
                continue;
            }
            for (k, value) in pixels.iter().enumerate() {
                let x = first + k;
                if seen[x] == 0 || (away[x] == 1 && adopt[x] == 0) {
                    continue;
                }
                let at = start + x;
                let sample = one_sample_of(*value);
                if self.known[at] == 0 || adopt[x] == 1 {
                    for plane in &mut self.samples {
                        plane[at] = sample;
                    }
                    self.known[at] = 1;
                    self.age[at] = 1;
                    continue;
                }
                let age = self.age[at];
                if age < OLD {
                    let age = usize::from(age);
                    self.samples[age % SAMPLES][at] = sample;
                    self.samples[(age + SAMPLES / 2) % SAMPLES][at] = sample;
                } else if k == chosen {
                    self.samples[slot][at] = sample;
                }
                self.age[at] = age.saturating_add(1);
            }
        }
    }

    /// Whether a whole block of pixels is seen, shows the background, and has samples of its own alone.
    #[inline(always)]
    fn all_old(&self, start: usize, first: usize, [seen, away, adopt]: [&[u8]; 3]) -> bool {
        let block = |bytes: &[u8], at: usize| {
            let bytes = bytes.get(at..).and_then(|rest| rest.first_chunk::<RATE>());
            bytes.map_or(0, |bytes| u64::from_le_bytes(*bytes))
        };
        const ONES: u64 = u64::from_le_bytes([1; RATE]);
        // Of a byte from 16 on one of the upper four bits is set.
        const UPPER: u64 = u64::from_le_bytes([0xf0; RATE]);
        let old = block(self.age, start + first) & UPPER;
        let old = (old >> 4) | (old >> 5) | (old >> 6) | (old >> 7);
        let shown = block(seen, first) & !block(away, first) & !block(adopt, first);
        shown & block(self.known, start + first) & old & ONES == ONES
    }

    fn refresh_row(&mut self, local: usize, all: bool, level: crate::SimdLevel) {
        let start = local * self.width;
        let mut x = 0;
        while x < self.width {
            let end = (x + BLOCK).min(self.width);
            let place = start + x..start + end;
            let young = || {
                let ages = self.age[place.clone()].iter();
                ages.fold(false, |any, age| any | ((*age > 0) & (*age <= OLD + 2)))
            };
            if all || young() {
                let mut block = [[0i16; BLOCK]; SAMPLES];
                for (to, plane) in block.iter_mut().zip(&self.samples) {
                    to[..end - x].copy_from_slice(&plane[place.clone()]);
                }
                let refresh = Refresh {
                    block: &mut block,
                    median: &mut self.median[place.clone()],
                    deviation: &mut self.deviation[place],
                };
                dispatch(level, refresh);
            }
            x = end;
        }
    }
}

/// A number that looks random; of the frame, the row and the block alone.
fn hashed(frame: u64, y: u64, block: u64) -> u64 {
    let mut z = frame
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(y.wrapping_mul(0xd1b5_4a32_d192_ed03))
        .wrapping_add(block.wrapping_mul(0x8cb9_2ba7_2f3d_8dd7));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests;
