//! From the sums of the tiles to one displacement: light is eliminated within each tile, then the tiles are combined,
//! each weighted by the inverse of its own residual variance.

#![allow(clippy::needless_range_loop, reason = "matrix and filter indices")]

use crate::illumination::Illumination;

/// What is summed: gradients, the light's regressors, and the difference.
pub(super) const GX: usize = 0;
pub(super) const GY: usize = 1;
pub(super) const ONE: usize = 2;
pub(super) const X: usize = 3;
pub(super) const Y: usize = 4;
pub(super) const MEAN: usize = 5;
pub(super) const DIFFERENCE: usize = 6;
pub(super) const FEATURES: usize = 7;

/// The sums of products of all features over one tile.
pub(super) type Gram = [[f64; FEATURES]; FEATURES];

/// What the tiles together say at one displacement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solution {
    /// The correction of the displacement.
    pub(super) step: [f64; 2],
    /// Covariance of the displacement.
    pub(super) covariance: [[f64; 2]; 2],
    /// The gradients' information that noise does not explain, divided by the noise: eigenvalues, the smaller first.
    pub(super) information: [f64; 2],
    /// Correlation of the two frames once light is taken out.
    pub(super) correlation: f64,
    /// Root mean square of what light and motion leave, in grey levels.
    pub(super) residual: f64,
    /// Symmetric gain and offset: `next - prev = alpha (prev + next) / 2 + beta`.
    pub(super) alpha: f64,
    pub(super) beta: f64,
}

/// What the filters do to white noise of unit variance in each frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoiseGain {
    /// Variance of the interpolated frame.
    pub(super) sampled: f64,
    /// Variance of its gradient, along x and along y.
    pub(super) gradient: [f64; 2],
}

/// Take `pivot` out of all other features of `gram`; `size` is its sum before anything was taken out.
fn eliminate(gram: &mut Gram, pivot: usize, size: f64) -> bool {
    let diagonal = gram[pivot][pivot];
    // Below this share the feature is a combination of those before it, up to rounding.
    if diagonal <= 1e-9 * size || diagonal <= 0.0 {
        return false;
    }
    let row = gram[pivot];
    for i in 0..FEATURES {
        let factor = row[i] / diagonal;
        if factor != 0.0 {
            for j in 0..FEATURES {
                gram[i][j] -= factor * row[j];
            }
        }
    }
    true
}

struct Tile {
    gradient: [[f64; 2]; 2],
    difference: [f64; 2],
    count: f64,
    degrees: f64,
    texture: f64,
    residual: f64,
    variance: f64,
}

fn reduce(mut gram: Gram, illumination: Illumination) -> Option<Tile> {
    let count = gram[ONE][ONE];
    let mut degrees = count - 2.0;
    let sizes: [f64; FEATURES] = std::array::from_fn(|i| gram[i][i]);
    let mut detrended = gram;
    for pivot in [ONE, X, Y] {
        eliminate(&mut detrended, pivot, sizes[pivot]);
    }
    let pivots: &[usize] = match illumination {
        Illumination::None => &[],
        Illumination::Offset => &[ONE, X, Y],
        Illumination::GainOffset => &[ONE, X, Y, MEAN],
    };
    for pivot in pivots {
        if eliminate(&mut gram, *pivot, sizes[*pivot]) {
            degrees -= 1.0;
        }
    }
    if degrees < 4.0 {
        return None;
    }
    let residual = gram[DIFFERENCE][DIFFERENCE].max(0.0);
    Some(Tile {
        gradient: [[gram[GX][GX], gram[GX][GY]], [gram[GY][GX], gram[GY][GY]]],
        difference: [gram[GX][DIFFERENCE], gram[GY][DIFFERENCE]],
        count,
        degrees,
        texture: detrended[MEAN][MEAN].max(0.0),
        residual,
        variance: residual / degrees,
    })
}

