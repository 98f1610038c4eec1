//! The motion of the camera in the picture: the simplest model of a plane that explains a flow, fitted robustly.
//!
//! Starts from small samples, from the median and from the frame before are judged by a loss that grows slowly, so that
//! things that cover much of the frame and move as one are not taken for it; the best are refined, and the simplest
//! model that explains as much is chosen by Bayes' information criterion with a bounded loss.

use super::MotionVector;
use super::camera_fit::Fit;
pub use super::camera_model::CameraModel;
use super::camera_rows::{Map, Rows};
use super::camera_samples::in_front;

/// Fewer vectors tell nothing.
const FEWEST: usize = 12;

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
    /// A camera whose motion nothing tells.
    #[must_use]
    pub fn unknown() -> Self {
        Self {
            homography: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            model: CameraModel::None,
            sigma_px: f64::INFINITY,
            explained: 0.0,
        }
    }

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
/// the one that goes on as before is taken. Fewer than 12 finite vectors tell nothing: [`CameraModel::None`].
#[must_use]
pub fn fit_camera(vectors: &[MotionVector], before: Option<&[[f64; 3]; 3]>) -> CameraMotion {
    let rows = Rows::of(vectors);
    if rows.len() < FEWEST {
        return CameraMotion::unknown();
    }
    let mut fit = Fit::over(&rows);
    let before = before.and_then(|homography| to_unit(homography, &rows));
    let start = fit.start(before.as_ref());
    let (model, map) = fit.simplest(start);
    let (sigma_px, explained) = fit.noise(&map);
    CameraMotion {
        homography: to_pixels(&map, &rows),
        model,
        sigma_px,
        explained,
    }
}

fn to_pixels(map: &Map, rows: &Rows) -> [[f64; 3]; 3] {
    let [cx, cy] = rows.centre;
    let s = rows.size;
    let unit = [
        [map[0], map[1], map[2]],
        [map[3], map[4], map[5]],
        [map[6], map[7], 1.0],
    ];
    let out = product(
        &[[s, 0.0, cx], [0.0, s, cy], [0.0, 0.0, 1.0]],
        &product(&unit, &from_pixels(rows)),
    );
    out.map(|row| row.map(|value| value / out[2][2]))
}

fn to_unit(homography: &[[f64; 3]; 3], rows: &Rows) -> Option<Map> {
    let [cx, cy] = rows.centre;
    let s = rows.size;
    let out = product(
        &from_pixels(rows),
        &product(homography, &[[s, 0.0, cx], [0.0, s, cy], [0.0, 0.0, 1.0]]),
    );
    let map: Map = std::array::from_fn(|k| out[k / 3][k % 3] / out[2][2]);
    let fits = map.iter().all(|value| value.is_finite()) && in_front(&map, rows);
    fits.then_some(map)
}

fn from_pixels(rows: &Rows) -> [[f64; 3]; 3] {
    let ([cx, cy], s) = (rows.centre, rows.size);
    [
        [1.0 / s, 0.0, -cx / s],
        [0.0, 1.0 / s, -cy / s],
        [0.0, 0.0, 1.0],
    ]
}

fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}
