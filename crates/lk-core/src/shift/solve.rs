//! From the sums of the tiles to one displacement: light is eliminated within blocks of tiles, as large as one model of
//! the light fits, then the blocks are combined, each weighted by the inverse of its own residual variance.
//!
//! `docs/explanation/algorithms.md`, section "Covariance of a shift".

use super::block_sums::{BlockSums, overall_light, sandwich};
use super::blocks::{Merger, Ranked, quantile, sort_by_variance};
use super::filters::NoiseGain;
use super::gain::{MAX_GAIN, Sample, gain_field, gain_ramp, ramp_features};
use super::gram::{Block, F_GX, F_GY, F_ONE, Gram, Light, weight_of};
use super::matrix::{Matrix, eigenvalues};
use super::model::{LightScope, Model};
use super::robust_covariance::{Cell, Inflation, Pull, covariance_inflation};
use super::solution::{Others, PIXELS_PER_SAMPLE, Solution};
use super::sums::{Tile, Tiling};
use crate::error::Result;
use crate::memory::{replace, reserve, resize};

/// Sums and blocks, kept from evaluation to evaluation.
#[derive(Debug, Default)]
pub(super) struct Solver {
    /// The sums of each tile, and the tile with its light eliminated.
    pub(super) grams: Vec<(Gram, Option<Block>)>,
    /// Whether the light of each tile was eliminated.
    reduced: bool,
    /// The blocks that the window is best cut into.
    blocks: Vec<Block>,
    order: Vec<Ranked>,
    /// Which of the blocks that were tried are one, in the order in which they are tried.
    merged: Vec<bool>,
    /// The residual variance that the weights of the last solution are relative to.
    pub(super) typical: f64,
    /// The gains of the tiles.
    samples: Vec<Sample>,
    /// How tiles pull at the displacement.
    cells: Vec<Cell>,
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
            noise,
            floor,
            ..
        } = model;
        let laplacian = self.take(tiles, tiling, weighted, light, scope)?;
        let whole = if scope == LightScope::Window {
            self.one_block(tiling, light)
        } else {
            self.merge(tiling, &model, scope == LightScope::HeldTiles, true)?
        };
        if self.blocks.is_empty() {
            return Ok(None);
        }
        sort_by_variance(&self.blocks, noise, floor, &mut self.order)?;
        let typical = self.typical_variance(&model);
        self.typical = typical;
        let gradients = whole.0.of(F_GX, F_GX) + whole.0.of(F_GY, F_GY);
        let pixels = whole.0.of(F_ONE, F_ONE);
        let damping = self.damping(gradients, laplacian, pixels, noise);
        let sums = BlockSums::of(&self.blocks, tiling, &model, typical, damping);
        let (alpha, beta) = overall_light(&sums.light, light);
        let step = sums.step();
        let clean = sums.without_noise();
        let share = damping / noise.sampled;
        let inflation = self.inflation(tiling, &model, whole, step, (typical, clean, share))?;
        let excess = inflation.tiles;
        // Each block spends some on its own light.
        let light_unknowns = self.blocks.len() as f64 * light.unknowns();
        let most = pixels / PIXELS_PER_SAMPLE;
        let structure = pixels * (clean[0][0] + clean[1][1]).max(0.0)
            / (std::f64::consts::TAU * sums.texture.max(1e-12));
        let samples = most.min(structure) - light_unknowns;
        let noise_floor =
            ((sums.noise_part[0] + sums.noise_part[1]) / 2.0).max(1e-9 * sums.weights);
        Ok(Some(Solution {
            step,
            covariance: sandwich(clean, sums.meat).map(|row| row.map(|value| excess * value)),
            excess,
            parts_excess: inflation.parts,
            others: if scope == LightScope::Window {
                Others::default()
            } else {
                self.others(step, typical, floor)
            },
            information_matrix: clean,
            meat: sums.meat,
            normal: (sums.gradient, sums.difference),
            damping,
            samples,
            independent: if scope == LightScope::Window {
                samples
            } else {
                most
            },
            information: eigenvalues(clean).map(|value| value / noise_floor),
            correlation: sums.shared / sums.size.max(1e-12),
            residual: (sums.residual / sums.degrees).sqrt(),
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

    /// By how much the variance of the displacement is larger than noise explains, after a step from what is `typical` of
    /// the tiles, tells of the displacement without noise, and is the share of noise in what is left.
    fn inflation(
        &mut self,
        tiling: &Tiling,
        &Model {
            light,
            scope,
            floor,
            ..
        }: &Model,
        whole: (Gram, [f64; 2]),
        step: [f64; 2],
        (typical, clean, share): (f64, Matrix, f64),
    ) -> Result<Inflation> {
        let across = tiling.across();
        let mut cells = std::mem::take(&mut self.cells);
        let inflation = if scope == LightScope::Window {
            let pulls = self.window_pulls(tiling, light, whole, step, typical);
            covariance_inflation(pulls, across, clean, share, &mut cells)
        } else {
            let pulls = self.grams.iter().map(|(_, block)| {
                let block = block.as_ref();
                block.map_or(Pull::NONE, |block| {
                    Pull::of_block(block, step, typical, floor)
                })
            });
            covariance_inflation(pulls, across, clean, share, &mut cells)
        };
        self.cells = cells;
        inflation
    }

    /// Take the sums of the tiles, each with its light eliminated unless one holds for the window; the sum of squared
    /// Laplacians.
    fn take(
        &mut self,
        tiles: &[Tile],
        tiling: &Tiling,
        weighted: bool,
        light: Light,
        scope: LightScope,
    ) -> Result<f64> {
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
        Ok(laplacian)
    }

    /// The residual variance that weights are relative to.
    fn typical_variance(&self, model: &Model) -> f64 {
        // A flat block fits everywhere and tells nothing. The border of a shadow tells nothing either, though it is the
        // steepest that a frame shows: gradients count only where both frames are known to have them.
        if model.common_structure {
            quantile(&self.order, 0.3, |block| block.information)
        } else {
            quantile(&self.order, 0.3, |block| block.telling)
        }
        .max(model.floor)
    }

    /// What smoothness leaves of the noise: the smoothing of the frames damps noise where the gradients' energy lies in
    /// frequency, which the squared Laplacians tell.
    fn damping(&self, gradients: f64, laplacian: f64, pixels: f64, noise: NoiseGain) -> f64 {
        let variance = quantile(&self.order, 0.5, |block| block.count) / noise.sampled / 4.0;
        let clean = |sum: f64, gain: f64| (sum - pixels * variance * gain).max(0.05 * sum);
        let curvature = clean(laplacian, noise.laplacian)
            / clean(gradients, noise.gradient[0] + noise.gradient[1]).max(1e-12);
        1.0 / (1.0 + 0.5 * curvature)
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
        model: &Model,
        hold: bool,
        alike: bool,
    ) -> Result<(Gram, [f64; 2])> {
        self.blocks.clear();
        reserve("tiles", &mut self.blocks, self.grams.len())?;
        // A tree has fewer branchings than leaves.
        let hold = hold && self.merged.len() == self.grams.len();
        resize("tiles", &mut self.merged, self.grams.len(), false)?;
        let mut merger = Merger {
            grams: &self.grams,
            tiling,
            light: model.light,
            absorbed: 1.0 / model.noise.sampled,
            floor: model.floor,
            blocks: &mut self.blocks,
            merged: &mut self.merged,
            tried: 0,
            hold,
            alike,
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
    pub(super) fn is_one_light(&mut self, tiling: &Tiling, model: Model) -> Result<bool> {
        self.reduce_tiles(model.light);
        self.merge(tiling, &model, false, false)?;
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
    ) -> impl ExactSizeIterator<Item = Pull> {
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
