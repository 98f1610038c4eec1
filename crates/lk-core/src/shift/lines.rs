//! Whether lines of pixels say against each other where an edge lies along the pixels.
//!
//! `docs/explanation/algorithms.md`, section "Covariance of a shift".

use super::gram::{Gram, Light};
use super::matrix::{Matrix, inverse, product, quadratic};
use super::model::Model;
use super::robust_covariance::SETTLED;
use super::sums::{Tile, Tiling};
use crate::error::Result;
use crate::memory::resize;
use crate::simd::EIGHT;

/// A line that holds all of what is told leaves nothing of its own error; it is taken to hold no more than this.
const MAX_LEVERAGE: f64 = 0.9;

/// How lines of pixels are compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lines {
    /// The only direction in which the displacement may move.
    pub(super) direction: Option<[f64; 2]>,
    /// What smoothness leaves of the noise.
    pub(super) damping: f64,
}

impl Lines {
    /// The covariance that lines of pixels across `axis` show and noise does not explain, `None` where noise does.
    ///
    /// Where an edge lies along the pixels all that are equally far from it have the same error of interpolation: the
    /// residual is not independent from pixel to pixel, but from line to line (White, 1980, with lines as clusters, each
    /// pull divided by what the fit leaves of it as in the jackknife of MacKinnon and White, 1985).
    pub(super) fn scatter(
        self,
        tiles: &[Tile],
        tiling: &Tiling,
        axis: usize,
        Model {
            light,
            noise,
            floor,
            ..
        }: Model,
    ) -> Result<Option<Matrix>> {
        let count = [EIGHT * tiling.across(), tiling.down()][axis];
        let mut lines: Vec<Gram> = Vec::new();
        resize("lines", &mut lines, count, Gram::default())?;
        let middle = tiling.center();
        for (index, tile) in tiles.iter().enumerate() {
            let from = tiling.from(index, middle);
            if axis == 0 {
                let first = EIGHT * (index % tiling.across());
                for lane in 0..EIGHT {
                    lines[first + lane].add(&tile.column_gram(lane).moved(from));
                }
            } else {
                let (gram, _) = tile.gram(index, tiling, true);
                lines[index / tiling.across()].add(&gram.moved(from));
            }
        }
        Ok(self.scatter_of(&lines, light, self.damping / noise.sampled, floor))
    }

    fn scatter_of(self, lines: &[Gram], light: Light, share: f64, floor: f64) -> Option<Matrix> {
        let mut whole = Gram::default();
        for line in lines {
            whole.add(line);
        }
        let block = whole.reduce(light)?;
        let projection = whole.projection(light);
        let inverse = match self.direction {
            None => inverse(block.gradient)?,
            Some(along) => {
                let information = quadratic(block.gradient, along);
                if information <= 0.0 {
                    return None;
                }
                along.map(|a| along.map(|b| a * b / information))
            }
        };
        let metric = product(inverse, inverse);
        let trace = |a: Matrix, b: Matrix| {
            let both = product(a, b);
            both[0][0] + both[1][1]
        };
        let step: [f64; 2] =
            inverse.map(|row| -(row[0] * block.difference[0] + row[1] * block.difference[1]));
        let noise = block.variance().max(floor) * share;
        let (mut seen, mut expected, mut squares) = ([[0.0; 2]; 2], 0.0, 0.0);
        for line in lines {
            let (gradient, difference) = line.left_over(&projection);
            let left = 1.0 - trace(inverse, gradient).clamp(0.0, MAX_LEVERAGE);
            let pull: [f64; 2] = std::array::from_fn(|i| {
                let [x, y] = gradient[i];
                (difference[i] + x * step[0] + y * step[1]) / left
            });
            for i in 0..2 {
                for j in 0..2 {
                    seen[i][j] += pull[i] * pull[j];
                }
            }
            let part = noise * trace(metric, gradient) / left;
            expected += part;
            squares += part * part;
        }
        let total = trace(metric, seen);
        // What the iteration leaves is no contradiction.
        if expected <= 0.0 || total <= SETTLED * SETTLED {
            return None;
        }
        let count = expected * expected / squares;
        let ratio = total / expected;
        (ratio > 1.0 + 3.0 / count.sqrt()).then(|| {
            let covariance = product(product(inverse, seen), inverse);
            covariance.map(|row| row.map(|value| value * (1.0 - 1.0 / ratio)))
        })
    }
}
