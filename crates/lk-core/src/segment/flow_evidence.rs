//! What a dense flow says of what moves: the motion that the camera's does not explain, tested against its covariance, where
//! it explains the picture better than rest does.
//!
//! Work is done on frames reduced to at most [`MOST_PIXELS`], which the caller does. False discoveries: Y. Benjamini and Y.
//! Hochberg, J. R. Stat. Soc. B 57, 1995.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::{reserve, resize};
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::simd::dispatch;

use super::box_filter::{Window, window_means};
use super::components::Runs;
use super::flow_kernels::{Frames, Relit, Scaled, Traced, Two, Verdict};
use super::flutter::Going;
use super::light::{Light, Pair};
use super::morphology::Size;
use super::regions::RegionWork;
use super::slopes::rows_around;
use super::traced;
use super::transform::{IDENTITY, inverse};

/// Larger frames are reduced.
pub(crate) const MOST_PIXELS: usize = 200_000;
/// A difference from the frame before of this many mean squares is one; a weaker one only beside it.
const STRONG_MISMATCH: f32 = 6.0;
/// Where chi-squared is so many times its threshold, a weaker difference is enough.
const SURE: f32 = 3.0;
/// Every so manyth pixel along both axes stands for the frame.
pub(super) const SAMPLED: usize = 4;
/// The noise of a camera rises at most by this factor from frame to frame.
const SPREAD_RISE: f32 = 1.1;
const DIFFERENCES: Window = Window { size: 5 };

/// The evidence, with memory that is kept.
#[derive(Debug, Default)]
pub(crate) struct FlowEvidence {
    /// 1 where something moves.
    pub(crate) moving: Vec<u8>,
    /// What the camera's motion does not explain at each pixel of the current frame, x and y.
    pub(crate) residual: Vec<f32>,
    /// 1 where that is known.
    pub(crate) known: Vec<u8>,
    /// How what moves goes where its motion explains the picture; and what it has just left.
    pub(crate) going: Vec<Going>,
    /// Standard deviation of the difference of two pictures of the same; 0 before it is known.
    pub(crate) spread: f32,
    pub(super) stood: Vec<f32>,
    pub(super) moved: Vec<f32>,
    pub(super) rest: Vec<f32>,
    pub(super) motion: Vec<f32>,
    pub(super) still: Vec<u8>,
    pub(super) was: Vec<u8>,
    pub(super) tensor: [Vec<f32>; 3],
    pub(super) certain: Vec<u8>,
    pub(super) possible: Vec<u8>,
    pub(super) seeds: Vec<u8>,
    pub(super) values: Vec<f32>,
    pub(super) light: Light,
    pub(super) regions: RegionWork,
    pub(super) patches: Runs,
    pub(super) inside: Vec<u64>,
}

impl FlowEvidence {
    /// Find what moves between two frames.
    pub(crate) fn update(&mut self, frames: &Frames<'_>, execution: &Execution) -> Result<()> {
        self.make_room(frames.size)?;
        self.trace(frames, execution)?;
        for ((still, known), kept) in self.still.iter_mut().zip(&self.known).zip(frames.kept) {
            *still = known & (1 - kept);
        }
        let pair = Pair {
            reference: &self.stood,
            image: frames.current,
            still: &self.still,
            size: frames.size,
            range: frames.range,
        };
        self.light.fit(&pair, self.spread, [1.0, 0.0], execution)?;
        self.relight(frames, execution)?;
        self.find_spread(frames)?;
        self.compare(frames, execution)?;
        self.judge(frames, execution)
    }

    fn make_room(&mut self, size: Size) -> Result<()> {
        let pixels = size.0 * size.1;
        for mask in [
            &mut self.moving,
            &mut self.known,
            &mut self.still,
            &mut self.was,
            &mut self.certain,
            &mut self.possible,
            &mut self.seeds,
        ] {
            resize("masks", mask, pixels, 0)?;
        }
        let nowhere = Going::default();
        resize("directions", &mut self.going, pixels, nowhere)?;
        resize("a residual motion", &mut self.residual, 2 * pixels, 0.0)?;
        for plane in [
            &mut self.stood,
            &mut self.moved,
            &mut self.rest,
            &mut self.motion,
        ] {
            resize("differences", plane, pixels, 0.0)?;
        }
        Ok(())
    }

    /// Where each pixel of the current frame was, and what the frame before showed there and at the place of rest.
    fn trace(&mut self, frames: &Frames<'_>, execution: &Execution) -> Result<()> {
        let (width, height) = frames.size;
        let back = inverse(frames.camera).unwrap_or(IDENTITY);
        let rests = *frames.camera == IDENTITY;
        let level = execution.simd_level();
        let outputs = Traced {
            residual: RowsMut::new(&mut self.residual, 2 * width),
            known: RowsMut::new(&mut self.known, width),
            stood: RowsMut::new(&mut self.stood, width),
            moved: RowsMut::new(&mut self.moved, width),
        };
        let rows = even_bands(execution, height, [16_384 / width, 4096 / width]);
        for_each_band(execution, height, rows, outputs, |band, mut part| {
            for (local, y) in band.enumerate() {
                let row = traced::Row {
                    frames,
                    back: &back,
                    rests,
                    y,
                    residual: part.residual.row_mut(local),
                    known: part.known.row_mut(local),
                    stood: part.stood.row_mut(local),
                    moved: part.moved.row_mut(local),
                };
                dispatch(level, row);
            }
        })
    }

