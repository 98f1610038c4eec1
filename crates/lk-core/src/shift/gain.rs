//! How the gain varies over the window and with the grey level, from the gains of the tiles.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::gram::{Block, F_MEAN, F_ONE, Gram};
use super::place::Place;
use super::sums::Tiling;

/// Fit the tiles' gains by a plane over the window, and by their grey level. Zero if the tiles are few, or if light
/// does not follow such a field.
pub(super) fn gain_field(
    grams: &[(Gram, Option<Block>)],
    tiling: &Tiling,
    place: [Place; 2],
) -> [f64; 4] {
    // In gain over the window, and in gain over 64 grey levels: what is not seen is held to this.
    const SPREAD: f64 = 0.3;
    const GREY: f64 = 64.0;
    struct Sample {
        regressors: [f64; 4],
        gain: f64,
        weight: f64,
    }
    let mut samples = Vec::with_capacity(grams.len());
    for row in 0..tiling.down() {
        for column in 0..tiling.across() {
            let (whole, Some(block)) = &grams[row * tiling.across() + column] else {
                continue;
            };
            if block.texture <= 1e-6 * whole.of(F_MEAN, F_MEAN) || block.texture <= 0.0 {
                continue;
            }
            let at = tiling.middle_pixels(column, row);
            samples.push(Sample {
                regressors: [
                    1.0,
                    place[0].of(at[0]),
                    place[1].of(at[1]),
                    whole.of(F_ONE, F_MEAN) / block.count / GREY,
                ],
                gain: block.gain,
                weight: block.texture / block.variance().max(1e-3),
            });
        }
    }
    if samples.len() < 9 {
        return [0.0; 4];
    }
    let mut system = [[0.0; 5]; 4];
    for sample in &samples {
        for i in 0..4 {
            for j in 0..4 {
                system[i][j] += sample.weight * sample.regressors[i] * sample.regressors[j];
            }
            system[i][4] += sample.weight * sample.regressors[i] * sample.gain;
        }
    }
    for i in 0..4 {
        system[i][i] += 1.0 / (SPREAD * SPREAD);
    }
    for i in 0..4 {
        // The matrix is symmetric and positive: no pivoting.
        let row = system[i];
        for (index, other) in system.iter_mut().enumerate() {
            if index != i {
                let factor = other[i] / row[i];
                for j in i..5 {
                    other[j] -= factor * row[j];
                }
            }
        }
    }
    let field: [f64; 4] = std::array::from_fn(|i| system[i][4] / system[i][i]);
    let (mut misfit, mut before) = (0.0, 0.0);
    for sample in &samples {
        let fitted: f64 = (0..4).map(|i| field[i] * sample.regressors[i]).sum();
        misfit += sample.weight * (sample.gain - fitted).powi(2);
        before += sample.weight * (sample.gain - field[0]).powi(2);
    }
    // A field that leaves most of the variation is not one: the border of a shadow, or no match at all.
    let noise = 4.0 * samples.len() as f64;
    if misfit > noise.max(0.25 * before) {
        return [0.0; 4];
    }
    [field[0], field[1], field[2], field[3] / GREY]
}
