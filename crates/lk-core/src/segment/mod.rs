//! What moves and what stands still.
//!
//! `docs/algorithms.md`, section "What moves: MotionSegmenter".
#![allow(
    dead_code,
    reason = "parts of a segmenter that is still to be put together of them"
)]

mod agreement;
pub(crate) mod box_filter;
pub(crate) mod camera;
mod camera_fit;
mod camera_model;
mod camera_rows;
mod camera_samples;
pub(crate) mod components;
mod epipole;
pub(crate) mod light;
pub(crate) mod local_correlation;
pub(crate) mod morphology;
pub(crate) mod parallax;
pub(crate) mod reduction;
pub(crate) mod regions;
pub(crate) mod runs;
mod things;
mod travel;
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
