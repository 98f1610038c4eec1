//! How the gain varies over the window and with the grey level, from the gains of the tiles.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::coordinates::WindowAxis;
use super::gram::{Block, F_MEAN, F_ONE, Gram};
use super::sums::Tiling;
use crate::error::Result;
use crate::memory::reserve;

/// What is not seen is held to this: in gain over the window, and in gain over [`GREY`].
const SPREAD: f64 = 0.3;
/// Grey levels, in the unit of the planes.
const GREY: f64 = 64.0;
/// The constant, x, y and the grey level.
const REGRESSORS: usize = 4;

/// The gain of one tile.
#[derive(Debug)]
pub(super) struct Sample {
    regressors: [f64; REGRESSORS],
    gain: f64,
    weight: f64,
}

/// Fit the tiles' gains by a plane over the window, and by their grey level where the plane alone does not do. Zero if
/// the tiles are few, or if light does not follow such a field. `known` is the field that the tiles' differences are
/// already rid of; the fit is of the whole.
pub(super) fn gain_field(
    grams: &[(Gram, Option<Block>)],
    tiling: &Tiling,
    place: [WindowAxis; 2],
    known: [f64; REGRESSORS],
    samples: &mut Vec<Sample>,
) -> Result<[f64; REGRESSORS]> {
    samples.clear();
    reserve("tiles", samples, grams.len())?;
    for row in 0..tiling.down() {
        for column in 0..tiling.across() {
            let (whole, Some(block)) = &grams[row * tiling.across() + column] else {
                continue;
            };
            if block.texture <= 1e-6 * whole.of(F_MEAN, F_MEAN) || block.texture <= 0.0 {
                continue;
            }
            let at = tiling.middle_pixels(column, row);
            let (x, y) = (place[0].of(at[0]), place[1].of(at[1]));
            let grey = whole.of(F_ONE, F_MEAN) / block.count;
            samples.push(Sample {
                regressors: [1.0, x, y, grey / GREY],
                gain: block.gain + known[0] + known[1] * x + known[2] * y + known[3] * grey,
                weight: block.texture / block.variance().max(1e-3),
            });
        }
    }
    if samples.len() < 9 {
        return Ok([0.0; REGRESSORS]);
    }
    let noise = 4.0 * samples.len() as f64;
    let [(_, before), plane, curve] = [1, 3, 4].map(|unknowns| fit(samples, unknowns));
    // Grey level and place go together in a picture of few tiles: the plane is preferred.
    let (field, misfit) = if plane.1 <= noise.max(2.0 * curve.1) {
        plane
    } else {
        curve
    };
    // A field that leaves most of the variation is not one: the border of a shadow, or no match at all.
    if misfit > noise.max(0.25 * before) {
        return Ok([0.0; REGRESSORS]);
    }
    Ok([field[0], field[1], field[2], field[3] / GREY])
}

/// The first `unknowns` coefficients, and what they leave of the gains, by weight.
fn fit(samples: &[Sample], unknowns: usize) -> ([f64; REGRESSORS], f64) {
    let mut system = [[0.0; REGRESSORS + 1]; REGRESSORS];
    for sample in samples {
        for i in 0..unknowns {
            for j in 0..unknowns {
                system[i][j] += sample.weight * sample.regressors[i] * sample.regressors[j];
            }
            system[i][REGRESSORS] += sample.weight * sample.regressors[i] * sample.gain;
        }
    }
    for i in 0..unknowns {
        system[i][i] += 1.0 / (SPREAD * SPREAD);
    }
    for i in 0..unknowns {
        // The matrix is symmetric and positive: no pivoting.
        let row = system[i];
        for (index, other) in system.iter_mut().take(unknowns).enumerate() {
            if index != i {
                let factor = other[i] / row[i];
                for j in i..=REGRESSORS {
                    other[j] -= factor * row[j];
                }
            }
        }
    }
    let field: [f64; REGRESSORS] = std::array::from_fn(|i| {
        if i < unknowns {
            system[i][REGRESSORS] / system[i][i]
        } else {
            0.0
        }
    });
    let misfit = samples
        .iter()
        .map(|sample| {
            let fitted: f64 = (0..unknowns).map(|i| field[i] * sample.regressors[i]).sum();
            sample.weight * (sample.gain - fitted).powi(2)
        })
        .sum();
    (field, misfit)
}
