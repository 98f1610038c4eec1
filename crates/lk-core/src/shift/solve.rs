//! From the sums of the tiles to one displacement: light is eliminated within blocks of tiles, as large as one model of
//! the light fits, then the blocks are combined, each weighted by the inverse of its own residual variance.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use std::ops::Range;

use super::filters::NoiseGain;
use super::gain::{KnownGain, MAX_GAIN, Sample, gain_field, gain_ramp, ramp_features};
use super::gram::{Block, F_GX, F_GY, F_ONE, Gram, Light, weight_of};
use super::matrix::{Matrix, eigenvalues, inverse, largest_direction, quadratic};
use super::robust_covariance::{Pull, covariance_inflation};
use super::sums::{Tile, Tiling};
use crate::error::Result;
use crate::memory::{replace, reserve, resize};

/// Pixels for an independent sample, at the least: what the filters make of white noise.
const PIXELS_PER_SAMPLE: f64 = 9.0;

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
    /// What the gradients tell and noise does not explain, and the same divided by the square of the noise's part in
    /// it: the covariance is its sandwich.
    pub(super) information_matrix: Matrix,
    meat: Matrix,
    /// The normal equations, as they are solved for the step.
    normal: (Matrix, [f64; 2]),
    /// What smoothness leaves of the noise that the residual shows.
    pub(super) damping: f64,
    /// Independent samples among the pixels, from the size of their structures, less those spent on light.
    pub(super) samples: f64,
    /// The same where the frames were searched: with one light for the window, structures may be as large as that.
    independent: f64,
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
    /// The correction of the displacement if it may move along one direction only.
    pub(super) fn step_along(&self, direction: [f64; 2]) -> [f64; 2] {
        step_along(self.normal, direction)
    }

    /// The variance of the displacement along one direction, if it cannot move along others.
    pub(super) fn variance_along(&self, direction: [f64; 2]) -> f64 {
        let information = quadratic(self.information_matrix, direction);
        if information <= 0.0 {
            return f64::INFINITY;
        }
        self.excess * quadratic(self.meat, direction) / (information * information)
    }

    /// Whether the frames agree by more than chance where they were searched: by five deviations of what noise would
    /// leave, and by half of that of what structures of the size seen would, which their light may have made agree.
    pub(super) fn matches(&self) -> bool {
        exceeds_chance(self.correlation, 5.0, self.independent)
            && exceeds_chance(self.correlation, 2.5, self.samples)
    }

    /// Whether what matched where the frames were searched still does, at a finer level.
    pub(super) fn holds(&self) -> bool {
        exceeds_chance(self.correlation, 5.0, self.count / PIXELS_PER_SAMPLE)
    }

    /// The same at a finer level than that of the search, by more deviations: textures may be smoother there, and few
    /// bright things weigh more than their pixels.
    pub(super) fn matches_finely(&self) -> bool {
        exceeds_chance(self.correlation, 8.0, self.samples)
    }

    /// Whether the frames show nothing but noise, or nothing at all.
    pub(super) fn is_noise(&self) -> bool {
        self.whiteness > 0.8
    }
}

/// The step that solves the normal equations along one direction.
fn step_along((a, b): (Matrix, [f64; 2]), direction: [f64; 2]) -> [f64; 2] {
    let information = quadratic(a, direction);
    if information <= 0.0 {
        return [0.0; 2];
    }
    let length = -(b[0] * direction[0] + b[1] * direction[1]) / information;
    direction.map(|value| value * length)
}

/// Over what part of the window one model of the light holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LightScope {
    /// All of it.
    Window,
    /// Blocks of tiles, as large as the tiles allow.
    Tiles,
    /// The blocks of the last evaluation.
    HeldTiles,
}

/// What is known, or taken to be, when the sums are solved.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model {
    pub(super) light: Light,
    pub(super) scope: LightScope,
    /// Whether what either frame shows is known to be in both.
    pub(super) common_structure: bool,
    pub(super) noise: NoiseGain,
    /// The least variance of a difference: grey levels are rounded.
    pub(super) floor: f64,
    /// What the differences are rid of.
    pub(super) known: KnownGain,
}

/// Whether a correlation is above as many deviations of Fisher's transform, and above 0.15.
pub(super) fn exceeds_chance(correlation: f64, deviations: f64, samples: f64) -> bool {
    let chance = deviations / (samples - 3.0).max(1.0).sqrt();
    correlation > chance.tanh().max(0.15)
}

