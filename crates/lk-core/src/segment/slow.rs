//! What moves too slowly for one frame to tell: its motion against the camera's, gathered over frames.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::{reserve, resize};
use crate::simd::{Kernel, Simd, dispatch};

use super::components::Runs;
use super::flow_evidence::{FlowEvidence, SAMPLED, quantile};
use super::flow_kernels::Frames;
use super::morphology::{Element, Size, dilate};
use super::placed::nearest;
use super::transform::{IDENTITY, Map, inverse};

/// How much a frame counts in a mean motion, and the variance of that against a frame's.
const FOLLOWS: f32 = 0.12;
const SHARE: f32 = FOLLOWS / (2.0 - FOLLOWS);
/// What moves further than this in a frame, in pixels, is not slow, and around it, in pixels, windows of the flow reach.
const MOST_PX: f32 = 0.7;
const AROUND: usize = 15;
/// Mean motion of so many pixels is seen; beside that, of half as many.
const LEAST_PX: f32 = 0.12;
const BESIDE: f32 = 0.5;
/// The motion of a frame goes on with it by this share, and it is this share of the mean length: what goes to and fro is not.
const ALONG: f32 = 0.4;
const STRAIGHT: f32 = 0.75;
/// No motion counts with more than this in the mean length.
const LONGEST_PX: f32 = 2.0;
/// A frame in which nothing is known leaves this share of the mean.
const UNKNOWN: f32 = 0.9;
/// chi-squared from which on it is motion, where the null is as it should be.
const CHI2: f32 = 60.0;
/// A thing ends where its flow is less than this share of its most, and has so many pixels that are sure.
const EDGE: f32 = 0.6;
const FEWEST: u64 = 20;

/// The mean motion at each pixel that flow is judged on, in pixels of it, and its mean length.
#[derive(Debug, Clone, Default)]
pub(crate) struct Slow {
    pub(crate) along: Vec<f32>,
    pub(crate) across: Vec<f32>,
    pub(crate) length: Vec<f32>,
}

/// Sums of squared differences at rest and moved, and of how many pixels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Differences {
    pub(super) rest: f32,
    pub(super) moved: f32,
    pub(super) count: f32,
}

/// Memory that is kept.
#[derive(Debug, Default)]
pub(super) struct SlowWork {
    /// 1 where something moves slowly, if anything does.
    pub(super) moving: Vec<u8>,
    pub(super) any: bool,
    pub(super) runs: Runs,
    seeds: Vec<u8>,
    possible: Vec<u8>,
    fast: Vec<u8>,
    near: Vec<u8>,
    spare: Vec<f32>,
    values: Vec<f32>,
    most: Vec<f32>,
    sums: Vec<u64>,
    /// By region and by place, for pictures of before.
    pub(super) differences: [Vec<Differences>; 2],
}

impl Slow {
    /// Nothing is known.
    pub(crate) fn reset(&mut self, size: Size) -> Result<()> {
        for plane in self.planes_mut() {
            plane.clear();
            resize("a mean motion", plane, size.0 * size.1, 0.0)?;
        }
        Ok(())
    }

    fn planes_mut(&mut self) -> [&mut Vec<f32>; 3] {
        [&mut self.along, &mut self.across, &mut self.length]
    }

