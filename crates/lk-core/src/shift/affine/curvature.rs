//! What a displacement that varies quadratically over the window adds at its centre, from what an affine one leaves.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::sums::{Form, Sums, index};
use super::view::{FEATURES, ONE, X, Y};
use crate::shift::matrix::{Matrix, inverse, quadratic};

/// One, x, y, xx, xy, yy, along each axis.
const PLACES: usize = 6;
const UNKNOWNS: usize = 2 * PLACES;
/// Above this square of its length in deviations, one in a hundred by chance, the curvature is one, and is corrected;
/// above the second, one in seven, it may be one, and counts as an error.
const SIGNIFICANT: f64 = 9.2;
const SUSPECTED: f64 = 4.0;
/// Fewer parts of the window than this tell nothing.
const MIN_CLUSTERS: usize = 2 * PLACES;

/// The correction of the displacement of the centre, and the variance that it adds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    pub(super) displacement: [f64; 2],
    pub(super) covariance: Matrix,
}

/// What each part of the window would move by to fit better, `gradients` and `rest` being what motion and light leave of
/// the gradients and of the difference as combinations of all features, is fitted by a quadratic of its place. `None`
/// unless that differs from zero at the centre by more than `noise`, the variance of the difference, lets expect; `known`
/// is the covariance of the displacement by that noise alone.
pub(super) fn correction(
    clusters: &[Sums],
    gradients: [&[f64; FEATURES]; 2],
    rest: &[f64; FEATURES],
    noise: f64,
    known: Matrix,
) -> Option<Correction> {
    let (mut system, right, telling) = normal_equations(clusters, gradients, rest);
    if telling < MIN_CLUSTERS {
        return None;
    }
    // Two more columns: those of the inverse that belong to the centre.
    system[0][UNKNOWNS] = 1.0;
    system[PLACES][UNKNOWNS + 1] = 1.0;
    let sizes: [f64; UNKNOWNS] = std::array::from_fn(|i| system[i][i]);
    for pivot in 0..UNKNOWNS {
        let row = system[pivot];
        if row[pivot] <= 1e-6 * sizes[pivot] || row[pivot] <= 0.0 {
            return None;
        }
        for (i, other) in system.iter_mut().enumerate() {
            if i != pivot {
                let factor = other[pivot] / row[pivot];
                for (to, from) in other.iter_mut().zip(row) {
                    *to -= factor * from;
                }
            }
        }
    }
    // Column `axis` of the inverse, which is symmetric: what each pull does to the displacement of the centre.
    let column = |axis: usize, i: usize| system[i][UNKNOWNS + axis] / system[i][i];
    let displacement = [0, 1].map(|axis| {
        (0..UNKNOWNS)
            .map(|i| column(axis, i) * right[i])
            .sum::<f64>()
    });
    let covariance: Matrix = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let both = (column(i, PLACES * j) + column(j, PLACES * i)) / 2.0;
            noise * both - known[i][j]
        })
    });
    let distance = quadratic(inverse(covariance)?, displacement);
    if distance > SIGNIFICANT {
        return Some(Correction {
            displacement,
            covariance,
        });
    }
    (distance > SUSPECTED).then(|| Correction {
        displacement: [0.0; 2],
        covariance: displacement.map(|a| displacement.map(|b| a * b)),
    })
}

/// The normal equations of a displacement that varies quadratically, with room for two more columns, their right side,
/// and the clusters that tell something.
fn normal_equations(
    clusters: &[Sums],
    gradients: [&[f64; FEATURES]; 2],
    rest: &[f64; FEATURES],
) -> ([[f64; UNKNOWNS + 2]; UNKNOWNS], [f64; UNKNOWNS], usize) {
    let mut system = [[0.0; UNKNOWNS + 2]; UNKNOWNS];
    let mut right = [0.0; UNKNOWNS];
    let mut telling = 0;
    let pulls = [0, 1].map(|i| Form::of(gradients[i], rest));
    let informations = [0, 1].map(|i| [0, 1].map(|j| Form::of(gradients[i], gradients[j])));
    for cluster in clusters {
        let count = cluster[index(ONE, ONE)];
        if count <= 0.0 {
            continue;
        }
        telling += 1;
        let [x, y] = [X, Y].map(|axis| cluster[index(ONE, axis)] / count);
        let place = [1.0, x, y, x * x, x * y, y * y];
        for i in 0..2 {
            let pull = pulls[i].at(cluster);
            for p in 0..PLACES {
                right[PLACES * i + p] -= place[p] * pull;
            }
            for j in 0..2 {
                let information = informations[i][j].at(cluster);
                for p in 0..PLACES {
                    for q in 0..PLACES {
                        system[PLACES * i + p][PLACES * j + q] += information * place[p] * place[q];
                    }
                }
            }
        }
    }
    (system, right, telling)
}
