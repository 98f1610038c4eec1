//! What a caller may set.

use crate::error::Result;
use crate::execution::Execution;
use crate::illumination::Illumination;
use crate::options::{expect_option, names, setters};

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Roi {
    /// The first column.
    pub x: usize,
    /// The first row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// How a window may deform from one frame to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum ShiftDeformation {
    /// Not at all: one displacement for all of it.
    #[default]
    None,
    /// The displacement varies linearly over it, as in a turn, a zoom or a shear.
    Affine,
}

names!(ShiftDeformation, "deformation": None "none", Affine "affine");

/// How [`estimate_shift`](crate::estimate_shift) works.
#[derive(Debug, Clone, Default)]
pub struct ShiftOptions {
    pub(super) roi: Option<Roi>,
    pub(super) illumination: Illumination,
    pub(super) deformation: ShiftDeformation,
    pub(super) max_displacement: Option<f64>,
    pub(super) execution: Execution,
}

impl ShiftOptions {
    /// The window in `prev`; the whole frame if not set. `next` is read outside of it as far as the motion goes.
    #[must_use]
    pub fn roi(mut self, roi: impl Into<Option<Roi>>) -> Self {
        self.roi = roi.into();
        self
    }

    setters! {
        /// How light may change.
        illumination(illumination: Illumination);

        /// How the window may deform.
        deformation(deformation: ShiftDeformation);

        /// On how many threads, with which instructions, until when.
        execution(execution: Execution);
    }

    /// The largest displacement along each axis, in pixels; half the window if not set. A pattern that repeats within
    /// this reach is [`ShiftStatus::Ambiguous`](crate::ShiftStatus::Ambiguous): below half a period it is measured.
    #[must_use]
    pub fn max_displacement(mut self, pixels: impl Into<Option<f64>>) -> Self {
        self.max_displacement = pixels.into();
        self
    }

    /// Check the options against each other and against the frames' size.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option) if `max_displacement` is negative or not finite, or the window is not inside of the frame.
    pub fn validate(&self, height: usize, width: usize) -> Result<()> {
        let limit = self.max_displacement.unwrap_or_default();
        expect_option(
            limit.is_finite() && limit >= 0.0,
            "max_displacement",
            limit,
            "0 or more pixels, finite",
        )?;
        if let Some(roi) = self.roi {
            let ends = |start: usize, size: usize, of: usize| {
                start.checked_add(size).is_some_and(|end| end <= of)
            };
            expect_option(
                ends(roi.x, roi.width, width) && ends(roi.y, roi.height, height),
                "roi",
                format_args!(
                    "(x={}, y={}, width={}, height={})",
                    roi.x, roi.y, roi.width, roi.height
                ),
                format_args!("a window inside of the frame, {width} wide and {height} high"),
            )?;
        }
        Ok(())
    }
}
