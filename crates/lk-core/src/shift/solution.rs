//! What the tiles of a window say at one displacement.

use super::matrix::{Matrix, quadratic};

/// Pixels for an independent sample, at the least: what the filters make of white noise.
pub(super) const PIXELS_PER_SAMPLE: f64 = 9.0;
/// The variance along each axis where most of the window does not show what the other frame does: no measurement.
const NOWHERE: f64 = 1.0;

/// What most of the window says, where it leaves far more than what the displacement rests on.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Others {
    /// How much further it would go.
    pub(super) further: [f64; 2],
    /// Whether it does not show at all what the other frame does.
    pub(super) unmatched: bool,
}

/// What the tiles together say at one displacement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solution {
    /// The correction of the displacement.
    pub(super) step: [f64; 2],
    /// Covariance of the displacement.
    pub(super) covariance: [[f64; 2]; 2],
    /// By how much it is larger than noise explains: 1 unless the tiles contradict each other.
    pub(super) excess: f64,
    /// The same where parts of the window contradict each other, as where it deforms: at least that.
    pub(super) parts_excess: f64,
    /// What most of the window says, where it leaves far more than what the displacement rests on.
    pub(super) others: Others,
    /// What the gradients tell and noise does not explain, divided by what noise adds: eigenvalues, the smaller first.
    pub(super) information: [f64; 2],
    /// What the gradients tell and noise does not explain, and the same divided by the square of the noise's part in
    /// it: the covariance is its sandwich.
    pub(super) information_matrix: Matrix,
    pub(super) meat: Matrix,
    /// The normal equations, as they are solved for the step.
    pub(super) normal: (Matrix, [f64; 2]),
    /// What smoothness leaves of the noise that the residual shows.
    pub(super) damping: f64,
    /// Independent samples among the pixels, from the size of their structures, less those spent on light.
    pub(super) samples: f64,
    /// The same where the frames were searched: with one light for the window, structures may be as large as that.
    pub(super) independent: f64,
    /// Correlation of the two frames once light is taken out.
    pub(super) correlation: f64,
    /// Root mean square of what light and motion leave, in grey levels.
    pub(super) residual: f64,
    /// Symmetric gain and offset: `next - prev = alpha (prev + next) / 2 + beta`.
    pub(super) alpha: f64,
    pub(super) beta: f64,
    /// Pixels that it rests on.
    pub(super) count: f64,
    /// Squared Laplacians over squared gradients, divided by what white noise would give; 1 where there is neither.
    pub(super) whiteness: f64,
}

impl Solution {
    /// What parts of the window that contradict each other add to the covariance of the displacement.
    pub(super) fn contradictions(&self) -> Matrix {
        let more = self.parts_excess / self.excess - 1.0;
        let Others { further, unmatched } = self.others;
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let nowhere = if unmatched && i == j { NOWHERE } else { 0.0 };
                more * self.covariance[i][j] + further[i] * further[j] + nowhere
            })
        })
    }

    /// The correction of the displacement if it may move along one direction only.
    pub(super) fn step_along(&self, direction: [f64; 2]) -> [f64; 2] {
        step_along(self.normal, direction)
    }

    /// The variance of the displacement along one direction, if it cannot move along others.
    pub(super) fn variance_along(&self, direction: [f64; 2]) -> f64 {
        let information = quadratic(self.information_matrix, direction);
        if information <= 0.0 {
            return f64::INFINITY;
        }
        self.excess * quadratic(self.meat, direction) / (information * information)
    }

    /// Whether the frames agree by more than chance where they were searched: by five deviations of what noise would
    /// leave, and by half of that of what structures of the size seen would, which their light may have made agree.
    pub(super) fn matches(&self) -> bool {
        exceeds_chance(self.correlation, 5.0, self.independent)
            && exceeds_chance(self.correlation, 2.5, self.samples)
    }

    /// Whether what matched where the frames were searched still does, at a finer level.
    pub(super) fn holds(&self) -> bool {
        exceeds_chance(self.correlation, 5.0, self.count / PIXELS_PER_SAMPLE)
    }

    /// The same at a finer level than that of the search, by more deviations: textures may be smoother there, and few
    /// bright things weigh more than their pixels.
    pub(super) fn matches_finely(&self) -> bool {
        exceeds_chance(self.correlation, 8.0, self.samples)
    }

    /// Whether the frames show nothing but noise, or nothing at all.
    pub(super) fn is_noise(&self) -> bool {
        self.whiteness > 0.8
    }
}

/// The step that solves the normal equations along one direction.
pub(super) fn step_along((a, b): (Matrix, [f64; 2]), direction: [f64; 2]) -> [f64; 2] {
    let information = quadratic(a, direction);
    if information <= 0.0 {
        return [0.0; 2];
    }
    let length = -(b[0] * direction[0] + b[1] * direction[1]) / information;
    direction.map(|value| value * length)
}

/// Whether a correlation is above as many deviations of Fisher's transform, and above 0.15.
pub(super) fn exceeds_chance(correlation: f64, deviations: f64, samples: f64) -> bool {
    let chance = deviations / (samples - 3.0).max(1.0).sqrt();
    correlation > chance.tanh().max(0.15)
}
