//! What a corner is, what counts as one, and how many are wanted.

use crate::error::Result;
use crate::execution::Execution;
use crate::options::{expect_option, setters};

/// The largest window of the structure tensor, in pixels a side.
const MAX_BLOCK: usize = 63;

/// A corner of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
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
    setters! {
        /// The most corners to return, the best ones; 0 means all. 400 by default.
        max_corners(corners: usize);

        /// The least response of a corner, as a share of the best one's; 0.01 by default.
        quality(share: f32);

        /// The least distance between corners in pixels; 8 by default.
        min_distance(pixels: f32);

        /// Side of the window over which the structure tensor is summed; 3 by default.
        block_size(pixels: usize);

        /// Harris and Stephens' response, determinant - k trace^2, with this k, in place of the smaller eigenvalue.
        harris(k: Option<f32>);

        /// A mask says where corners may be, and not which pixels their gradients may look at, as OpenCV has it; false by
        /// default.
        mask_corners_only(yes: bool);

        /// Threads, instructions and cancellation.
        execution(execution: Execution);
    }

    /// Check every option.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option) for the first one outside of what it allows.
    pub fn validate(&self) -> Result<()> {
        expect_option(
            self.quality > 0.0 && self.quality <= 1.0,
            "quality",
            self.quality,
            "more than 0, at most 1",
        )?;
        expect_option(
            self.min_distance >= 0.0 && self.min_distance.is_finite(),
            "min_distance",
            self.min_distance,
            "0 or more pixels",
        )?;
        expect_option(
            (1..=MAX_BLOCK).contains(&self.block_size),
            "block_size",
            self.block_size,
            format_args!("1 to {MAX_BLOCK} pixels"),
        )?;
        let k = self.harris.unwrap_or_default();
        expect_option(k.is_finite(), "harris", k, "a finite number")
    }
}
