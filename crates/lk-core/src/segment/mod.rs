//! What moves and what stands still.
//!
//! `docs/algorithms.md`, section "What moves: MotionSegmenter".

pub(crate) mod camera;
pub(crate) mod parallax;

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
