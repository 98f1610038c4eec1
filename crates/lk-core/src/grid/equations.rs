//! The normal equations of a window: u and v of each monomial, then the light.

use super::cholesky::{Factor, MOST, Matrix};
use super::kernels::Sums;
use super::shape::{PRODUCTS, TERMS, monomials, product};
use crate::illumination::Illumination;

/// The normal equations of a window.
pub(super) struct Equations {
    /// The sum of all weights.
    pub(super) weight: f64,
    pub(super) factor: Factor,
    pub(super) lights: usize,
}

/// The columns of the light that are unknown.
pub(super) fn light_columns(illumination: Illumination) -> &'static [usize] {
    match illumination {
        Illumination::None => &[],
        Illumination::Offset => &[1, 2, 3],
        Illumination::GainOffset => &[0, 1, 2, 3],
    }
}

/// The matrix of the unknowns: u and v of each monomial, then light.
pub(super) fn normal_matrix(
    sums: &Sums,
    degree: usize,
    illumination: Illumination,
) -> (Matrix, usize) {
    let terms = monomials(degree);
    let mut matrix = [[0.0; MOST]; MOST];
    let mut place = [[0; TERMS]; TERMS];
    for (a, row) in place.iter_mut().enumerate() {
        for (b, at) in row.iter_mut().enumerate() {
            *at = product(a, b).min(PRODUCTS - 1);
        }
    }
    for a in 0..terms {
        for b in 0..terms {
            let [xx, xy, yy] = sums.slopes.map(|sums| sums[place[a][b]]);
            matrix[a][b] = xx;
            matrix[a][terms + b] = xy;
            matrix[terms + a][b] = xy;
            matrix[terms + a][terms + b] = yy;
        }
    }
    let columns = light_columns(illumination);
    for (i, column) in columns.iter().enumerate() {
        let row = 2 * terms + i;
        for axis in 0..2 {
            for term in 0..terms {
                matrix[row][axis * terms + term] = match column {
                    0 => sums.template[axis][term],
                    _ => sums.slope[axis][place[term][column - 1]],
                };
            }
        }
        for (j, other) in columns.iter().enumerate().take(i + 1) {
            matrix[row][2 * terms + j] = match (column, other) {
                (0, 0) => sums.square,
                (_, 0) => sums.level[column - 1],
                _ => sums.weight[place[column - 1][other - 1]],
            };
        }
    }
    (matrix, 2 * terms + columns.len())
}
