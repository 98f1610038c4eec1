//! The normal equations of one block of pixels: sums of products of all features, and what is left of them once light
//! is eliminated.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use crate::illumination::Illumination;

/// Features: the light's regressors first, in the order in which they are eliminated, then the gradients and the
/// difference of the frames.
pub(super) const F_ONE: usize = 0;
pub(super) const F_X: usize = 1;
pub(super) const F_Y: usize = 2;
pub(super) const F_MEAN: usize = 3;
pub(super) const F_GX: usize = 4;
pub(super) const F_GY: usize = 5;
pub(super) const F_DIFFERENCE: usize = 6;
pub(super) const FEATURES: usize = 7;

/// The sums of products of all features over some pixels; each product stands once, on or above the diagonal.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Gram(pub(super) [[f64; FEATURES]; FEATURES]);

/// Which features light takes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Light {
    /// An offset that varies linearly over the tile.
    pub(super) offset: bool,
    /// A gain.
    pub(super) gain: bool,
}

impl Light {
    pub(super) fn new(illumination: Illumination) -> Self {
        Self {
            offset: illumination != Illumination::None,
            gain: illumination == Illumination::GainOffset,
        }
    }
}

impl Light {
    /// Unknowns of a block.
    pub(super) fn unknowns(self) -> f64 {
        3.0 * f64::from(u8::from(self.offset)) + f64::from(u8::from(self.gain))
    }
}

/// A block with its light eliminated.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    pub(super) gradient: [[f64; 2]; 2],
    pub(super) difference: [f64; 2],
    pub(super) count: f64,
    pub(super) degrees: f64,
    pub(super) texture: f64,
    /// The gain, less 1, where light takes one.
    pub(super) gain: f64,
    pub(super) residual: f64,
    /// Where it lies, as its tiles do; for whoever cut the window to set.
    pub(super) middle: [f64; 2],
    /// Sums of products of one, mean and difference, before anything was eliminated.
    pub(super) light: [[f64; 3]; 3],
}

impl Block {
    pub(super) fn variance(&self) -> f64 {
        self.residual / self.degrees
    }

    /// The mean grey level.
    pub(super) fn grey(&self) -> f64 {
        self.light[0][1] / self.count
    }

    /// What the frames have in common, and the size of what they show: their quotient is the correlation. `known` is the
    /// gain, less 1, that the difference is already rid of.
    pub(super) fn agreement(&self, light: Light, known: f64) -> [f64; 2] {
        agreement(self.texture, self.gain + known, self.residual, light)
    }
}

/// The covariance of two frames, and the size of what they show, from the energy of their mean, the symmetric gain, less
/// 1, and what motion and light leave of the difference. Where light has a gain the size is the root of the product of
/// both energies: a frame that shows next to nothing beside the other is no match, though a gain explains it.
pub(super) fn agreement(texture: f64, gain: f64, residual: f64, light: Light) -> [f64; 2] {
    let difference = residual + gain * gain * texture;
    let size = texture + difference / 4.0;
    let apart = if light.gain { gain * texture } else { 0.0 };
    [
        texture - difference / 4.0,
        (size * size - apart * apart).max(0.0).sqrt(),
    ]
}

impl Gram {
    /// The sum of products of features `i` and `j`.
    pub(super) fn of(&self, i: usize, j: usize) -> f64 {
        self.0[i.min(j)][i.max(j)]
    }

    /// Add the sums of other pixels.
    pub(super) fn add(&mut self, other: &Self) {
        for i in 0..FEATURES {
            for j in i..FEATURES {
                self.0[i][j] += other.0[i][j];
            }
        }
    }

    /// The sums with x and y counted from a point `by` further back.
    pub(super) fn moved(mut self, by: [f64; 2]) -> Self {
        let [dx, dy] = by;
        let one = self.0[F_ONE];
        let g = &mut self.0;
        g[F_X][F_X] += 2.0 * dx * one[F_X] + dx * dx * one[F_ONE];
        g[F_X][F_Y] += dx * one[F_Y] + dy * one[F_X] + dx * dy * one[F_ONE];
        g[F_Y][F_Y] += 2.0 * dy * one[F_Y] + dy * dy * one[F_ONE];
        for j in F_MEAN..FEATURES {
            g[F_X][j] += dx * one[j];
            g[F_Y][j] += dy * one[j];
        }
        g[F_ONE][F_X] += dx * one[F_ONE];
        g[F_ONE][F_Y] += dy * one[F_ONE];
        self
    }

    /// Take `pivot` out of all features after it; `size` is its sum of squares before anything was taken out.
    fn eliminate(&mut self, pivot: usize, size: f64) -> bool {
        let row = self.0[pivot];
        // Below this share the feature is a combination of those before it, up to rounding.
        if row[pivot] <= 1e-7 * size || row[pivot] <= 0.0 {
            return false;
        }
        let inverse = 1.0 / row[pivot];
        for i in pivot + 1..FEATURES {
            let factor = row[i] * inverse;
            for j in i..FEATURES {
                self.0[i][j] -= factor * row[j];
            }
        }
        true
    }

