//! From the sums of the tiles to one displacement: light is eliminated within blocks of tiles, as large as one model of
//! the light fits, then the blocks are combined, each weighted by the inverse of its own residual variance.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use std::ops::Range;

use super::gain::{Sample, gain_field};
use super::gram::{Block, F_GX, F_GY, F_ONE, Gram, Light};
use super::place::Place;
use super::scatter::inflation;
use super::sums::{Tile, Tiling};
use super::taps::NoiseGain;
use crate::error::Result;
use crate::memory::{replace, reserve, resize};

/// What the tiles together say at one displacement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solution {
    /// The correction of the displacement.
    pub(super) step: [f64; 2],
    /// Covariance of the displacement.
    pub(super) covariance: [[f64; 2]; 2],
    /// By how much it is larger than noise explains: 1 unless the tiles contradict each other.
    pub(super) excess: f64,
    /// What the gradients tell and noise does not explain, divided by what noise adds: eigenvalues, the smaller first.
    pub(super) information: [f64; 2],
    /// Correlation of the two frames once light is taken out.
    pub(super) correlation: f64,
    /// Root mean square of what light and motion leave, in grey levels.
    pub(super) residual: f64,
    /// Symmetric gain and offset: `next - prev = alpha (prev + next) / 2 + beta`.
    pub(super) alpha: f64,
    pub(super) beta: f64,
    /// Pixels that it rests on.
    pub(super) count: f64,
    /// Squared Laplacians over squared gradients, divided by what white noise would give; 1 where there is neither.
    pub(super) whiteness: f64,
}

impl Solution {
    /// Whether the frames agree by more than chance, taking one independent sample in nine pixels: five deviations of
    /// Fisher's transform, and not less than a correlation of 0.15.
    pub(super) fn matches(&self) -> bool {
        let chance = 5.0 / (self.count / 9.0 - 3.0).max(1.0).sqrt();
        self.correlation > chance.tanh().max(0.15)
    }

    /// Whether the frames show nothing but noise, or nothing at all.
    pub(super) fn is_noise(&self) -> bool {
        self.whiteness > 0.8
    }
}

/// Sums and blocks, kept from look to look.
#[derive(Debug, Default)]
pub(super) struct Solver {
    /// The sums of each tile, and the tile with its light eliminated.
    grams: Vec<(Gram, Option<Block>)>,
    /// The blocks that the window is best cut into.
    blocks: Vec<Block>,
    order: Vec<(f64, f64)>,
    /// Which of the blocks that were tried are one, in the order in which they are tried.
    merged: Vec<bool>,
    /// The gains of the tiles.
    samples: Vec<Sample>,
}

/// Merges blocks of tiles as long as one model of the light fits them.
struct Merger<'a> {
    grams: &'a [(Gram, Option<Block>)],
    tiling: &'a Tiling,
    light: Light,
    /// Sum of squares that one more unknown takes out of filtered white noise of unit variance.
    absorbed: f64,
    blocks: &'a mut Vec<Block>,
    /// Of the last look: see `Solver`.
    merged: &'a mut Vec<bool>,
    /// Blocks tried so far.
    tried: usize,
    /// Whether a block that was cut stays cut.
    hold: bool,
}

impl Merger<'_> {
    /// The sums over a block of tiles, about its own middle; the blocks that it is best cut into are added to `blocks`.
    fn merge(&mut self, columns: Range<usize>, rows: Range<usize>) -> (Gram, [f64; 2]) {
        if columns.len() == 1 && rows.len() == 1 {
            let (gram, block) = &self.grams[rows.start * self.tiling.across() + columns.start];
            self.blocks.extend(block);
            return (*gram, self.tiling.middle(columns.start, rows.start));
        }
        let halves = |range: &Range<usize>| {
            let middle = range.start + range.len().div_ceil(2);
            [range.start..middle, middle..range.end]
        };
        let before = self.blocks.len();
        let number = self.tried;
        self.tried += 1;
        let mut parts = [(Gram::default(), [0.0; 2]); 4];
        let mut count = 0;
        for rows in halves(&rows) {
            for columns in halves(&columns) {
                if !columns.is_empty() && !rows.is_empty() {
                    parts[count] = self.merge(columns.clone(), rows.clone());
                    count += 1;
                }
            }
        }
        let parts = &parts[..count];
        let middle: [f64; 2] = std::array::from_fn(|axis| {
            parts.iter().map(|part| part.1[axis]).sum::<f64>() / count as f64
        });
        let mut gram = Gram::default();
        for (part, at) in parts {
            gram.add(&part.moved([at[0] - middle[0], at[1] - middle[1]]));
        }
        if (!self.hold || self.merged[number])
            && let Some(merged) = gram.reduce(self.light)
            && self.fits(&merged, &self.blocks[before..])
        {
            self.blocks.truncate(before);
            self.blocks.push(merged);
            self.merged[number] = true;
        } else {
            self.merged[number] = false;
        }
        (gram, middle)
    }

    /// Whether one model explains the block as well as a model for each of its parts.
    fn fits(&self, merged: &Block, cut: &[Block]) -> bool {
        let residual: f64 = cut.iter().map(|block| block.residual).sum();
        let degrees: f64 = cut.iter().map(|block| block.degrees).sum();
        let unknowns = merged.degrees - degrees;
        if unknowns <= 0.0 {
            return true;
        }
        // Noise alone gives each unknown `absorbed` times the variance on average; three deviations above is light.
        let allowed = self.absorbed * (unknowns + 3.0 * (2.0 * unknowns).sqrt());
        merged.residual - residual <= allowed * residual / degrees
    }
}

