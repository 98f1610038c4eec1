//! How the gain varies over the window and with the grey level, from the gains of the tiles.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::coordinates::WindowAxis;
use super::gram::{Block, F_MEAN, F_ONE, F_X, FEATURES, Gram};
use super::sums::Tiling;
use crate::error::Result;
use crate::memory::reserve;

/// What is not seen is held to this: in gain over the window, and in gain over [`GREY`].
const SPREAD: f64 = 0.3;
/// Grey levels, in the unit of the planes.
const GREY: f64 = 64.0;
/// A field that leaves more of the variation of the gains than this is not one: a plane leaves a quarter of a step, the
/// border of a shadow, and its slope would be taken for motion in every tile.
const FIELD_MISFIT: f64 = 0.05;
/// The constant, x, y and the grey level.
const REGRESSORS: usize = 4;

/// A gain that differs from 1 by more than this somewhere in the window is no light.
pub(super) const MAX_GAIN: f64 = 1.5;

/// The gain, less 1, that differences are already rid of: the coefficients of a field, and how the window lies in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct KnownGain {
    pub(super) field: [f64; REGRESSORS],
    pub(super) place: [WindowAxis; 2],
}

impl KnownGain {
    /// At a place in pixels from the border of the region, and at a grey level.
    pub(super) fn at(&self, pixels: [f64; 2], grey: f64) -> f64 {
        let [constant, along_x, along_y, curve] = self.field;
        let [x, y] = self.place;
        constant + along_x * x.of(pixels[0]) + along_y * y.of(pixels[1]) + curve * grey
    }
}

/// The gain of one tile.
#[derive(Debug)]
pub(super) struct Sample {
    regressors: [f64; REGRESSORS],
    gain: f64,
    weight: f64,
}

/// Fit the tiles' gains by a plane over the window, and by their grey level where the plane alone does not do. Zero if
/// the tiles are few, or if light does not follow such a field. The tiles' differences are already rid of `known`; the
/// fit is of the whole.
pub(super) fn gain_field(
    grams: &[(Gram, Option<Block>)],
    tiling: &Tiling,
    known: KnownGain,
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
            let (x, y) = (known.place[0].of(at[0]), known.place[1].of(at[1]));
            let grey = block.grey();
            samples.push(Sample {
                regressors: [1.0, x, y, grey / GREY],
                gain: block.gain + known.at(at, grey),
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
    if misfit > noise.max(FIELD_MISFIT * before) {
        return Ok([0.0; REGRESSORS]);
    }
    let is_light = samples.iter().all(|sample| {
        let gain: f64 = (0..REGRESSORS)
            .map(|i| field[i] * sample.regressors[i])
            .sum();
        gain.abs() < MAX_GAIN
    });
    if !is_light {
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

/// A gain that varies linearly over the window, and the two coefficients of that, last.
const RAMP: usize = FEATURES + 2;
/// The gain times x and times y, before the motion.
const F_GAIN_X: usize = F_MEAN + 1;
const F_GAIN_Y: usize = F_MEAN + 2;

/// The features of a window whose gain varies linearly, as combinations of those of one of its tiles.
pub(super) type RampFeatures = [[f64; FEATURES]; RAMP];

/// A tile lies `from` the middle of the window in the unit of its x and y, and at `place` in the window, of which a unit
/// is `unit`. Within a tile the slope is taken to act on the mean of the tile: exact where it is flat, and everywhere
/// once the field that is known explains the slopes.
pub(super) fn ramp_features(
    gram: &Gram,
    from: [f64; 2],
    place: [f64; 2],
    unit: [f64; 2],
) -> RampFeatures {
    let mean = gram.of(F_ONE, F_MEAN) / gram.of(F_ONE, F_ONE).max(1.0);
    let mut features = [[0.0; FEATURES]; RAMP];
    for feature in 0..FEATURES {
        let row = if feature > F_MEAN {
            feature + RAMP - FEATURES
        } else {
            feature
        };
        features[row][feature] = 1.0;
    }
    for axis in 0..2 {
        features[F_X + axis][F_ONE] = from[axis];
        features[F_GAIN_X + axis][F_MEAN] = place[axis];
        features[F_GAIN_X + axis][F_X + axis] = unit[axis] * mean;
    }
    features
}

/// The gain, less 1, in the middle of the window and its slopes along x and y, solved for together with one offset that
/// varies linearly over the window and one displacement; `None` unless the slopes explain more than noise, of which each
/// unknown takes `absorbed` times the variance. Each tile comes with its [`ramp_features`].
pub(super) fn gain_ramp(
    tiles: impl Iterator<Item = (Gram, RampFeatures)>,
    absorbed: f64,
    floor: f64,
) -> Option<[f64; 3]> {
    let mut system = [[0.0; RAMP]; RAMP];
    for (gram, features) in tiles {
        let half = features.map(|feature| -> [f64; FEATURES] {
            std::array::from_fn(|j| (0..FEATURES).map(|k| feature[k] * gram.of(k, j)).sum())
        });
        for i in 0..RAMP {
            for j in 0..RAMP {
                system[i][j] += (0..FEATURES)
                    .map(|k| half[i][k] * features[j][k])
                    .sum::<f64>();
            }
        }
    }
    let count = system[F_ONE][F_ONE];
    const DIFFERENCE: usize = RAMP - 1;
    // The slopes last, so that what they explain beyond the rest is seen.
    let order = (0..DIFFERENCE)
        .filter(|feature| ![F_GAIN_X, F_GAIN_Y].contains(feature))
        .chain([F_GAIN_X, F_GAIN_Y]);
    let sizes: [f64; RAMP] = std::array::from_fn(|i| system[i][i]);
    let mut before = 0.0;
    for pivot in order {
        if pivot == F_GAIN_X {
            before = system[DIFFERENCE][DIFFERENCE];
        }
        let row = system[pivot];
        if row[pivot] <= 1e-7 * sizes[pivot] || row[pivot] <= 0.0 {
            if pivot >= F_MEAN {
                return None;
            }
            continue;
        }
        for (index, other) in system.iter_mut().enumerate() {
            if index != pivot {
                let factor = other[pivot] / row[pivot];
                for (to, from) in other.iter_mut().zip(row) {
                    *to -= factor * from;
                }
            }
        }
    }
    let degrees = count - RAMP as f64;
    if degrees < 16.0 {
        return None;
    }
    let after = system[DIFFERENCE][DIFFERENCE].max(floor * degrees);
    // Two unknowns; three deviations above what noise alone gives them is light.
    let chance = absorbed * (2.0 + 3.0 * 2.0) * after / degrees;
    let coefficient = |feature: usize| system[feature][DIFFERENCE] / system[feature][feature];
    (before - after > chance).then(|| [F_MEAN, F_GAIN_X, F_GAIN_Y].map(coefficient))
}