    /// The block with its light eliminated; `None` if too few pixels are left over.
    pub(super) fn reduce(&self, light: Light) -> Option<Block> {
        let whole = &self.0;
        let mut left = *self;
        let count = whole[F_ONE][F_ONE];
        let mut degrees = count - 2.0;
        let mut texture =
            whole[F_MEAN][F_MEAN] - whole[F_ONE][F_MEAN] * whole[F_ONE][F_MEAN] / count;
        if light.offset {
            for pivot in [F_ONE, F_X, F_Y] {
                degrees -= f64::from(u8::from(left.eliminate(pivot, whole[pivot][pivot])));
            }
            texture = left.0[F_MEAN][F_MEAN];
        }
        let mut gain = 0.0;
        if light.gain {
            gain = left.0[F_MEAN][F_DIFFERENCE] / left.0[F_MEAN][F_MEAN].max(1e-12);
            degrees -= f64::from(u8::from(left.eliminate(F_MEAN, whole[F_MEAN][F_MEAN])));
        }
        if degrees < 4.0 {
            return None;
        }
        let left = &left.0;
        const LIGHT: [usize; 3] = [F_ONE, F_MEAN, F_DIFFERENCE];
        Some(Block {
            gradient: [
                [left[F_GX][F_GX], left[F_GX][F_GY]],
                [left[F_GX][F_GY], left[F_GY][F_GY]],
            ],
            difference: [left[F_GX][F_DIFFERENCE], left[F_GY][F_DIFFERENCE]],
            count,
            degrees,
            texture: texture.max(0.0),
            gain,
            residual: left[F_DIFFERENCE][F_DIFFERENCE].max(0.0),
            middle: [0.0; 2],
            light: LIGHT.map(|i| LIGHT.map(|j| self.of(i, j))),
        })
    }
}

/// The gradients and the difference of some pixels as combinations of the features of the light.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Projection {
    /// For the gradient along x, along y, and the difference: coefficients of one, x, y and mean.
    coefficients: [[f64; LIGHT_FEATURES]; 3],
}

/// One, x, y and the mean.
const LIGHT_FEATURES: usize = 4;

impl Gram {
    /// How the light's features explain gradients and difference.
    pub(super) fn projection(&self, light: Light) -> Projection {
        let mut left = *self;
        let mut used = [false; LIGHT_FEATURES];
        for (pivot, used) in used.iter_mut().enumerate() {
            let asked = if pivot == F_MEAN {
                light.gain
            } else {
                light.offset
            };
            *used = asked && left.eliminate(pivot, self.0[pivot][pivot]);
        }
        let mut coefficients = [[0.0; LIGHT_FEATURES]; 3];
        for (feature, row) in [F_GX, F_GY, F_DIFFERENCE]
            .into_iter()
            .zip(&mut coefficients)
        {
            for pivot in (0..LIGHT_FEATURES).rev().filter(|pivot| used[*pivot]) {
                let known: f64 = (pivot + 1..LIGHT_FEATURES)
                    .map(|other| left.0[pivot][other] * row[other])
                    .sum();
                row[pivot] = (left.0[pivot][feature] - known) / left.0[pivot][pivot];
            }
        }
        Projection { coefficients }
    }

    /// Sums of products of what a projection leaves of the gradients and of the difference: each of both gradients with
    /// both gradients, and with the difference.
    pub(super) fn left_over(&self, projection: &Projection) -> ([[f64; 2]; 2], [f64; 2]) {
        const FEATURE: [usize; 3] = [F_GX, F_GY, F_DIFFERENCE];
        let of = |i: usize, j: usize| {
            let (a, b) = (&projection.coefficients[i], &projection.coefficients[j]);
            let mut sum = self.of(FEATURE[i], FEATURE[j]);
            for k in 0..LIGHT_FEATURES {
                sum -= a[k] * self.of(k, FEATURE[j]) + b[k] * self.of(FEATURE[i], k);
                for l in 0..LIGHT_FEATURES {
                    sum += a[k] * b[l] * self.of(k, l);
                }
            }
            sum
        };
        let cross = of(0, 1);
        ([[of(0, 0), cross], [cross, of(1, 1)]], [of(0, 2), of(1, 2)])
    }
}

/// A block that leaves this many times the typical variance shows the border of a shadow or a motion of its own.
pub(super) const OUTLYING: f64 = 4.0;

/// The weight of a block by its residual variance. One that fits better than typical counts for at most twice as much:
/// a flat one fits well and tells nothing. One that fits far worse shows the border of a shadow or a motion of its own
/// and counts for less than its variance says.
pub(super) fn weight_of(variance: f64, typical: f64) -> f64 {
    let floored = variance.max(0.5 * typical).max(1e-12);
    let outlying = (OUTLYING * typical.max(1e-12) / floored).min(1.0);
    outlying / floored
}
