//! What moves and what stands still.
//!
//! `docs/algorithms.md`, section "What moves: MotionSegmenter".
#![allow(
    dead_code,
    reason = "parts of a segmenter that is still to be put together of them"
)]

pub(crate) mod box_filter;
pub(crate) mod camera;
pub(crate) mod components;
pub(crate) mod morphology;
pub(crate) mod parallax;
pub(crate) mod reduction;
pub(crate) mod regions;
pub(crate) mod runs;
pub(crate) mod vote;

#[cfg(test)]
mod made;

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
