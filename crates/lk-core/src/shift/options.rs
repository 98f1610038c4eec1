//! What a caller may set.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::illumination::Illumination;

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

impl ShiftDeformation {
    /// The name used in Python and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Affine => "affine",
        }
    }
}

impl std::str::FromStr for ShiftDeformation {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        [Self::None, Self::Affine]
            .into_iter()
            .find(|deformation| deformation.name() == name)
            .ok_or_else(|| {
                Error::option("deformation", format!("{name:?}"), "\"none\" or \"affine\"")
            })
    }
}

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
    pub fn roi(mut self, roi: Roi) -> Self {
        self.roi = Some(roi);
        self
    }

    /// How light may change.
    #[must_use]
    pub fn illumination(mut self, illumination: Illumination) -> Self {
        self.illumination = illumination;
        self
    }

    /// How the window may deform.
    #[must_use]
    pub fn deformation(mut self, deformation: ShiftDeformation) -> Self {
        self.deformation = deformation;
        self
    }

    /// The largest displacement along each axis, in pixels; half the window if not set. A pattern that repeats within
    /// this reach is [`ShiftStatus::Ambiguous`](crate::ShiftStatus::Ambiguous): below half a period it is measured.
    #[must_use]
    pub fn max_displacement(mut self, pixels: f64) -> Self {
        self.max_displacement = Some(pixels);
        self
    }

    /// On how many threads, with which instructions, until when.
    #[must_use]
    pub fn execution(mut self, execution: Execution) -> Self {
        self.execution = execution;
        self
    }

    /// Check the options against each other and against the frames' size.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] if `max_displacement` is negative or not finite, or the window is not inside of the frame.
    pub fn validate(&self, height: usize, width: usize) -> Result<()> {
        if let Some(limit) = self.max_displacement
            && !(limit.is_finite() && limit >= 0.0)
        {
            return Err(Error::option(
                "max_displacement",
                limit,
                "0 or more pixels, finite",
            ));
        }
        if let Some(roi) = self.roi {
            let inside = roi.x.checked_add(roi.width).is_some_and(|end| end <= width)
                && roi
                    .y
                    .checked_add(roi.height)
                    .is_some_and(|end| end <= height);
            if !inside {
                return Err(Error::option(
                    "roi",
                    format!(
                        "(x={}, y={}, width={}, height={})",
                        roi.x, roi.y, roi.width, roi.height
                    ),
                    format!("a window inside of the frame, {width} wide and {height} high"),
                ));
            }
        }
        Ok(())
    }
}
