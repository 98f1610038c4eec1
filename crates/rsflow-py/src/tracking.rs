//! Points tracked between two frames, and their pyramids.

use lk_core::{Execution, Masks, PointStatus, PyrLkOptions};
use numpy::PyReadonlyArray2;
use numpy::ndarray::{Ix1, Ix2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::frames::{AnyFrame, mask as borrow_mask, pair, with_pair, with_view};
use crate::interrupt;
use crate::outputs::filled;
use crate::points::{POINTS, cost, points_of, to_dict, track_options};
use crate::states::plane_array;

/// Add this file's functions to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(track_points, module)?)?;
    module.add_function(wrap_pyfunction!(point_statuses, module)?)?;
    module.add_function(wrap_pyfunction!(track_pyr_lk, module)?)?;
    module.add_function(wrap_pyfunction!(gaussian_pyramid, module)?)
}

/// Every status: its name and value.
#[pyfunction]
fn point_statuses() -> Vec<(&'static str, u8)> {
    PointStatus::ALL
        .iter()
        .map(|status| (status.name(), *status as u8))
        .collect()
}

/// Where each point of `prev` is in `next`.
#[pyfunction]
#[pyo3(signature = (prev, next, points, initial, mask, next_mask, options))]
#[allow(
    clippy::too_many_arguments,
    reason = "the arguments of the Python function"
)]
fn track_points<'py>(
    py: Python<'py>,
    prev: &Bound<'py, PyAny>,
    next: &Bound<'py, PyAny>,
    points: &Bound<'py, PyAny>,
    initial: Option<&Bound<'py, PyAny>>,
    mask: Option<&Bound<'py, PyAny>>,
    next_mask: Option<&Bound<'py, PyAny>>,
    options: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyDict>> {
    let prev = AnyFrame::new("prev", prev)?;
    let next = AnyFrame::new("next", next)?;
    let views = pair(&prev, &next)?;
    let mask = borrow_mask("mask", mask, prev.dim())?;
    let next_mask = borrow_mask("next_mask", next_mask, prev.dim())?;
    let masks = Masks::default()
        .prev(mask.as_ref().map(PyReadonlyArray2::as_array))
        .next(next_mask.as_ref().map(PyReadonlyArray2::as_array));
    let points = points_of("points", points)?;
    let initial = initial
        .map(|initial| points_of("initial", initial))
        .transpose()?;
    let options = track_options(options)?;
    let cost = cost(2, prev.dim(), points.len(), options.window_area());
    let tracks = interrupt::run(py, cost, |execution: &Execution| {
        let options = options.execution(execution.clone());
        with_pair!(views, |prev, next| lk_core::track_points(
            prev,
            next,
            &points,
            initial.as_deref(),
            masks,
            &options
        ))
    })?;
    to_dict(py, tracks.into_iter())
}

/// Positions (N, 2), found (N,) and errors (N,) after `cv2.calcOpticalFlowPyrLK`.
#[pyfunction]
#[pyo3(signature = (prev, next, points, initial, window, max_level, iterations, epsilon, min_eigenvalue, eigenvalue_as_error))]
#[allow(
    clippy::too_many_arguments,
    reason = "the arguments of OpenCV's function"
)]
#[allow(clippy::type_complexity, reason = "three arrays")]
fn track_pyr_lk<'py>(
    py: Python<'py>,
    prev: &Bound<'py, PyAny>,
    next: &Bound<'py, PyAny>,
    points: &Bound<'py, PyAny>,
    initial: Option<&Bound<'py, PyAny>>,
    window: (usize, usize),
    max_level: usize,
    iterations: usize,
    epsilon: f64,
    min_eigenvalue: f64,
    eigenvalue_as_error: bool,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let prev = AnyFrame::new("prevImg", prev)?;
    let next = AnyFrame::new("nextImg", next)?;
    let views = pair(&prev, &next)?;
    let points = points_of("prevPts", points)?;
    let initial = initial
        .map(|initial| points_of("nextPts", initial))
        .transpose()?;
    let options = PyrLkOptions::default()
        .window_size(window.0, window.1)
        .max_level(max_level)
        .criteria(iterations, epsilon)
        .min_eigenvalue(min_eigenvalue)
        .eigenvalue_as_error(eigenvalue_as_error);
    let cost = cost(
        2,
        prev.dim(),
        points.len(),
        window.0.saturating_mul(window.1),
    );
    let tracks = interrupt::run(py, cost, |execution: &Execution| {
        let options = options.execution(execution.clone());
        with_pair!(views, |prev, next| lk_core::track_pyr_lk(
            prev,
            next,
            &points,
            initial.as_deref(),
            &options
        ))
    })?;
    let count = tracks.len();
    let positions = tracks.iter().flat_map(|track| track.position);
    let found = tracks.iter().map(|track| u8::from(track.found));
    let errors = tracks.iter().map(|track| track.error);
    Ok((
        filled(py, POINTS, Ix2(count, 2), positions)?.into_any(),
        filled(py, POINTS, Ix1(count), found)?.into_any(),
        filled(py, POINTS, Ix1(count), errors)?.into_any(),
    ))
}

/// The levels of a frame's Gaussian pyramid as float32 arrays, the finest first.
#[pyfunction]
fn gaussian_pyramid<'py>(
    py: Python<'py>,
    frame: &Bound<'py, PyAny>,
    levels: usize,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let frame = AnyFrame::new("img", frame)?;
    let view = frame.view();
    let pyramid = interrupt::run(py, cost(1, frame.dim(), 0, 0), |execution: &Execution| {
        with_view!(view, |frame| lk_core::Pyramid::new(
            frame, levels, execution
        ))
    })?;
    let levels = pyramid.levels().iter();
    levels
        .map(|level| Ok(plane_array(py, level)?.into_any()))
        .collect()
}
