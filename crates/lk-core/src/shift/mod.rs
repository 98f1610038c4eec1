//! The displacement of one window, with its covariance, in changing light.
//!
//! Both frames are sampled half a displacement towards each other, so that swapping them negates the result. Light may
//! change by a gain and an offset that follow the place; they are unknowns of the same least squares. The gradients
//! that weight the differences are smoothed, the differences are not, so that noise does not bias the result.
//!
//! `docs/explanation/algorithms.md`, section "Displacement of a window: estimate_shift".

mod affine;
mod aperture;
mod block_sums;
mod blocks;
mod coordinates;
mod correlation;
mod deformed;
mod edges;
mod estimate;
mod evaluate;
pub(crate) mod filters;
mod gain;
mod gauss_newton;
mod gram;
mod inputs;
mod judge;
mod lines;
mod matrix;
mod model;
mod normalization;
mod options;
mod outlying;
mod result;
mod robust_covariance;
mod solution;
mod solve;
mod start;
mod stripe;
mod sums;
mod view;
mod workspace;

pub use options::{Roi, ShiftDeformation, ShiftOptions};
pub use result::{Shift, ShiftStatus};

use crate::error::Result;
use crate::frame::{Frame, Pixel, expect_size};
use crate::parallel::within_pool;
use crate::support::Masks;
use workspace::with_workspace;

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
/// [`Error::Shape`](crate::Error::Shape) if the frames or the mask differ in size,
/// [`Error::Option`](crate::Error::Option) if the options do not fit, and those of the execution.
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
