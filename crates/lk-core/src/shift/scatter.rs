//! Whether the tiles agree with each other as well as their noise says.

use super::follow::SETTLED;
use super::gram::{Block, Gram};
use super::solve::{inverse, weight_of};

/// By how much the variance of the displacement is larger than the noise of the pixels explains: 1 unless the tiles
/// contradict each other beyond chance, as in light or motion that no model fits, or where edges are too sharp for the
/// samples.
///
/// Each tile pulls at the solution with the sum of its gradients times what is left of its difference. That pull has a
/// variance by the noise and one by what is seen; the sums over tiles, as the displacement feels them, are compared
/// (White, "A heteroskedasticity-consistent covariance matrix estimator", 1980, with tiles as clusters).
pub(super) fn inflation(
    tiles: &[(Gram, Option<Block>)],
    step: [f64; 2],
    information: [[f64; 2]; 2],
    typical: f64,
    noise: f64,
) -> f64 {
    let Some(inverse) = inverse(information) else {
        return 1.0;
    };
    // The squared length of what a pull does to the displacement is pull' metric pull.
    let metric = product(inverse, inverse);
    let (mut seen, mut expected, mut squares) = (0.0, 0.0, 0.0);
    for block in tiles.iter().filter_map(|(_, block)| block.as_ref()) {
        let weight = weight_of(block.variance(), typical);
        let [[xx, xy], [_, yy]] = block.gradient;
        let pull = [
            weight * (block.difference[0] + xx * step[0] + xy * step[1]),
            weight * (block.difference[1] + xy * step[0] + yy * step[1]),
        ];
        seen += quadratic(metric, pull);
        let trace = metric[0][0] * xx + 2.0 * metric[0][1] * xy + metric[1][1] * yy;
        let part = weight * weight * block.variance().max(1e-12) * noise * trace;
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

fn product(a: [[f64; 2]; 2], b: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
}

fn quadratic(matrix: [[f64; 2]; 2], [x, y]: [f64; 2]) -> f64 {
    matrix[0][0] * x * x + (matrix[0][1] + matrix[1][0]) * x * y + matrix[1][1] * y * y
}
