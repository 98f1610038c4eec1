//! Whether a residual motion is beyond its covariance, and which patches without texture it fills.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::{reserve, resize};
use crate::parallel::RowsMut;
use crate::simd::dispatch;

use super::box_filter::window_means;
use super::flow_kernels::{Products, Three, Two};
use super::morphology::{Element, Size, dilate};
use super::slopes::rows_around;

use super::flow_evidence::{FlowEvidence, SAMPLED, quantile};
use super::flow_kernels::{Frames, TENSORS};

/// False discoveries allowed among the pixels called moving.
const FALSE_DISCOVERY: f64 = 1e-3;
/// chi-squared of two degrees of freedom: below this nothing is called moving (p = 0.001), and up to this it is looked.
const CHI2: [f32; 2] = [13.8, 120.0];
/// A motion explains the picture up to this many mean squares; one that explains it no better than by this factor does not.
const EXPLAINED: f32 = 4.0;
const UNEXPLAINED: f32 = 0.5;
/// Mean squared gradients below so many times what noise makes of them are no texture.
const PLAIN: f32 = 3.0;
/// This share of a patch without texture lies within what moves, or none of it moves.
const WITHIN: f64 = 0.6;

impl FlowEvidence {
    /// Of what was filled keep only patches without texture that lie within for the most part: the ground between two things
    /// goes on around them, the inside of a thing does not.
    pub(super) fn keep_to_patches(&mut self, size: Size) -> Result<()> {
        let plain = PLAIN * self.spread * self.spread / 2.0;
        let [xx, _, yy] = &self.tensor;
        let surely = self.certain.iter().zip(&self.seeds);
        for ((to, (certain, seed)), (xx, yy)) in
            self.still.iter_mut().zip(surely).zip(xx.iter().zip(yy))
        {
            *to = (1 - (certain | seed)) & u8::from(xx + yy < plain);
        }
        self.patches.label(&self.still, size)?;
        self.patches.sum_bytes(&self.moving, &mut self.inside)?;
        // With texture rest has to explain the picture a little worse.
        let told = self
            .certain
            .iter()
            .zip(&self.seeds)
            .zip(self.rest.iter().zip(&self.motion));
        for (to, ((certain, seed), (rest, motion))) in self.possible.iter_mut().zip(told) {
            *to = certain | seed | u8::from(*rest > 1.1 * motion + 0.2);
        }
        let (regions, inside) = (self.patches.regions(), &self.inside);
        let within = |label: usize| inside[label] as f64 > WITHIN * f64::from(regions[label].area);
        self.patches.paint(within, 1, &mut self.possible);
        for (moving, keep) in self.moving.iter_mut().zip(&self.possible) {
            *moving &= keep;
        }
        Ok(())
    }

    /// Where a thing was in the frame before and its motion does not explain what is seen, it uncovered what is behind it.
    pub(super) fn without_uncovered(
        &mut self,
        frames: &Frames<'_>,
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = frames.size;
        self.still.fill(0);
        let mut any = false;
        for y in 0..height {
            for x in 0..width {
                let at = y * width + x;
                if self.seeds[at] == 0 || self.motion[at] > EXPLAINED {
                    continue;
                }
                let [u, v] = [self.residual[2 * at], self.residual[2 * at + 1]];
                let (px, py) = (x as f32 - u + 0.5, y as f32 - v + 0.5);
                if px >= 0.0 && py >= 0.0 && px < width as f32 && py < height as f32 {
                    self.still[py as usize * width + px as usize] = 1;
                    any = true;
                }
            }
        }
        if !any {
            self.was.fill(0);
            return Ok(());
        }
        dilate(
            &self.still,
            frames.size,
            Element::Square(3),
            &mut self.was,
            execution,
        )?;
        let differences = self.rest.iter().zip(&self.motion);
        let masks = self.certain.iter_mut().zip(&mut self.was).zip(&self.seeds);
        for (((certain, was), seed), (rest, motion)) in masks.zip(differences) {
            *was &= *certain & (1 - seed) & u8::from(*motion > UNEXPLAINED * rest);
            *certain &= 1 - *was;
        }
        Ok(())
    }