    /// Take what a frame's flow says, and find what moves slowly.
    pub(super) fn update(
        &mut self,
        evidence: &mut FlowEvidence,
        frames: &Frames<'_>,
        work: &mut SlowWork,
        execution: &Execution,
    ) -> Result<()> {
        let (size, pixels) = (frames.size, frames.size.0 * frames.size.1);
        for mask in [
            &mut work.moving,
            &mut work.seeds,
            &mut work.possible,
            &mut work.fast,
            &mut work.near,
        ] {
            resize("masks", mask, pixels, 0)?;
        }
        work.any = false;
        self.carry(frames, &mut work.spare, execution)?;
        let gather = Gather {
            planes: [&mut self.along, &mut self.across, &mut self.length],
            residual: &evidence.residual,
            known: &evidence.known,
            share: 1.0 / frames.scale,
            to: [&mut work.seeds, &mut work.possible, &mut work.fast],
        };
        let [any, fast] = dispatch(execution.simd_level(), gather);
        if any == 0 || frames.parallax.is_some() {
            return Ok(());
        }
        if fast == 1 {
            let around = Element::Square(AROUND);
            dilate(&work.fast, size, around, &mut work.near, execution)?;
            let masks = work.seeds.iter_mut().zip(&mut work.possible);
            for ((seed, possible), near) in masks.zip(&work.near) {
                *seed &= 1 - near;
                *possible &= 1 - near;
            }
        }
        if work.seeds.contains(&1) {
            evidence.tensors(frames, execution)?;
            self.keep_significant(evidence, frames, work)?;
            self.grow(size, work)?;
        }
        Ok(())
    }

    /// Take along what was gathered with the camera.
    fn carry(
        &mut self,
        frames: &Frames<'_>,
        spare: &mut Vec<f32>,
        execution: &Execution,
    ) -> Result<()> {
        if *frames.camera == IDENTITY {
            return Ok(());
        }
        let size = frames.size;
        let back: Map = inverse(frames.camera).unwrap_or(IDENTITY);
        resize("a mean motion", spare, size.0 * size.1, 0.0)?;
        for plane in self.planes_mut() {
            nearest((plane, size), &back, (spare, size), 0.0, execution)?;
            std::mem::swap(plane, spare);
        }
        Ok(())
    }

    /// The mean motion at a place.
    pub(super) fn at(&self, at: usize) -> [f32; 2] {
        [self.along[at], self.across[at]]
    }

    fn square(&self, at: usize) -> f32 {
        self.along[at] * self.along[at] + self.across[at] * self.across[at]
    }

    /// Of the seeds keep those whose mean motion its covariance does not explain; the null is scaled as for a frame.
    fn keep_significant(
        &self,
        evidence: &FlowEvidence,
        frames: &Frames<'_>,
        work: &mut SlowWork,
    ) -> Result<()> {
        let (width, height) = frames.size;
        let chi2 = |at: usize| evidence.chi_squared_of(at, self.at(at), frames) / SHARE;
        work.values.clear();
        let count = width.div_ceil(SAMPLED) * height.div_ceil(SAMPLED);
        reserve("a sample", &mut work.values, count)?;
        for y in (0..height).step_by(SAMPLED) {
            let places = (y * width..(y + 1) * width).step_by(SAMPLED);
            let known = places.filter(|at| evidence.known[*at] == 1);
            work.values.extend(known.map(chi2));
        }
        let median = if work.values.is_empty() {
            0.0
        } else {
            quantile(&mut work.values, 0.5)
        };
        // The median of chi-squared with two degrees of freedom is 2 ln 2.
        let threshold = CHI2 * (median / (2.0 * std::f32::consts::LN_2)).max(1.0);
        for (at, seed) in work.seeds.iter_mut().enumerate() {
            if *seed == 1 {
                *seed = u8::from(chi2(at) > threshold);
            }
        }
        Ok(())
    }

    /// Grow the seeds; flow reaches over the edge of a thing, and becomes less there.
    fn grow(&self, size: Size, work: &mut SlowWork) -> Result<()> {
        work.runs.label(&work.possible, size)?;
        work.runs.sum_bytes(&work.seeds, &mut work.sums)?;
        work.most.clear();
        let regions = work.runs.regions().len();
        resize("regions", &mut work.most, regions, 0.0)?;
        for run in work.runs.runs() {
            let most = &mut work.most[run.label as usize];
            *most = run
                .place(size.0)
                .fold(*most, |most, at| most.max(self.square(at)));
        }
        work.moving.fill(0);
        for run in work.runs.runs() {
            let label = run.label as usize;
            if work.sums[label] < FEWEST {
                continue;
            }
            work.any = true;
            for at in run.place(size.0) {
                work.moving[at] = u8::from(self.square(at) > EDGE * EDGE * work.most[label]);
            }
        }
        Ok(())
    }
}