/// The weighted combination of all tiles; `None` if no tile has enough pixels.
pub(super) fn solve(
    grams: &[Gram],
    illumination: Illumination,
    noise: NoiseGain,
) -> Option<Solution> {
    let tiles: Vec<Option<Tile>> = grams
        .iter()
        .map(|gram| reduce(*gram, illumination))
        .collect();
    let mut variances: Vec<f64> = tiles.iter().flatten().map(|tile| tile.variance).collect();
    if variances.is_empty() {
        return None;
    }
    variances.sort_by(f64::total_cmp);
    // A tile may count for at most twice a typical one: a flat one fits well without telling anything.
    let floor = (0.5 * variances[variances.len() / 2]).max(1e-12);
    let mut a = [[0.0; 2]; 2];
    let mut b = [0.0; 2];
    let mut c = [[0.0; 2]; 2];
    let (mut texture, mut residual, mut degrees) = (0.0, 0.0, 0.0);
    let mut noise_part = [0.0; 2];
    let mut light: Gram = [[0.0; FEATURES]; FEATURES];
    for (tile, gram) in tiles.iter().zip(grams) {
        let Some(tile) = tile else { continue };
        let weight = 1.0 / tile.variance.max(floor);
        let in_band = tile.variance / noise.sampled;
        for i in 0..2 {
            b[i] += weight * tile.difference[i];
            for j in 0..2 {
                a[i][j] += weight * tile.gradient[i][j];
                c[i][j] += weight * weight * in_band * tile.gradient[i][j];
            }
        }
        // The mean of two frames has a quarter of the variance of their difference.
        for axis in 0..2 {
            noise_part[axis] += weight * tile.count * in_band / 4.0 * noise.gradient[axis];
        }
        texture += weight * tile.texture;
        residual += weight * tile.residual;
        degrees += weight * tile.degrees;
        for i in [ONE, MEAN, DIFFERENCE] {
            for j in [ONE, MEAN, DIFFERENCE] {
                light[i][j] += weight * gram[i][j];
            }
        }
    }
    let (alpha, beta) = overall_light(&light, illumination);
    let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    let step = if determinant > 1e-12 * (a[0][0] + a[1][1]).powi(2) {
        [
            -(a[1][1] * b[0] - a[0][1] * b[1]) / determinant,
            -(a[0][0] * b[1] - a[1][0] * b[0]) / determinant,
        ]
    } else {
        [0.0; 2]
    };
    // Noise adds to the sums of squared gradients, and not to what they tell.
    let cross = (a[0][1] + a[1][0]) / 2.0;
    let clean = [
        [a[0][0] - noise_part[0], cross],
        [cross, a[1][1] - noise_part[1]],
    ];
    Some(Solution {
        step,
        covariance: sandwich(clean, c),
        information: eigenvalues(clean)
            .map(|value| 2.0 * value / (noise_part[0] + noise_part[1]).max(1e-12)),
        correlation: (texture - residual / 4.0) / (texture + residual / 4.0).max(1e-12),
        residual: (residual / degrees).sqrt(),
        alpha,
        beta,
    })
}

fn overall_light(light: &Gram, illumination: Illumination) -> (f64, f64) {
    let (count, mean, difference) = (light[ONE][ONE], light[ONE][MEAN], light[ONE][DIFFERENCE]);
    match illumination {
        Illumination::None => (0.0, 0.0),
        Illumination::Offset => (0.0, difference / count),
        Illumination::GainOffset => {
            let spread = light[MEAN][MEAN] - mean * mean / count;
            let alpha = if spread > 1e-9 * light[MEAN][MEAN] {
                (light[MEAN][DIFFERENCE] - mean * difference / count) / spread
            } else {
                0.0
            };
            (alpha, (difference - alpha * mean) / count)
        }
    }
}

fn sandwich(a: [[f64; 2]; 2], c: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    if determinant <= 0.0 {
        return [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]];
    }
    let inverse = [
        [a[1][1] / determinant, -a[0][1] / determinant],
        [-a[1][0] / determinant, a[0][0] / determinant],
    ];
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

/// Eigenvalues of a symmetric matrix, the smaller first.
pub(super) fn eigenvalues(matrix: [[f64; 2]; 2]) -> [f64; 2] {
    let half = (matrix[0][0] + matrix[1][1]) / 2.0;
    let radius = ((matrix[0][0] - matrix[1][1]) / 2.0).hypot(matrix[0][1]);
    [half - radius, half + radius]
}