    /// Turn both pictures of the frame before into their differences from the current one, in its light.
    fn relight(&mut self, frames: &Frames<'_>, execution: &Execution) -> Result<()> {
        let (width, height) = frames.size;
        let level = execution.simd_level();
        let mut gain = Vec::new();
        resize("a row of light", &mut gain, 2 * width, 0.0)?;
        let (gain, offset) = gain.split_at_mut(width);
        for y in 0..height {
            self.light.row(y, gain, offset, level);
            let row = y * width..(y + 1) * width;
            let current = &frames.current[row.clone()];
            let (stood, moved) = (&mut self.stood[row.clone()], &mut self.moved[row]);
            dispatch(
                level,
                Relit {
                    light: [gain, offset],
                    current,
                    planes: [stood, moved],
                },
            );
        }
        Ok(())
    }

    /// Two frames differ by the noise of both, and rounding is part of it. Compression leaves most pixels too quiet and a
    /// tail; noise does not jump.
    fn find_spread(&mut self, frames: &Frames<'_>) -> Result<()> {
        let width = frames.size.0;
        self.values.clear();
        let count = self.stood.len() / (SAMPLED * SAMPLED) + width;
        reserve("a sample", &mut self.values, count)?;
        for (stood, still) in self
            .stood
            .chunks_exact(width)
            .zip(self.still.chunks_exact(width))
            .step_by(SAMPLED)
        {
            let row = stood.iter().zip(still).step_by(SAMPLED);
            let values = row
                .filter(|(_, still)| **still == 1)
                .map(|(value, _)| value.abs());
            self.values.extend(values);
        }
        let before = if self.spread > 0.0 {
            self.spread * SPREAD_RISE
        } else {
            f32::INFINITY
        };
        let found = if self.values.is_empty() {
            0.0
        } else {
            (1.4826 * quantile(&mut self.values, 0.5)).max(quantile(&mut self.values, 0.9) / 1.645)
        };
        self.spread = found
            .min(before)
            .max(frames.rounding * std::f32::consts::SQRT_2);
        Ok(())
    }

    /// Means over windows of both differences, in units of what noise and a small misregistration explain.
    fn compare(&mut self, frames: &Frames<'_>, execution: &Execution) -> Result<()> {
        let width = frames.size.0;
        let level = execution.simd_level();
        let variance = self.spread * self.spread;
        let (stood, moved, counts) = (&self.stood, &self.moved, frames.counts);
        let fill = |y: usize, [rest, motion]: [&mut [f32]; 2]| {
            let rows = rows_around(frames.current, frames.size, y);
            let place = y * width..(y + 1) * width;
            let kernel = Scaled {
                rows,
                counts: &counts[place.clone()],
                differences: [&stood[place.clone()], &moved[place]],
                variance,
                to: [rest, motion],
            };
            dispatch(level, kernel);
        };
        let outputs = Two(
            RowsMut::new(&mut self.rest, width),
            RowsMut::new(&mut self.motion, width),
        );
        let emit = |local: usize, _, [rest, motion]: [&[f32]; 2], to: &mut Two<'_>| {
            to.0.row_mut(local).copy_from_slice(rest);
            to.1.row_mut(local).copy_from_slice(motion);
        };
        window_means(frames.size, DIFFERENCES, outputs, fill, emit, execution)
    }

    fn judge(&mut self, frames: &Frames<'_>, execution: &Execution) -> Result<()> {
        let least = frames.least_px * frames.least_px;
        let kernel = Verdict {
            least,
            depth: frames.parallax.is_some(),
            differences: [&self.rest, &self.motion],
            residual: &self.residual,
            known: &self.known,
            kept: frames.kept,
            to: [&mut self.seeds, &mut self.possible, &mut self.certain],
        };
        dispatch(execution.simd_level(), kernel);
        let any = self.seeds.contains(&1);
        if !any {
            self.moving.fill(0);
            self.going.fill(Going::default());
            return Ok(());
        }
        self.tensors(frames, execution)?;
        let threshold = self.threshold(frames)?;
        for k in 0..self.seeds.len() {
            if self.seeds[k] == 1 {
                let chi2 = self.chi_squared(k, frames);
                self.certain[k] |= u8::from(chi2 > threshold / 3.0);
                let strong = self.rest[k] > STRONG_MISMATCH || chi2 > SURE * threshold;
                self.seeds[k] = u8::from(chi2 > threshold && strong);
            }
        }
        self.without_uncovered(frames, execution)?;
        let masks = [&self.certain[..], &self.possible[..], &self.seeds[..]];
        self.regions
            .grow_in_hulls(masks, frames.size, &mut self.moving)?;
        // What is possible is written over.
        let motions = self.residual.as_chunks::<2>().0;
        for (k, (going, motion)) in self.going.iter_mut().zip(motions).enumerate() {
            *going = match (self.was[k], self.moving[k] & self.possible[k]) {
                (1, _) => Going::LEFT,
                (_, 1) => Going::of(motion.map(|part| part * frames.scale)),
                _ => Going::default(),
            };
        }
        self.keep_to_patches(frames.size)
    }
}

/// The value below which this share of all lies.
pub(crate) fn quantile(values: &mut [f32], share: f64) -> f32 {
    let at = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}