/// Sums and blocks, kept from evaluation to evaluation.
#[derive(Debug, Default)]
pub(super) struct Solver {
    /// The sums of each tile, and the tile with its light eliminated.
    grams: Vec<(Gram, Option<Block>)>,
    /// Whether the light of each tile was eliminated.
    reduced: bool,
    /// The blocks that the window is best cut into.
    blocks: Vec<Block>,
    order: Vec<Ranked>,
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
    /// The least variance of a difference: grey levels are rounded.
    floor: f64,
    blocks: &'a mut Vec<Block>,
    /// Of the last evaluation: see `Solver`.
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
            let middle = self.tiling.middle(columns.start, rows.start);
            let block = block.as_ref();
            self.blocks
                .extend(block.map(|block| Block { middle, ..*block }));
            return (*gram, middle);
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
            self.blocks.push(Block { middle, ..merged });
            self.merged[number] = true;
        } else {
            self.merged[number] = false;
        }
        (gram, middle)
    }

    /// Whether one model explains the block as well as a model for each of its parts.
    fn fits(&self, merged: &Block, cut: &[Block]) -> bool {
        let mut residual: f64 = cut.iter().map(|block| block.residual).sum();
        let degrees: f64 = cut.iter().map(|block| block.degrees).sum();
        let unknowns = merged.degrees - degrees;
        if unknowns <= 0.0 {
            return true;
        }
        // Noise alone gives each unknown `absorbed` times the variance on average; three deviations above is light.
        let allowed = self.absorbed * (unknowns + 3.0 * (2.0 * unknowns).sqrt());
        let more = merged.residual - residual;
        residual = residual.max(self.floor * degrees);
        more <= allowed * residual / degrees
    }
}

