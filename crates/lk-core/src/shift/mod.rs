//! The displacement of one window, with its covariance, in changing light.
//!
//! Both frames are sampled half a displacement towards each other, so that swapping them negates the result. Light may
//! change by a gain and an offset that follow the place; they are unknowns of the same least squares. The gradients
//! that weight the differences are smoothed, the differences are not, so that noise does not bias the result.

mod affine;
mod aperture;
mod coordinates;
mod correlation;
mod curvature;
mod edges;
mod estimate;
mod evaluate;
mod filters;
mod gain;
mod gauss_newton;
mod gram;
mod inputs;
mod matrix;
mod normalization;
mod robust_covariance;
mod solve;
mod start;
mod sums;
mod workspace;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, expect_size};
use crate::illumination::Illumination;
use crate::parallel::within_pool;
use crate::support::Masks;
use workspace::with_workspace;

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

/// Whether a displacement could be measured, and if not, why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum ShiftStatus {
    /// Measured.
    Valid = 0,
    /// The window, or what a mask or NaN leave of it, has too few pixels.
    TooSmall = 1,
    /// At the displacement found, the frames share too little of the window.
    TooLittleOverlap = 2,
    /// The window shows no structure that stands out of the noise.
    NoTexture = 3,
    /// The window shows structure in one direction only: motion along it cannot be seen. The displacement across it is
    /// given, with infinite variance along it, unless the structure repeats.
    Aperture = 4,
    /// Nothing in the other frame looks like the window: a scene cut, or motion beyond `max_displacement`.
    NoMatch = 5,
    /// The iteration did not settle.
    NotConverged = 6,
    /// The window repeats: another displacement within `max_displacement` explains the frames as well.
    Ambiguous = 7,
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

/// The displacement of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shift {
    /// Displacement to the right, in pixels; NaN where not measured.
    pub dx: f64,
    /// Displacement down, in pixels; NaN where not measured.
    pub dy: f64,
    /// Covariance of (dx, dy), in square pixels; infinite where not measured.
    pub covariance: [[f64; 2]; 2],
    /// Where the status is [`ShiftStatus::Aperture`] and the displacement across the structure was measured: the unit
    /// vector (x, y) across it; NaN otherwise. `dx` and `dy` are then the displacement along this vector, the smallest
    /// that explains the frames, and the covariance is infinite along the structure.
    pub direction: [f64; 2],
    /// The variance of the displacement along `direction`, in square pixels; infinite without one.
    pub direction_variance: f64,
    /// The gradient of the displacement, [[du/dx, du/dy], [dv/dx, dv/dy]], of a window that may deform: what was at
    /// (x, y) in `prev`, counted from the centre of the window, is at (x + dx + du/dx x + du/dy y, ...) in `next`. Zero
    /// without [`ShiftDeformation::Affine`]; NaN where not measured.
    pub gradient: [[f64; 2]; 2],
    /// The covariance of (dx, dy, du/dx, du/dy, dv/dx, dv/dy); that of the gradient is zero without
    /// [`ShiftDeformation::Affine`], and infinite where not measured.
    pub joint_covariance: [[f64; 6]; 6],
    /// `next = gain * prev + offset`, on average over the window; 1 if the model has no gain.
    pub gain: f64,
    /// See `gain`; in grey levels, 0 if the model has no offset.
    pub offset: f64,
    /// Root mean square of `next - prev` after motion and light, in grey levels.
    pub residual: f64,
    /// Whether the displacement could be measured, and if not, why.
    pub status: ShiftStatus,
}

impl Shift {
    /// A displacement that could not be measured.
    fn invalid(status: ShiftStatus) -> Self {
        Self {
            dx: f64::NAN,
            dy: f64::NAN,
            covariance: [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]],
            direction: [f64::NAN; 2],
            direction_variance: f64::INFINITY,
            gradient: [[f64::NAN; 2]; 2],
            joint_covariance: std::array::from_fn(|i| {
                std::array::from_fn(|j| if i == j { f64::INFINITY } else { 0.0 })
            }),
            gain: f64::NAN,
            offset: f64::NAN,
            residual: f64::NAN,
            status,
        }
    }

    /// Whether the displacement was measured.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.status == ShiftStatus::Valid
    }
}

/// How [`estimate_shift`] works.
#[derive(Debug, Clone, Default)]
pub struct ShiftOptions {
    roi: Option<Roi>,
    illumination: Illumination,
    deformation: ShiftDeformation,
    max_displacement: Option<f64>,
    execution: Execution,
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
    /// this reach is [`ShiftStatus::Ambiguous`]: below half a period it is measured.
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
/// Fewer usable pixels along a side cannot hold the filters.
const MIN_SIDE: usize = 8;
/// Smaller windows are measured in less time than a second thread takes to wake up.
const ONE_THREAD_PIXELS: usize = 1 << 14;

/// The displacement of the window from `prev` to `next`.
///
/// Pixels that are NaN or masked are left out: one is used where it counts and where its target does.
///
/// # Errors
///
/// [`Error::Shape`] if the frames or the mask differ in size, [`Error::Option`] if the options do not fit, and those of
/// the execution.
///
/// ```
/// use lk_core::{Masks, ShiftOptions, estimate_shift};
/// use ndarray::Array2;
///
/// let scene = |x: f32, y: f32| 100.0 + 40.0 * (0.4 * x + 0.005 * y * y).sin() * (0.3 * y + 0.003 * x * x).cos();
/// let prev = Array2::from_shape_fn((60, 60), |(y, x)| scene(x as f32, y as f32));
/// // What was at (x, y) is now at (x + 2.25, y - 1.5), in brighter light.
/// let next = Array2::from_shape_fn((60, 60), |(y, x)| 1.2 * scene(x as f32 - 2.25, y as f32 + 1.5));
///
/// let shift = estimate_shift(prev.view(), next.view(), Masks::default(), &ShiftOptions::default())?;
/// assert!(shift.is_valid());
/// assert!((shift.dx - 2.25).abs() < 0.01 && (shift.dy + 1.5).abs() < 0.01);
/// assert!((shift.gain - 1.2).abs() < 0.01);
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn estimate_shift<T: Pixel>(
    prev: Frame<'_, T>,
    next: Frame<'_, T>,
    masks: Masks<'_>,
    options: &ShiftOptions,
) -> Result<Shift> {
    let (height, width) = prev.dim();
    expect_size("next", next.dim(), "prev", (height, width))?;
    masks.expect_size((height, width))?;
    options.validate(height, width)?;
    let roi = options.roi.unwrap_or(Roi {
        x: 0,
        y: 0,
        width,
        height,
    });
    if roi.width < MIN_SIDE || roi.height < MIN_SIDE {
        return Ok(Shift::invalid(ShiftStatus::TooSmall));
    }
    let limit = match options.max_displacement {
        Some(limit) => [limit, limit],
        None => [roi.width as f64 / 2.0, roi.height as f64 / 2.0],
    };
    let work = || {
        with_workspace(|workspace| {
            let inputs = &mut workspace.inputs;
            inputs.take(prev, next, masks, roi, limit, &options.execution)?;
            if inputs.usable < (MIN_SIDE * MIN_SIDE) as f64 {
                return Ok(Shift::invalid(ShiftStatus::TooSmall));
            }
            workspace.estimate(limit, options)
        })
    };
    if roi.width * roi.height < ONE_THREAD_PIXELS {
        work()
    } else {
        within_pool(&options.execution, work)
    }
}
