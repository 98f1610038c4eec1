//! What a corner is, what counts as one, and how many are wanted.

use crate::error::{Error, Result};
use crate::execution::Execution;

/// The largest window of the structure tensor, in pixels a side.
const MAX_BLOCK: usize = 63;

/// A corner of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Position (x, y) in pixels.
    pub position: [f32; 2],
    /// Its response, in squared grey levels per pixel: the smaller eigenvalue of the mean structure tensor, or
    /// Harris and Stephens' response.
    pub response: f32,
}

/// What counts as a corner, and how many are wanted.
///
/// ```
/// use lk_core::CornerOptions;
///
/// assert!(CornerOptions::default().max_corners(100).min_distance(10.0).validate().is_ok());
/// assert!(CornerOptions::default().quality(0.0).validate().is_err());
/// ```
#[derive(Debug, Clone)]
pub struct CornerOptions {
    pub(crate) max_corners: usize,
    pub(crate) quality: f32,
    pub(crate) min_distance: f32,
    pub(crate) block_size: usize,
    pub(crate) harris: Option<f32>,
    pub(crate) mask_corners_only: bool,
    pub(crate) execution: Execution,
}

impl Default for CornerOptions {
    fn default() -> Self {
        Self {
            max_corners: 400,
            quality: 0.01,
            min_distance: 8.0,
            block_size: 3,
            harris: None,
            mask_corners_only: false,
            execution: Execution::default(),
        }
    }
}

impl CornerOptions {
    /// The most corners to return, the best ones; 0 means all. 400 by default.
    #[must_use]
    pub fn max_corners(mut self, corners: usize) -> Self {
        self.max_corners = corners;
        self
    }

    /// The least response of a corner, as a share of the best one's; 0.01 by default.
    #[must_use]
    pub fn quality(mut self, share: f32) -> Self {
        self.quality = share;
        self
    }

    /// The least distance between corners in pixels; 8 by default.
    #[must_use]
    pub fn min_distance(mut self, pixels: f32) -> Self {
        self.min_distance = pixels;
        self
    }

    /// Side of the window over which the structure tensor is summed; 3 by default.
    #[must_use]
    pub fn block_size(mut self, pixels: usize) -> Self {
        self.block_size = pixels;
        self
    }

    /// Harris and Stephens' response, determinant - k trace^2, with this k, in place of the smaller eigenvalue.
    #[must_use]
    pub fn harris(mut self, k: Option<f32>) -> Self {
        self.harris = k;
        self
    }

    /// A mask says where corners may be, and not which pixels their gradients may look at, as OpenCV has it; false by
    /// default.
    #[must_use]
    pub fn mask_corners_only(mut self, yes: bool) -> Self {
        self.mask_corners_only = yes;
        self
    }

    /// Threads, instructions and cancellation.
    #[must_use]
    pub fn execution(mut self, execution: Execution) -> Self {
        self.execution = execution;
        self
    }

    /// Check every option.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] for the first one outside of what it allows.
    pub fn validate(&self) -> Result<()> {
        if !(self.quality > 0.0 && self.quality <= 1.0) {
            return Err(Error::option(
                "quality",
                self.quality,
                "more than 0, at most 1",
            ));
        }
        if !(self.min_distance >= 0.0 && self.min_distance.is_finite()) {
            return Err(Error::option(
                "min_distance",
                self.min_distance,
                "0 or more pixels",
            ));
        }
        if !(1..=MAX_BLOCK).contains(&self.block_size) {
            return Err(Error::option(
                "block_size",
                self.block_size,
                format!("1 to {MAX_BLOCK} pixels"),
            ));
        }
        if let Some(k) = self.harris
            && !k.is_finite()
        {
            return Err(Error::option("harris", k, "a finite number"));
        }
        Ok(())
    }
}