impl Solver {
    /// The weighted combination of all tiles; `None` if no tile has enough pixels.
    pub(super) fn solve(
        &mut self,
        tiles: &[Tile],
        tiling: &Tiling,
        weighted: bool,
        model: Model,
    ) -> Result<Option<Solution>> {
        let Model {
            light,
            scope,
            common_structure,
            noise,
            floor,
            known,
        } = model;
        let mut laplacian = 0.0;
        self.reduced = scope != LightScope::Window;
        let reduced = self.reduced;
        let grams = tiles.iter().enumerate().map(|(index, tile)| {
            let (gram, energy) = tile.gram(index, tiling, weighted);
            laplacian += energy;
            // One light for the window: that of a tile is asked for later, if at all.
            let block = reduced.then(|| gram.reduce(light));
            (gram, block.flatten())
        });
        replace("tiles", &mut self.grams, grams)?;
        self.blocks.clear();
        reserve("tiles", &mut self.blocks, tiles.len())?;
        let whole = if scope == LightScope::Window {
            self.one_block(tiling, light)
        } else {
            self.merge(tiling, light, noise, floor, scope == LightScope::HeldTiles)?
        };
        if self.blocks.is_empty() {
            return Ok(None);
        }
        let blocks = &self.blocks;
        sort_by_variance(blocks, noise, floor, &mut self.order)?;
        // A flat block fits everywhere and tells nothing. The border of a shadow tells nothing either, though it is the
        // steepest that a frame shows: gradients count only where both frames are known to have them.
        let typical = if common_structure {
            quantile(&self.order, 0.3, |block| block.information)
        } else {
            quantile(&self.order, 0.3, |block| block.telling)
        }
        .max(floor);
        let mut a = [[0.0; 2]; 2];
        let mut b = [0.0; 2];
        let mut c = [[0.0; 2]; 2];
        let (mut texture, mut residual, mut degrees, mut weights) = (0.0, 0.0, 0.0, 0.0);
        let (mut shared, mut size) = (0.0, 0.0);
        let mut noise_part = [0.0; 2];
        let mut overall = [[0.0; 3]; 3];
        // Where the gradients' energy lies in frequency: the smoothing of the frames damps noise there.
        let gradients = whole.0.of(F_GX, F_GX) + whole.0.of(F_GY, F_GY);
        let variance = quantile(&self.order, 0.5, |block| block.count) / noise.sampled / 4.0;
        let pixels = whole.0.of(F_ONE, F_ONE);
        let clean = |sum: f64, gain: f64| (sum - pixels * variance * gain).max(0.05 * sum);
        let curvature = clean(laplacian, noise.laplacian)
            / clean(gradients, noise.gradient[0] + noise.gradient[1]).max(1e-12);
        let damped = 1.0 / (1.0 + 0.5 * curvature);
        for block in blocks {
            let variance = block.variance().max(floor);
            let weight = weight_of(variance, typical);
            let in_band = variance / noise.sampled;
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
            let [block_shared, block_size] = {
                let pixels = block.middle.map(|value| value * tiling.unit());
                block.agreement(light, known.at(pixels, block.grey()))
            };
            shared += weight * block_shared;
            size += weight * block_size;
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
            // One direction only: the shortest step.
            step_along((a, b), largest_direction(a))
        };
        // Noise adds to the sums of squared gradients, and not to what they tell.
        let clean = [
            [a[0][0] - noise_part[0], a[0][1]],
            [a[1][0], a[1][1] - noise_part[1]],
        ];
        let share = damped / noise.sampled;
        let excess = if scope == LightScope::Window {
            let pulls = self.window_pulls(tiling, light, whole, step, typical);
            covariance_inflation(pulls, clean, share)
        } else {
            let tiles = self.grams.iter().filter_map(|(_, block)| block.as_ref());
            let pulls = tiles.map(|block| Pull::of_block(block, step, typical, floor));
            covariance_inflation(pulls, clean, share)
        };
        // Each block spends some on its own light.
        let light_unknowns = self.blocks.len() as f64 * light.unknowns();
        let most = pixels / PIXELS_PER_SAMPLE;
        let structure = pixels * (clean[0][0] + clean[1][1]).max(0.0)
            / (std::f64::consts::TAU * texture.max(1e-12));
        let samples = most.min(structure) - light_unknowns;
        let noise_floor = ((noise_part[0] + noise_part[1]) / 2.0).max(1e-9 * weights);
        Ok(Some(Solution {
            step,
            covariance: sandwich(clean, c).map(|row| row.map(|value| excess * value)),
            excess,
            information_matrix: clean,
            meat: c,
            normal: (a, b),
            damping: damped,
            samples,
            independent: if scope == LightScope::Window {
                samples
            } else {
                most
            },
            information: eigenvalues(clean).map(|value| value / noise_floor),
            correlation: shared / size.max(1e-12),
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

    /// How much of what the gradients tell is of tiles that show edges along the rows or along the columns: 1 where no
    /// tile shows anything else, about a quarter in textures.
    pub(super) fn aligned_share(&self) -> f64 {
        let (mut aligned, mut all) = (0.0, 0.0);
        for (gram, _) in &self.grams {
            let [x, y] = [gram.of(F_GX, F_GX), gram.of(F_GY, F_GY)];
            aligned += (x - y).abs();
            all += x + y;
        }
        aligned / f64::max(all, 1e-12)
    }

    /// The whole window as one block: the sums over it, about its middle.
    fn one_block(&mut self, tiling: &Tiling, light: Light) -> (Gram, [f64; 2]) {
        let middle = tiling.center();
        let mut gram = Gram::default();
        for (index, (tile, _)) in self.grams.iter().enumerate() {
            gram.add(&tile.moved(tiling.from(index, middle)));
        }
        self.blocks.clear();
        let block = gram.reduce(light);
        self.blocks
            .extend(block.map(|block| Block { middle, ..block }));
        (gram, middle)
    }

    /// The blocks of tiles over each of which one model of the light holds; the sums over the window.
    fn merge(
        &mut self,
        tiling: &Tiling,
        light: Light,
        noise: NoiseGain,
        floor: f64,
        hold: bool,
    ) -> Result<(Gram, [f64; 2])> {
        self.blocks.clear();
        reserve("tiles", &mut self.blocks, self.grams.len())?;
        // A tree has fewer branchings than leaves.
        let hold = hold && self.merged.len() == self.grams.len();
        resize("tiles", &mut self.merged, self.grams.len(), false)?;
        let mut merger = Merger {
            grams: &self.grams,
            tiling,
            light,
            absorbed: 1.0 / noise.sampled,
            floor,
            blocks: &mut self.blocks,
            merged: &mut self.merged,
            tried: 0,
            hold,
        };
        Ok(merger.merge(0..tiling.across(), 0..tiling.down()))
    }

    /// Eliminate the light of each tile, where that was left for later.
    fn reduce_tiles(&mut self, light: Light) {
        if !self.reduced {
            for (gram, block) in &mut self.grams {
                *block = gram.reduce(light);
            }
            self.reduced = true;
        }
    }

    /// Whether one model of the light holds for all of the window, as far as the tiles of the last evaluation tell.
    pub(super) fn is_one_light(
        &mut self,
        tiling: &Tiling,
        Model {
            light,
            noise,
            floor,
            ..
        }: Model,
    ) -> Result<bool> {
        self.reduce_tiles(light);
        self.merge(tiling, light, noise, floor, false)?;
        Ok(self.blocks.len() == 1)
    }

    /// How each tile pulls at a displacement that was found with one light for the window.
    fn window_pulls(
        &self,
        tiling: &Tiling,
        light: Light,
        (whole, middle): (Gram, [f64; 2]),
        step: [f64; 2],
        variance: f64,
    ) -> impl Iterator<Item = Pull> {
        let weight = weight_of(variance, variance);
        let projection = whole.projection(light);
        self.grams
            .iter()
            .enumerate()
            .map(move |(index, (tile, _))| {
                let tile = tile.moved(tiling.from(index, middle));
                let (gradient, difference) = tile.left_over(&projection);
                let pull: [f64; 2] = std::array::from_fn(|i| {
                    weight * (difference[i] + gradient[i][0] * step[0] + gradient[i][1] * step[1])
                });
                Pull {
                    pull,
                    gradient,
                    variance: weight * weight * variance,
                }
            })
    }

    /// How the gain varies linearly over the window, from the sums over the tiles as one system with the displacement;
    /// `None` unless that explains more than chance, with an `excess` of what is left over noise.
    pub(super) fn gain_ramp(
        &self,
        tiling: &Tiling,
        Model {
            light,
            noise,
            floor,
            known,
            ..
        }: Model,
        excess: f64,
    ) -> Option<[f64; 4]> {
        if !light.gain {
            return None;
        }
        let middle = tiling.center();
        let tiles = self.grams.iter().enumerate().map(|(index, (tile, _))| {
            let pixels = tiling.middle_pixels(index % tiling.across(), index / tiling.across());
            let at = [known.place[0].of(pixels[0]), known.place[1].of(pixels[1])];
            let unit = known.place.map(|axis| axis.step() * tiling.unit());
            let features = ramp_features(tile, tiling.from(index, middle), at, unit);
            (*tile, features)
        });
        let ramp = gain_ramp(tiles, excess / noise.sampled, floor)?;
        let [constant, along_x, along_y, curve] = known.field;
        let field = [
            constant + ramp[0],
            along_x + ramp[1],
            along_y + ramp[2],
            curve,
        ];
        let largest: f64 = field[..3].iter().map(|value| value.abs()).sum();
        (largest < MAX_GAIN).then_some(field)
    }

    /// How the gain varies, from the tiles of the last solution, whose differences are rid of `known`.
    pub(super) fn gain_field(
        &mut self,
        tiling: &Tiling,
        Model { light, known, .. }: Model,
    ) -> Result<[f64; 4]> {
        if light.gain {
            self.reduce_tiles(light);
            gain_field(&self.grams, tiling, known, &mut self.samples)
        } else {
            Ok([0.0; 4])
        }
    }
}

/// What the residual variance of a block rests on.
#[derive(Debug, Clone, Copy)]
struct Ranked {
    variance: f64,
    count: f64,
    /// Sum of squared gradients.
    information: f64,
    /// Pixels, by the share of the squared gradients that noise does not explain.
    telling: f64,
}

/// The blocks in the order of their residual variances.
fn sort_by_variance(
    blocks: &[Block],
    noise: NoiseGain,
    floor: f64,
    order: &mut Vec<Ranked>,
) -> Result<()> {
    let ranked = blocks.iter().map(|block| {
        let energy = block.gradient[0][0] + block.gradient[1][1];
        // The mean of two frames has a quarter of the variance of their difference.
        let in_band = block.variance().max(floor) / noise.sampled / 4.0;
        let of_noise = block.count * in_band * (noise.gradient[0] + noise.gradient[1]);
        Ranked {
            variance: block.variance(),
            count: block.count,
            information: energy,
            telling: block.count * (1.0 - of_noise / energy.max(1e-12)).max(0.0),
        }
    });
    replace("tiles", order, ranked)?;
    order.sort_unstable_by(|a, b| {
        (a.variance.total_cmp(&b.variance))
            .then(a.count.total_cmp(&b.count))
            .then(a.information.total_cmp(&b.information))
    });
    Ok(())
}

/// The residual variance below which this share of the blocks lies, by `weight`.
fn quantile(order: &[Ranked], share: f64, weight: impl Fn(&Ranked) -> f64) -> f64 {
    let limit = share * order.iter().map(&weight).sum::<f64>();
    let mut seen = 0.0;
    for block in order {
        seen += weight(block);
        if seen >= limit {
            return block.variance;
        }
    }
    0.0
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
