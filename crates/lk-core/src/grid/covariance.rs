//! The covariance of a window's motion, from what its tiles pull (a sandwich).
//!
//! H. White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 1980; W. Newey and K. West, "A
//! simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix", 1987, with tiles
//! in the place of times. It holds for robust weights too, for it looks at what each pixel does pull.

use super::fit::{Fitted, Fitting};
use super::kernels::{LIGHT, TilePulls};
use super::shape::{TERMS, monomials};
use super::window::Window;
use crate::error::Result;
use crate::memory::resize;
use crate::simd::{LANES, dispatch};

/// What memory for tiles holds.
const TILES: &str = "tiles";

/// What a covariance is of: u and its derivatives along x and y, v and its own, per half window.
pub(super) const MOTION: usize = 6;

/// A covariance of motion.
pub(super) type Covariance = [[f64; MOTION]; MOTION];

/// What a tile pulls.
pub(super) type TilePull = [f64; 2 * TERMS + LIGHT];

impl Fitting<'_> {
    /// The covariance of the motion that `fitted` gives of `window`; `pulls` is memory.
    ///
    /// # Errors
    ///
    /// Those of the memory.
    pub(super) fn covariance(
        &self,
        fitted: &Fitted,
        window: &Window,
        pulls: &mut Vec<TilePull>,
    ) -> Result<Covariance> {
        let across = self.pattern.across;
        pulls.clear();
        resize(TILES, pulls, across * across, [0.0; 2 * TERMS + LIGHT])?;
        let pattern = self.pattern;
        let tiles = &mut pulls[..];
        match self.degree {
            0 => dispatch(
                self.level,
                TilePulls::<0> {
                    pattern,
                    window,
                    pulls: tiles,
                },
            ),
            1 => dispatch(
                self.level,
                TilePulls::<1> {
                    pattern,
                    window,
                    pulls: tiles,
                },
            ),
            _ => dispatch(
                self.level,
                TilePulls::<2> {
                    pattern,
                    window,
                    pulls: tiles,
                },
            ),
        }
        let terms = monomials(self.degree);
        let motions = terms.min(MOTION / 2);
        let inverse = self.influence(fitted);
        let columns = &inverse[..2 * motions];
        for pull in pulls.iter_mut() {
            let mut moved = [0.0; 2 * TERMS + LIGHT];
            for (to, column) in moved.iter_mut().zip(columns) {
                *to = column.iter().zip(pull.iter()).map(|(a, b)| a * b).sum();
            }
            *pull = moved;
        }
        let mut sums = [[0.0; MOTION]; MOTION];
        for pull in pulls.iter() {
            for (i, sums) in sums.iter_mut().enumerate().take(2 * motions) {
                for (sum, other) in sums.iter_mut().zip(&pull[..2 * motions]) {
                    *sum += pull[i] * other;
                }
            }
        }
        // As many as the pixels that count would fill.
        let tiles = window.counted / LANES as f64;
        let spent = (2 * terms + fitted.lights) as f64;
        let scale = tiles / (tiles - spent).max(1.0);
        Ok(spread(&sums, motions, scale))
    }

    /// By how much each motion follows a unit of pull, over the columns of the pulls.
    fn influence(&self, fitted: &Fitted) -> [TilePull; MOTION] {
        let terms = monomials(self.degree);
        let motions = terms.min(MOTION / 2);
        let gradient = fitted.warp.gradient(self.pattern.half);
        let gain = fitted.light[0];
        let mut rows = [[0.0; 2 * TERMS + LIGHT]; MOTION];
        let skipped = LIGHT - fitted.lights;
        for term in 0..motions {
            let columns = [term, terms + term].map(|at| fitted.factor.inverse_column(at));
            for axis in 0..2 {
                let pairs = columns[0].iter().zip(&columns[1]);
                for (unknown, (u, v)) in pairs.enumerate().take(2 * terms + fitted.lights) {
                    let back = [*u, *v];
                    let [a, b] = gradient[axis];
                    let value = (back[axis] + a * back[0] + b * back[1]) / gain;
                    // The light's columns begin at the first that is unknown.
                    let at = if unknown < 2 * terms {
                        unknown
                    } else {
                        unknown + skipped
                    };
                    rows[axis * motions + term][at] = value;
                }
            }
        }
        rows
    }
}

/// The covariance in its place: of a translation, the derivatives have none.
fn spread(sums: &Covariance, motions: usize, scale: f64) -> Covariance {
    let mut covariance = [[0.0; MOTION]; MOTION];
    let place = |at: usize| at / motions * (MOTION / 2) + at % motions;
    for i in 0..2 * motions {
        for j in 0..2 * motions {
            covariance[place(i)][place(j)] = scale * sums[i][j];
        }
    }
    covariance
}
