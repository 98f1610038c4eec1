//! The weighted combination of blocks: the normal equations, and what goes with them.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::gram::{Block, Light, weight_of};
use super::matrix::{Matrix, inverse, largest_direction};
use super::model::Model;
use super::solution::step_along;
use super::sums::Tiling;

/// Sums over blocks, each by the weight that its own residual variance gives it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BlockSums {
    /// Products of the gradients, and of gradient and difference: the normal equations.
    pub(super) gradient: Matrix,
    pub(super) difference: [f64; 2],
    /// The products of the gradients by the square of the weight and the variance of the noise: the sandwich's meat.
    pub(super) meat: Matrix,
    pub(super) texture: f64,
    pub(super) residual: f64,
    pub(super) degrees: f64,
    /// Pixels.
    pub(super) weights: f64,
    /// What the frames have in common, and the size of what they show; see [`Block::agreement`].
    pub(super) shared: f64,
    pub(super) size: f64,
    /// What noise adds to the squared gradients.
    pub(super) noise_part: [f64; 2],
    /// Products of one, mean and difference.
    pub(super) light: [[f64; 3]; 3],
}

impl BlockSums {
    pub(super) fn of(
        blocks: &[Block],
        tiling: &Tiling,
        model: &Model,
        typical: f64,
        damping: f64,
    ) -> Self {
        let noise = model.noise;
        let mut sums = Self::default();
        for block in blocks {
            let variance = block.variance().max(model.floor);
            let weight = weight_of(variance, typical);
            let in_band = variance / noise.sampled;
            for i in 0..2 {
                sums.difference[i] += weight * block.difference[i];
                for j in 0..2 {
                    sums.gradient[i][j] += weight * block.gradient[i][j];
                    sums.meat[i][j] += weight * weight * in_band * damping * block.gradient[i][j];
                }
                // The mean of two frames has a quarter of the variance of their difference.
                sums.noise_part[i] += weight * block.count * in_band / 4.0 * noise.gradient[i];
            }
            sums.weights += weight * block.count;
            sums.texture += weight * block.texture;
            let [shared, size] = {
                let pixels = block.middle.map(|value| value * tiling.unit());
                block.agreement(model.light, model.known.at(pixels, block.grey()))
            };
            sums.shared += weight * shared;
            sums.size += weight * size;
            sums.residual += weight * block.residual;
            sums.degrees += weight * block.degrees;
            for (to, from) in sums
                .light
                .iter_mut()
                .flatten()
                .zip(block.light.iter().flatten())
            {
                *to += weight * from;
            }
        }
        sums
    }

    /// The step that solves the normal equations; the shortest one where they have one direction only.
    pub(super) fn step(&self) -> [f64; 2] {
        let (a, b) = (self.gradient, self.difference);
        let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
        if determinant > 1e-9 * (a[0][0] + a[1][1]).powi(2) {
            [
                -(a[1][1] * b[0] - a[0][1] * b[1]) / determinant,
                -(a[0][0] * b[1] - a[1][0] * b[0]) / determinant,
            ]
        } else {
            step_along((a, b), largest_direction(a))
        }
    }

    /// What the gradients tell: noise adds to the sums of their squares, and not to that.
    pub(super) fn without_noise(&self) -> Matrix {
        let (a, noise) = (self.gradient, self.noise_part);
        [[a[0][0] - noise[0], a[0][1]], [a[1][0], a[1][1] - noise[1]]]
    }
}

/// Symmetric gain and offset of all blocks together.
pub(super) fn overall_light(sums: &[[f64; 3]; 3], light: Light) -> (f64, f64) {
    let (count, mean, difference) = (sums[0][0], sums[0][1], sums[0][2]);
    if !light.offset {
        return (0.0, 0.0);
    }
    let contrast = sums[1][1] - mean * mean / count;
    let alpha = if light.gain && contrast > 1e-9 * sums[1][1] {
        (sums[1][2] - mean * difference / count) / contrast
    } else {
        0.0
    };
    (alpha, (difference - alpha * mean) / count)
}

/// The inverse of `a`, times `c`, times the inverse again; infinite where there is none.
pub(super) fn sandwich(a: [[f64; 2]; 2], c: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
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