    pub(super) fn tensors(&mut self, frames: &Frames<'_>, execution: &Execution) -> Result<()> {
        let (width, height) = frames.size;
        let level = execution.simd_level();
        for plane in &mut self.tensor {
            resize("structure tensors", plane, width * height, 0.0)?;
        }
        let [xx, xy, yy] = &mut self.tensor;
        let outputs = Two(RowsMut::new(xx, width), RowsMut::new(xy, width));
        let outputs = Three(outputs, RowsMut::new(yy, width));
        let fill = |y: usize, to: [&mut [f32]; 3]| {
            let rows = rows_around(frames.current, frames.size, y);
            dispatch(level, Products { rows, to });
        };
        let emit = |local: usize, _, [xx, xy, yy]: [&[f32]; 3], to: &mut Three<'_>| {
            to.0.0.row_mut(local).copy_from_slice(xx);
            to.0.1.row_mut(local).copy_from_slice(xy);
            to.1.row_mut(local).copy_from_slice(yy);
        };
        window_means(frames.size, TENSORS, outputs, fill, emit, execution)
    }

    /// Squared length of the residual motion in deviations of its own covariance: that of a least-squares displacement and
    /// the camera's. Where the picture has no texture it is small.
    pub(super) fn chi_squared(&self, at: usize, frames: &Frames<'_>) -> f32 {
        let motion = [self.residual[2 * at], self.residual[2 * at + 1]];
        self.chi_squared_of(at, motion, frames)
    }

    /// The same of another motion there.
    pub(super) fn chi_squared_of(&self, at: usize, [u, v]: [f32; 2], frames: &Frames<'_>) -> f32 {
        let count = (TENSORS.size * TENSORS.size) as f32;
        let noise = self.spread * self.spread / 2.0;
        // Noise in the gradients looks like texture: half differences have half the variance of a pixel.
        let bias = count * noise / 2.0;
        let information = 1.0 / (2.0 * noise);
        let [xx, xy, yy] = [0, 1, 2].map(|k| self.tensor[k][at] * count);
        let (xx, xy) = ((xx - bias).max(0.0) * information, xy * information);
        let yy = (yy - bias).max(0.0) * information;
        // (s I + A^-1)^-1 with information A is A (I + s A)^-1, which needs no inverse of a singular A.
        let s = (frames.sigma_px * frames.sigma_px) as f32;
        let (p, q, r) = (1.0 + s * xx, s * xy, 1.0 + s * yy);
        let determinant = (p * r - q * q).max(1e-12);
        let a = (xx * r - xy * q) / determinant;
        let b = (xy * p - xx * q) / determinant;
        let c = (yy * p - xy * q) / determinant;
        (a * u * u + 2.0 * b * u * v + c * v * v).max(0.0)
    }

    /// Above which chi-squared pixels are called moving. The null is scaled to the frame's median, so that errors larger
    /// than their covariance do not count as motion.
    pub(super) fn threshold(&mut self, frames: &Frames<'_>) -> Result<f32> {
        let width = frames.size.0;
        let mut sample = std::mem::take(&mut self.values);
        sample.clear();
        reserve("a sample", &mut sample, self.known.len())?;
        for y in (0..frames.size.1).step_by(SAMPLED) {
            let places = (y * width..(y + 1) * width).step_by(SAMPLED);
            let known = places.filter(|at| self.known[*at] == 1);
            sample.extend(known.map(|at| self.chi_squared(at, frames)));
        }
        let count = sample.len() as f64;
        // The median of chi-squared with two degrees of freedom is 2 ln 2.
        let median = if sample.is_empty() {
            0.0
        } else {
            quantile(&mut sample, 0.5)
        };
        let scale = (median / (2.0 * std::f32::consts::LN_2)).max(1.0);
        sample.clear();
        let seeds = (0..self.seeds.len()).filter(|at| self.seeds[*at] == 1);
        sample.extend(seeds.map(|at| self.chi_squared(at, frames) / scale));
        sample.sort_unstable_by(f32::total_cmp);
        let mut edge = CHI2[0];
        while edge < CHI2[1] {
            let above = sample.len() - sample.partition_point(|chi2| *chi2 < edge);
            let expected = count * (SAMPLED * SAMPLED) as f64 * (-f64::from(edge) / 2.0).exp();
            if expected <= FALSE_DISCOVERY * above.max(1) as f64 {
                break;
            }
            edge += 0.5;
        }
        self.values = sample;
        Ok(edge * scale)
    }
}
