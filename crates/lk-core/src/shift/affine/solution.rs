//! What was found: a displacement that varies linearly over the window.

use super::curvature::Correction;
use super::view::MOTION;
use crate::shift::matrix::{Matrix, product};
use crate::shift::solution::exceeds_chance;

/// A displacement that varies linearly over the window.
#[derive(Debug, Clone, Copy)]
pub(in crate::shift) struct Affine {
    /// Displacement of the centre, then the gradient halfway between the frames.
    pub(in crate::shift) motion: [f64; MOTION],
    pub(in crate::shift) covariance: [[f64; MOTION]; MOTION],
    /// Symmetric gain and offset.
    pub(in crate::shift) alpha: f64,
    pub(in crate::shift) beta: f64,
    /// Root mean square of what motion and light leave.
    pub(in crate::shift) residual: f64,
    pub(in crate::shift) correlation: f64,
    /// Independent samples among the pixels.
    pub(in crate::shift) samples: f64,
    pub(in crate::shift) steady: bool,
    /// By how much the covariance is larger than noise explains.
    pub(in crate::shift) excess: f64,
    /// What a displacement that varies quadratically adds at the centre.
    pub(super) curvature: Option<Correction>,
}

impl Affine {
    /// With the displacement of the centre corrected for its curvature.
    pub(super) fn corrected(mut self) -> Self {
        if let Some(correction) = self.curvature {
            for i in 0..2 {
                self.motion[i] += correction.displacement[i];
                for j in 0..2 {
                    self.covariance[i][j] += correction.covariance[i][j];
                }
            }
        }
        self
    }

    /// The gradient by the place in `prev`: `u(x) = d + G (I - G / 2)^-1 (x - c)`.
    pub(in crate::shift) fn gradient(&self) -> Matrix {
        let [_, _, xx, xy, yx, yy] = self.motion;
        let half = [[1.0 - xx / 2.0, -xy / 2.0], [-yx / 2.0, 1.0 - yy / 2.0]];
        let determinant = half[0][0] * half[1][1] - half[0][1] * half[1][0];
        let inverse = [
            [half[1][1] / determinant, -half[0][1] / determinant],
            [-half[1][0] / determinant, half[0][0] / determinant],
        ];
        product([[xx, xy], [yx, yy]], inverse)
    }

    /// Whether the frames agree by more than chance: six deviations of Fisher's transform.
    pub(in crate::shift) fn matches(&self) -> bool {
        exceeds_chance(self.correlation, 6.0, self.samples)
    }
}
