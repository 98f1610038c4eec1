//! The sums of products of the features over a cluster of pixels, and what is taken of them.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::view::FEATURES;

/// Products of two features, each pair once.
pub(super) const PRODUCTS: usize = FEATURES * (FEATURES + 1) / 2;

/// Pixels along a side of a cluster: what is left of its differences may pull together.
pub(super) const CLUSTER: usize = 8;

/// Sums of products of all features, each once, row after row from the diagonal on.
pub(super) type Sums = [f64; PRODUCTS];

/// The index of the product of two features.
pub(super) fn index(i: usize, j: usize) -> usize {
    let (i, j) = (i.min(j), i.max(j));
    i * (2 * FEATURES - i - 1) / 2 + j
}

/// A quadratic form of the features, to be taken of the sums of many clusters.
pub(super) struct Form([f64; PRODUCTS]);

impl Form {
    /// The sum of the products of two combinations of the features.
    pub(super) fn of(a: &[f64; FEATURES], b: &[f64; FEATURES]) -> Self {
        let mut weights = [0.0; PRODUCTS];
        let mut next = 0;
        for i in 0..FEATURES {
            for j in i..FEATURES {
                weights[next] = a[i] * b[j] + if i == j { 0.0 } else { a[j] * b[i] };
                next += 1;
            }
        }
        Self(weights)
    }

    #[inline]
    pub(super) fn at(&self, sums: &Sums) -> f64 {
        const LANES: usize = 6;
        const { assert!(PRODUCTS.is_multiple_of(LANES)) };
        let mut parts = [0.0; LANES];
        for at in (0..PRODUCTS).step_by(LANES) {
            for lane in 0..LANES {
                parts[lane] += self.0[at + lane] * sums[at + lane];
            }
        }
        parts.iter().sum()
    }
}
