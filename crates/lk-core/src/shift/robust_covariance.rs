//! Whether the tiles agree with each other as well as their noise says.
//!
//! `docs/explanation/algorithms.md`, section "Covariance of a shift".

use super::gram::{Block, weight_of};
use super::matrix::{Matrix, inverse, product, quadratic};
use crate::error::Result;
use crate::memory::replace;

/// What an iteration that has settled leaves of a step, in pixels.
pub(super) const SETTLED: f64 = 1e-4;
/// Parts along a side of the window, below which they are too few to contradict each other.
const FEWEST_PARTS: usize = 2;

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

impl Pull {
    /// A tile that tells nothing.
    pub(super) const NONE: Self = Self {
        pull: [0.0; 2],
        gradient: [[0.0; 2]; 2],
        variance: 0.0,
    };
}

/// By how much the variance of the displacement is larger than the noise of the pixels explains.
#[derive(Debug, Clone, Copy)]
pub(super) struct Inflation {
    /// Where tiles err independently of each other.
    pub(super) tiles: f64,
    /// Where parts of the window err as a whole, of the size at which they contradict each other most: as in a window that
    /// deforms, or in which there are two motions. At least that of the tiles.
    pub(super) parts: f64,
}

impl Inflation {
    const NONE: Self = Self {
        tiles: 1.0,
        parts: 1.0,
    };

    /// Of the cells of rows of `across`, whose pulls have the squared length pull' metric pull; they are used up.
    pub(super) fn of(cells: &mut Vec<Cell>, across: usize, metric: Matrix) -> Self {
        let mut size = (across.max(1), cells.len() / across.max(1));
        let tiles = ratio(cells, metric, 1.0);
        let mut parts = tiles;
        while size.0.max(size.1) > FEWEST_PARTS {
            size = halved(cells, size);
            // What is left adds up to nothing: one part in so many follows from the others.
            let count = cells.iter().filter(|cell| cell.noise > 0.0).count() as f64;
            if count < 2.0 {
                break;
            }
            parts = parts.max(ratio(cells, metric, count / (count - 1.0)));
        }
        Self { tiles, parts }
    }
}

/// What the pulls of some pixels do to the displacement, and what their noise does, in squared pixels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cell {
    pub(super) pull: [f64; 2],
    pub(super) noise: f64,
}

/// By how much the variance of the displacement is larger than the noise of the pixels explains: 1 unless the tiles, or
/// parts of the window that are made of `across` tiles a row, contradict each other beyond chance, as in light or motion
/// that no model fits, or where edges are too sharp for the samples.
///
/// Each part pulls at the solution with the sum of its gradients times what is left of its difference. That pull has a
/// variance by the noise and one by what is seen; the sums over the parts, as the displacement feels them, are compared
/// (White, "A heteroskedasticity-consistent covariance matrix estimator", 1980, with parts as clusters).
pub(super) fn covariance_inflation(
    pulls: impl ExactSizeIterator<Item = Pull>,
    across: usize,
    information: Matrix,
    noise: f64,
    cells: &mut Vec<Cell>,
) -> Result<Inflation> {
    let Some(inverse) = inverse(information) else {
        return Ok(Inflation::NONE);
    };
    // The squared length of what a pull does to the displacement is pull' metric pull.
    let metric = product(inverse, inverse);
    let felt = pulls.map(|tile| {
        let [[xx, xy], [_, yy]] = tile.gradient;
        let trace = metric[0][0] * xx + 2.0 * metric[0][1] * xy + metric[1][1] * yy;
        Cell {
            pull: tile.pull,
            noise: tile.variance * noise * trace,
        }
    });
    replace("tiles", cells, felt)?;
    Ok(Inflation::of(cells, across, metric))
}

/// What is seen over what is expected of the cells, where it is beyond chance, else 1.
fn ratio(cells: &[Cell], metric: Matrix, correction: f64) -> f64 {
    let (mut seen, mut expected, mut squares) = (0.0, 0.0, 0.0);
    for cell in cells {
        seen += quadratic(metric, cell.pull);
        expected += cell.noise;
        squares += cell.noise * cell.noise;
    }
    // What the iteration leaves is no contradiction, and without noise only rounding is seen.
    if expected <= 0.0 || seen <= SETTLED * SETTLED {
        return 1.0;
    }
    // Cells that count, of two components each: the ratio is 1 by noise alone, give or take one over their root.
    let count = expected * expected / squares;
    let ratio = correction * seen / expected;
    if ratio > 1.0 + 3.0 / count.sqrt() {
        ratio
    } else {
        1.0
    }
}

/// Four cells as one, in place; the new size.
fn halved(cells: &mut Vec<Cell>, (width, height): (usize, usize)) -> (usize, usize) {
    let (columns, rows) = (width.div_ceil(2), height.div_ceil(2));
    for y in 0..rows {
        for x in 0..columns {
            let mut sum = Cell::default();
            for row in 2 * y..(2 * y + 2).min(height) {
                for cell in &cells[row * width + 2 * x..row * width + (2 * x + 2).min(width)] {
                    sum.pull[0] += cell.pull[0];
                    sum.pull[1] += cell.pull[1];
                    sum.noise += cell.noise;
                }
            }
            // Its own four stand there or later.
            cells[y * columns + x] = sum;
        }
    }
    cells.truncate(columns * rows);
    (columns, rows)
}
