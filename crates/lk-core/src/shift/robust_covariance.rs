//! Whether the tiles agree with each other as well as their noise says.
//!
//! `docs/explanation/algorithms.md`, section "Covariance of a shift".

use super::gram::{Block, weight_of};
use super::matrix::{Matrix, inverse, product, quadratic};

/// What an iteration that has settled leaves of a step, in pixels.
pub(super) const SETTLED: f64 = 1e-4;

/// How one tile pulls at the displacement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pull {
    /// The sum of its gradients times what is left of its difference, by weight.
    pub(super) pull: [f64; 2],
    /// The sum of the products of its gradients.
    pub(super) gradient: Matrix,
    /// The variance of what is left, times the square of the weight.
    pub(super) variance: f64,
}

impl Pull {
    /// Of a tile with its own light, after a step.
    pub(super) fn of_block(block: &Block, step: [f64; 2], typical: f64, floor: f64) -> Self {
        let variance = block.variance().max(floor);
        let weight = weight_of(variance, typical);
        let [[xx, xy], [_, yy]] = block.gradient;
        Self {
            pull: [
                weight * (block.difference[0] + xx * step[0] + xy * step[1]),
                weight * (block.difference[1] + xy * step[0] + yy * step[1]),
            ],
            gradient: block.gradient,
            variance: weight * weight * variance,
        }
    }
}

/// By how much the variance of the displacement is larger than the noise of the pixels explains: 1 unless the tiles
/// contradict each other beyond chance, as in light or motion that no model fits, or where edges are too sharp for the
/// samples.
///
/// Each tile pulls at the solution with the sum of its gradients times what is left of its difference. That pull has a
/// variance by the noise and one by what is seen; the sums over tiles, as the displacement feels them, are compared
/// (White, "A heteroskedasticity-consistent covariance matrix estimator", 1980, with tiles as clusters).
pub(super) fn covariance_inflation(
    pulls: impl Iterator<Item = Pull>,
    information: Matrix,
    noise: f64,
) -> f64 {
    let Some(inverse) = inverse(information) else {
        return 1.0;
    };
    // The squared length of what a pull does to the displacement is pull' metric pull.
    let metric = product(inverse, inverse);
    let (mut seen, mut expected, mut squares) = (0.0, 0.0, 0.0);
    for Pull {
        pull,
        gradient,
        variance,
    } in pulls
    {
        seen += quadratic(metric, pull);
        let [[xx, xy], [_, yy]] = gradient;
        let trace = metric[0][0] * xx + 2.0 * metric[0][1] * xy + metric[1][1] * yy;
        let part = variance * noise * trace;
        expected += part;
        squares += part * part;
    }
    // What the iteration leaves is no contradiction, and without noise only rounding is seen.
    if expected <= 0.0 || seen <= SETTLED * SETTLED {
        return 1.0;
    }
    // Tiles that count, of two components each: the ratio is 1 by noise alone, give or take one over their root.
    let tiles = expected * expected / squares;
    let ratio = seen / expected;
    if ratio > 1.0 + 3.0 / tiles.sqrt() {
        ratio
    } else {
        1.0
    }
}
