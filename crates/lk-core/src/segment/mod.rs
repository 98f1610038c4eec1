//! What moves and what stands still.
//!
//! `docs/explanation/algorithms.md`, section "What moves: MotionSegmenter".

pub(crate) mod agreement;
pub(crate) mod align;
pub(crate) mod background;
mod background_kernels;
pub(crate) mod box_filter;
pub(crate) mod camera;
pub(crate) mod camera_fit;
pub(crate) mod camera_model;
pub(crate) mod camera_rows;
pub(crate) mod camera_samples;
pub(crate) mod canvas;
pub(crate) mod change;
pub(crate) mod components;
mod decision;
pub(crate) mod difference;
mod difference_kernels;
mod earlier;
mod enlarge;
pub(crate) mod epipole;
mod finer;
pub(crate) mod flow_evidence;
mod flow_kernels;
mod flutter;
mod held;
mod input;
pub(crate) mod judge;
pub(crate) mod light;
mod lighting;
pub(crate) mod local_correlation;
mod masks;
pub(crate) mod morphology;
pub(crate) mod motion_segmenter;
mod moving_motion;
mod outline;
pub(crate) mod parallax;
pub(crate) mod picture_motion;
mod placed;
mod placed_kernels;
pub(crate) mod reduction;
pub(crate) mod regions;
mod registration;
pub(crate) mod runs;
mod sampling;
pub(crate) mod scene;
pub(crate) mod seen_regions;
pub(crate) mod segmenter;
mod shade_kernels;
mod shades;
mod shadows;
mod significance;
pub(crate) mod slopes;
mod slow;
pub(crate) mod snapshot;
pub(crate) mod things;
mod traced;
pub(crate) mod transform;
pub(crate) mod travel;
pub(crate) mod vote;

#[cfg(test)]
mod camera_tests;
#[cfg(test)]
mod made;
#[cfg(test)]
mod parallax_tests;

/// One motion vector of a flow, from `prev` to `next`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionVector {
    /// Column in `prev`.
    pub x: f64,
    /// Row in `prev`.
    pub y: f64,
    /// Motion to the right, in pixels.
    pub u: f64,
    /// Motion down, in pixels.
    pub v: f64,
    /// Covariance of the motion in px²: xx, xy, yy.
    pub covariance: [f64; 3],
}

/// No frame is larger, and no motion longer: what is beyond is no measurement.
const MOST_PX: f64 = 1e6;

impl MotionVector {
    /// Whether it can be reckoned with.
    fn usable(&self) -> bool {
        [self.x, self.y, self.u, self.v]
            .iter()
            .all(|part| part.abs() < MOST_PX)
            && self.covariance.iter().all(|part| part.is_finite())
    }
}
