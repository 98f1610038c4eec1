//! Parallax: what a scene with depth does when the camera travels, told from things that move.

use super::MotionVector;
use super::camera::CameraMotion;

/// What is believed of the parallax of a scene: against the motion of a plane all that stands still moves along lines
/// through one point, the epipole. Give it back with the next frame: the belief grows and fades over frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parallax {
    /// The epipole in `next`, homogeneous and of unit length. `epipole.xy - epipole.w * place` points towards it.
    pub epipole: [f64; 3],
    /// Which way still things move against the plane: 1 away from the epipole (nearer than the plane), -1 towards it;
    /// none where both were seen or it is not known.
    pub sign: Option<f64>,
    /// Logarithm of the odds that the scene has depth, over the frames so far.
    pub belief: f64,
    /// Whether it is believed for this frame: else nothing is to be explained by depth.
    pub believed: bool,
}

impl Parallax {
    /// The part of a residual motion, `next` against the plane, at a place of `next` that depth cannot explain: what is
    /// across the line to the epipole, and what is along it in the impossible direction. All of it if not believed.
    #[must_use]
    #[inline]
    pub fn unexplained(&self, place: [f64; 2], residual: [f64; 2]) -> [f64; 2] {
        if !self.believed {
            return residual;
        }
        let [x, y, w] = self.epipole;
        let toward = [x - w * place[0], y - w * place[1]];
        let square = toward[0] * toward[0] + toward[1] * toward[1];
        if square < 1e-18 {
            return [0.0; 2];
        }
        let along = (residual[0] * toward[0] + residual[1] * toward[1]) / square;
        if self.sign.is_some_and(|sign| sign * along > 0.0) {
            return residual;
        }
        [
            residual[0] - along * toward[0],
            residual[1] - along * toward[1],
        ]
    }
}

/// Look for parallax among vectors that a camera's motion does not explain.
#[must_use]
pub fn find_parallax(
    vectors: &[MotionVector],
    camera: &CameraMotion,
    before: Option<&Parallax>,
) -> Option<Parallax> {
    let _ = (vectors, camera, before);
    None
}