impl Solver {
    /// The weighted combination of all tiles; `None` if no tile has enough pixels.
    pub(super) fn solve(
        &mut self,
        tiles: &[Tile],
        tiling: &Tiling,
        weighted: bool,
        light: Light,
        noise: NoiseGain,
        hold: bool,
    ) -> Result<Option<Solution>> {
        let mut laplacian = 0.0;
        let grams = tiles.iter().enumerate().map(|(index, tile)| {
            let (gram, energy) = tile.gram(index, tiling, weighted);
            laplacian += energy;
            (gram, gram.reduce(light))
        });
        replace("tiles", &mut self.grams, grams)?;
        self.blocks.clear();
        reserve("tiles", &mut self.blocks, tiles.len())?;
        // A tree has fewer branchings than leaves.
        let hold = hold && self.merged.len() == tiles.len();
        resize("tiles", &mut self.merged, tiles.len(), false)?;
        let mut merger = Merger {
            grams: &self.grams,
            tiling,
            light,
            absorbed: 1.0 / noise.sampled,
            blocks: &mut self.blocks,
            merged: &mut self.merged,
            tried: 0,
            hold,
        };
        let (whole, _) = merger.merge(0..tiling.across(), 0..tiling.down());
        if self.blocks.is_empty() {
            return Ok(None);
        }
        let blocks = &self.blocks;
        sort_by_variance(blocks, &mut self.order)?;
        let typical = quantile(&self.order, 0.3);
        let mut a = [[0.0; 2]; 2];
        let mut b = [0.0; 2];
        let mut c = [[0.0; 2]; 2];
        let (mut texture, mut residual, mut degrees, mut weights) = (0.0, 0.0, 0.0, 0.0);
        let mut noise_part = [0.0; 2];
        let mut overall = [[0.0; 3]; 3];
        // Where the gradients' energy lies in frequency: the smoothing of the frames damps noise there.
        let gradients = whole.of(F_GX, F_GX) + whole.of(F_GY, F_GY);
        let variance = quantile(&self.order, 0.5) / noise.sampled / 4.0;
        let pixels = whole.of(F_ONE, F_ONE);
        let clean = |sum: f64, gain: f64| (sum - pixels * variance * gain).max(0.05 * sum);
        let curvature = clean(laplacian, noise.laplacian)
            / clean(gradients, noise.gradient[0] + noise.gradient[1]).max(1e-12);
        let damped = 1.0 / (1.0 + 0.5 * curvature);
        for block in blocks {
            let variance = block.variance();
            let weight = weight_of(variance, typical);
            let in_band = variance.max(1e-12) / noise.sampled;
            for i in 0..2 {
                b[i] += weight * block.difference[i];
                for j in 0..2 {
                    a[i][j] += weight * block.gradient[i][j];
                    c[i][j] += weight * weight * in_band * damped * block.gradient[i][j];
                }
                // The mean of two frames has a quarter of the variance of their difference.
                noise_part[i] += weight * block.count * in_band / 4.0 * noise.gradient[i];
            }
            weights += weight * block.count;
            texture += weight * block.texture;
            residual += weight * block.residual;
            degrees += weight * block.degrees;
            for (to, from) in overall
                .iter_mut()
                .flatten()
                .zip(block.light.iter().flatten())
            {
                *to += weight * from;
            }
        }
        let (alpha, beta) = overall_light(&overall, light);
        let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
        let step = if determinant > 1e-9 * (a[0][0] + a[1][1]).powi(2) {
            [
                -(a[1][1] * b[0] - a[0][1] * b[1]) / determinant,
                -(a[0][0] * b[1] - a[1][0] * b[0]) / determinant,
            ]
        } else {
            [0.0; 2]
        };
        // Noise adds to the sums of squared gradients, and not to what they tell.
        let clean = [
            [a[0][0] - noise_part[0], a[0][1]],
            [a[1][0], a[1][1] - noise_part[1]],
        ];
        let excess = inflation(&self.grams, step, clean, typical, damped / noise.sampled);
        let floor = ((noise_part[0] + noise_part[1]) / 2.0).max(1e-9 * weights);
        Ok(Some(Solution {
            step,
            covariance: sandwich(clean, c).map(|row| row.map(|value| excess * value)),
            excess,
            information: eigenvalues(clean).map(|value| value / floor),
            correlation: (texture - residual / 4.0) / (texture + residual / 4.0).max(1e-12),
            residual: (residual / degrees).sqrt(),
            alpha,
            beta,
            count: pixels,
            whiteness: if gradients > 1e-6 * pixels {
                laplacian / gradients * (noise.gradient[0] + noise.gradient[1]) / noise.laplacian
            } else {
                1.0
            },
        }))
    }