/// What a frame adds.
struct Gather<'a> {
    planes: [&'a mut [f32]; 3],
    residual: &'a [f32],
    known: &'a [u8],
    /// A pixel of the frame in those of the flow.
    share: f32,
    /// What moves slowly, or perhaps, and what fast.
    to: [&'a mut [u8]; 3],
}

impl Kernel for Gather<'_> {
    /// Whether anything moves slowly, and whether anything fast.
    type Output = [u8; 2];

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> [u8; 2] {
        let [along, across, length] = self.planes;
        let [seeds, possible, fast] = self.to;
        let square_of = |px: f32| px * self.share * px * self.share;
        let (most, least, longest) = (
            square_of(MOST_PX),
            square_of(LEAST_PX),
            LONGEST_PX * self.share,
        );
        let means = along.iter_mut().zip(across).zip(length);
        let from = self.residual.as_chunks::<2>().0.iter().zip(self.known);
        let to = seeds.iter_mut().zip(possible).zip(fast);
        let (mut any, mut any_fast) = (0, 0);
        for ((((along, across), length), ([u, v], known)), ((seed, possible), fast)) in
            means.zip(from).zip(to)
        {
            let square = u * u + v * v;
            let slow = known & u8::from(square < most);
            *fast = known & (1 - slow);
            let (a, b) = (
                *along + FOLLOWS * (u - *along),
                *across + FOLLOWS * (v - *across),
            );
            // What is fast begins anew.
            let kept = if *known == 1 { 0.0 } else { UNKNOWN };
            let (c, d) = (kept * *along, kept * *across);
            *along = if slow == 1 { a } else { c };
            *across = if slow == 1 { b } else { d };
            let far = square.sqrt();
            let far = if far < longest { far } else { longest };
            let far = if *known == 1 { far } else { 0.0 };
            *length += FOLLOWS * (far - *length);
            let mean = *along * *along + *across * *across;
            let goes = slow
                & u8::from(mean > STRAIGHT * STRAIGHT * *length * *length)
                & u8::from(u * *along + v * *across > ALONG * mean);
            *seed = goes & u8::from(mean > least);
            *possible = goes & u8::from(mean > BESIDE * BESIDE * least);
            any |= *seed;
            any_fast |= *fast;
        }
        [any, any_fast]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a place is slow after some motions along x.
    fn slow_after(motions: impl IntoIterator<Item = f32>) -> bool {
        let mut planes = [[0.0f32; 1]; 3];
        let mut masks = [[0u8; 1]; 3];
        for u in motions {
            let [a, b, c] = &mut planes;
            let [d, e, f] = &mut masks;
            let gather = Gather {
                planes: [a, b, c],
                residual: &[u, 0.01],
                known: &[1],
                share: 1.0,
                to: [d, e, f],
            };
            dispatch(Execution::default().simd_level(), gather);
        }
        masks[0] == [1]
    }

    #[test]
    fn what_goes_on_slowly_is_told_after_some_frames() {
        assert!(!slow_after([0.25; 3]));
        assert!(slow_after([0.25; 10]));
        assert!(!slow_after([0.05; 40]));
    }

    #[test]
    fn what_goes_to_and_fro_or_fast_or_has_stopped_is_not() {
        assert!(!slow_after((0..60).map(|k| 0.4 * (0.7 * k as f32).sin())));
        assert!(!slow_after([1.5; 30]));
        assert!(!slow_after([0.25; 20].into_iter().chain([0.0; 1])));
        // What a fast thing has left.
        assert!(!slow_after([1.5; 30].into_iter().chain([0.2; 10])));
    }
}
