//! What a caller may set.

use super::shape::GridShape;
use crate::error::Result;
use crate::execution::Execution;
use crate::illumination::Illumination;
use crate::options::{expect_option, is_positive, setters};

/// Sides of a window, in pixels.
const SIDES: std::ops::RangeInclusive<usize> = 8..=256;

/// How a grid is measured.
///
/// ```
/// use lk_core::{GridOptions, GridShape};
///
/// let options = GridOptions::default().window_size(41).shape(GridShape::Quadratic);
/// assert!(options.validate().is_ok());
/// assert!(options.step(0).validate().is_err());
/// ```
#[derive(Debug, Clone)]
pub struct GridOptions {
    pub(super) window_size: usize,
    pub(super) step: usize,
    pub(super) shape: GridShape,
    pub(super) robust: bool,
    pub(super) illumination: Illumination,
    pub(super) max_displacement: Option<f32>,
    pub(super) execution: Execution,
}

impl Default for GridOptions {
    fn default() -> Self {
        Self {
            window_size: 32,
            step: 16,
            shape: GridShape::default(),
            robust: false,
            illumination: Illumination::default(),
            max_displacement: None,
            execution: Execution::default(),
        }
    }
}

impl GridOptions {
    setters! {
        /// Side of the square window around each node, in pixels, 8 to 256; 32 by default.
        window_size(pixels: usize);

        /// Pixels from one node to the next; 16 by default.
        step(pixels: usize);

        /// How the displacement may vary over a window.
        shape(shape: GridShape);

        /// Whether pixels that do not follow the others of their window are left out gradually.
        robust(robust: bool);

        /// What may change in the light of a window.
        illumination(illumination: Illumination);

        /// The longest displacement to look for, along each axis, in pixels; `None`, the default, looks for any.
        max_displacement(pixels: Option<f32>);

        /// Threads, instructions and cancellation.
        execution(execution: Execution);
    }

    /// Pixels of a window.
    #[must_use]
    pub fn window_area(&self) -> usize {
        self.window_size.saturating_mul(self.window_size)
    }

    /// Check every option.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option) for the first one outside of what it allows.
    pub fn validate(&self) -> Result<()> {
        expect_option(
            SIDES.contains(&self.window_size),
            "window_size",
            self.window_size,
            format_args!("{} to {} pixels", SIDES.start(), SIDES.end()),
        )?;
        expect_option(self.step > 0, "step", self.step, "1 or more pixels")?;
        expect_option(
            is_positive(self.max_displacement),
            "max_displacement",
            self.max_displacement.unwrap_or_default(),
            "a positive number of pixels, or none for any displacement",
        )
    }

    /// Columns and rows of the nodes of frames of this size: as many windows as fit, in the middle of the frame; none
    /// where not one does.
    #[must_use]
    pub fn nodes(&self, width: usize, height: usize) -> (usize, usize) {
        let count = |size: usize| match size.checked_sub(self.window_size) {
            Some(room) => room / self.step.max(1) + 1,
            None => 0,
        };
        match (count(width), count(height)) {
            (0, _) | (_, 0) => (0, 0),
            counts => counts,
        }
    }

    /// The first pixel of the first window along a side of `size` pixels.
    pub(super) fn first(&self, size: usize) -> usize {
        let room = size.saturating_sub(self.window_size);
        room % self.step.max(1) / 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_stand_in_the_middle() {
        let options = GridOptions::default();
        assert_eq!(options.nodes(384, 64), (23, 3));
        assert_eq!((options.first(384), options.first(71)), (0, 3));
        assert_eq!(options.nodes(31, 100), (0, 0));
        assert_eq!(options.step(200).nodes(384, 384), (2, 2));
    }

    #[test]
    fn what_does_not_fit_is_an_error() {
        let error = GridOptions::default()
            .window_size(7)
            .validate()
            .unwrap_err();
        assert_eq!(
            error.to_string(),
            "window_size: got 7, expected 8 to 256 pixels"
        );
        assert!(
            GridOptions::default()
                .max_displacement(Some(0.0))
                .validate()
                .is_err()
        );
    }
}