    /// How the gain varies, from the tiles of the last solution, whose differences are rid of the field `known`.
    pub(super) fn gain_field(
        &mut self,
        tiling: &Tiling,
        light: Light,
        place: [Place; 2],
        known: [f64; 4],
    ) -> Result<[f64; 4]> {
        if light.gain {
            gain_field(&self.grams, tiling, place, known, &mut self.samples)
        } else {
            Ok([0.0; 4])
        }
    }
}

/// The residual variances in order, each with the pixels that have it.
fn sort_by_variance(blocks: &[Block], order: &mut Vec<(f64, f64)>) -> Result<()> {
    let pairs = blocks.iter().map(|block| (block.variance(), block.count));
    replace("tiles", order, pairs)?;
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    Ok(())
}

/// The residual variance below which this share of the pixels lies.
fn quantile(order: &[(f64, f64)], share: f64) -> f64 {
    let limit = share * order.iter().map(|(_, count)| count).sum::<f64>();
    let mut seen = 0.0;
    for (variance, count) in order {
        seen += count;
        if seen >= limit {
            return *variance;
        }
    }
    0.0
}

/// The weight of a block by its residual variance. One that fits better than typical counts for at most twice as much:
/// a flat one fits well and tells nothing. One that fits far worse shows the border of a shadow or a motion of its own
/// and counts for less than its variance says.
pub(super) fn weight_of(variance: f64, typical: f64) -> f64 {
    let floored = variance.max(0.5 * typical).max(1e-12);
    let outlying = (4.0 * typical.max(1e-12) / floored).min(1.0);
    outlying / floored
}

fn overall_light(sums: &[[f64; 3]; 3], light: Light) -> (f64, f64) {
    let (count, mean, difference) = (sums[0][0], sums[0][1], sums[0][2]);
    if !light.offset {
        return (0.0, 0.0);
    }
    let spread = sums[1][1] - mean * mean / count;
    let alpha = if light.gain && spread > 1e-9 * sums[1][1] {
        (sums[1][2] - mean * difference / count) / spread
    } else {
        0.0
    };
    (alpha, (difference - alpha * mean) / count)
}

/// The inverse of a symmetric matrix; `None` unless it is positive.
pub(super) fn inverse(a: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
    let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    (determinant > 0.0 && a[0][0] > 0.0).then(|| {
        [
            [a[1][1] / determinant, -a[0][1] / determinant],
            [-a[1][0] / determinant, a[0][0] / determinant],
        ]
    })
}

fn sandwich(a: [[f64; 2]; 2], c: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let Some(inverse) = inverse(a) else {
        return [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]];
    };
    let mut result = [[0.0; 2]; 2];
    for i in 0..2 {
        for j in 0..2 {
            for k in 0..2 {
                for l in 0..2 {
                    result[i][j] += inverse[i][k] * c[k][l] * inverse[j][l];
                }
            }
        }
    }
    let cross = (result[0][1] + result[1][0]) / 2.0;
    [[result[0][0], cross], [cross, result[1][1]]]
}

/// Eigenvalues of a symmetric matrix, the smaller first.
pub(super) fn eigenvalues(matrix: [[f64; 2]; 2]) -> [f64; 2] {
    let half = (matrix[0][0] + matrix[1][1]) / 2.0;
    let radius = ((matrix[0][0] - matrix[1][1]) / 2.0).hypot(matrix[0][1]);
    [half - radius, half + radius]
}
