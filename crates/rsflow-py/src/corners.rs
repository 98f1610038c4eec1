//! Corners to start points from.

use lk_core::Execution;
use numpy::PyReadonlyArray2;
use numpy::ndarray::{Ix1, Ix2};
use pyo3::prelude::*;

use crate::frames::{AnyFrame, mask as borrow_mask, with_view};
use crate::interrupt;
use crate::outputs::filled;
use crate::points::{POINTS, corner_options, cost};

/// Positions (N, 2) and responses (N,) of the corners of a frame, the best first.
#[pyfunction]
#[pyo3(signature = (frame, mask, max_corners, quality, min_distance, block_size, harris, mask_corners_only=false))]
#[allow(
    clippy::too_many_arguments,
    reason = "the arguments of the Python function"
)]
pub(crate) fn detect_corners<'py>(
    py: Python<'py>,
    frame: &Bound<'py, PyAny>,
    mask: Option<&Bound<'py, PyAny>>,
    max_corners: isize,
    quality: f32,
    min_distance: f32,
    block_size: isize,
    harris: Option<f32>,
    mask_corners_only: bool,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let frame = AnyFrame::new("frame", frame)?;
    let mask = borrow_mask("mask", mask, frame.dim())?;
    let mask = mask.as_ref().map(PyReadonlyArray2::as_array);
    let options = corner_options(max_corners, quality, min_distance, block_size, harris)?
        .mask_corners_only(mask_corners_only);
    let view = frame.view();
    let corners = interrupt::run(py, cost(1, frame.dim(), 0, 0), |execution: &Execution| {
        let options = options.execution(execution.clone());
        with_view!(view, |frame| lk_core::detect_corners(frame, mask, &options))
    })?;
    let count = corners.len();
    let positions = corners.iter().flat_map(|corner| corner.position);
    let responses = corners.iter().map(|corner| corner.response);
    Ok((
        filled(py, POINTS, Ix2(count, 2), positions)?.into_any(),
        filled(py, POINTS, Ix1(count), responses)?.into_any(),
    ))
}
