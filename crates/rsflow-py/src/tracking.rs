//! Points: tracking between two frames, through a sequence, and corners to start from.

use lk_core::{
    BouguetOptions, CornerOptions, Execution, Illumination, PointStatus, PointTracker, StreamPoint,
    TrackOptions, TrackedPoint,
};
use numpy::ndarray::{Array1, Array2, Array3};
use numpy::{IntoPyArray, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{raise, to_python};
use crate::frames::{AnyFrame, described, mask, pair};
use crate::{interrupt, with_pair, with_view};

/// Pixels of a frame, or of the windows of its points, that cost as much as one of those by which [`interrupt::run`]
/// counts: a pyramid or corners take some 3 ns a pixel, a point some 20 ns a pixel of its window.
const FRAME_PIXELS: usize = 1 << 4;
const WINDOW_PIXELS: usize = 1 << 3;

/// The cost of a call over this many frames, points and pixels a window, for [`interrupt::run`].
fn cost(frames: usize, (height, width): (usize, usize), points: usize, window: usize) -> usize {
    (frames * height * width / FRAME_PIXELS)
        .saturating_add(points.saturating_mul(window) / WINDOW_PIXELS)
}

/// Add this file's functions and classes to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(track_points, module)?)?;
    module.add_function(wrap_pyfunction!(detect_corners, module)?)?;
    module.add_function(wrap_pyfunction!(point_statuses, module)?)?;
    module.add_function(wrap_pyfunction!(track_bouguet, module)?)?;
    module.add_function(wrap_pyfunction!(gaussian_pyramid, module)?)?;
    module.add_class::<PyPointTracker>()
}

/// Every status: its name and value.
#[pyfunction]
fn point_statuses() -> Vec<(&'static str, u8)> {
    PointStatus::ALL
        .iter()
        .map(|status| (status.name(), *status as u8))
        .collect()
}

/// An (N, 2) float32 array as points.
fn points_of(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<[f32; 2]>> {
    let array = value
        .extract::<PyReadonlyArray2<'_, f32>>()
        .map_err(|_| unfit(name, value))?;
    let view = array.as_array();
    if view.ncols() != 2 {
        return Err(unfit(name, value));
    }
    Ok(view
        .rows()
        .into_iter()
        .map(|row| [row[0], row[1]])
        .collect())
}

fn unfit(name: &str, value: &Bound<'_, PyAny>) -> PyErr {
    let got = described(value);
    raise(
        "ShapeError",
        format!("{name}: got {got}, expected (N, 2) float32, x and y of each point"),
    )
}

fn fallback(name: &'static str, value: Option<isize>) -> PyResult<Option<usize>> {
    value
        .map(|value| {
            usize::try_from(value)
                .map_err(|_| to_python(&lk_core::Error::option(name, value, "not less than 0")))
        })
        .transpose()
}

/// The options that both the function and the tracker take.
fn track_options(options: &Bound<'_, PyDict>) -> PyResult<TrackOptions> {
    let get = |name: &str| -> PyResult<Bound<'_, PyAny>> {
        options
            .get_item(name)?
            .ok_or_else(|| raise("OptionError", format!("{name}: missing")))
    };
    let (width, height): (isize, isize) = get("window_size")?.extract()?;
    let side = |side: isize| usize::try_from(side).unwrap_or(0);
    let iterations: isize = get("max_iterations")?.extract()?;
    let illumination: Illumination = get("illumination")?
        .extract::<String>()?
        .parse()
        .map_err(|error| to_python(&error))?;
    let options = TrackOptions::default()
        .window_size(side(width), side(height))
        .levels(fallback("levels", get("levels")?.extract()?)?)
        .max_displacement(get("max_displacement")?.extract()?)
        .max_iterations(usize::try_from(iterations).unwrap_or(0))
        .epsilon(get("epsilon")?.extract()?)
        .illumination(illumination)
        .max_forward_backward(get("max_forward_backward")?.extract()?);
    options.validate().map_err(|error| to_python(&error))?;
    Ok(options)
}

fn corner_options(
    max_corners: isize,
    quality: f32,
    min_distance: f32,
    block_size: isize,
    harris: Option<f32>,
) -> PyResult<CornerOptions> {
    let options = CornerOptions::default()
        .max_corners(fallback("max_corners", Some(max_corners))?.unwrap_or(0))
        .quality(quality)
        .min_distance(min_distance)
        .block_size(usize::try_from(block_size).unwrap_or(0))
        .harris(harris);
    options.validate().map_err(|error| to_python(&error))?;
    Ok(options)
}

/// The arrays of a result, by the names that the Python side gives them.
fn to_dict<'py>(
    py: Python<'py>,
    count: usize,
    tracks: impl Iterator<Item = TrackedPoint>,
) -> PyResult<Bound<'py, PyDict>> {
    let mut points = Array2::<f32>::zeros((count, 2));
    let mut status = Array1::<u8>::zeros(count);
    let mut residual = Array1::<f32>::zeros(count);
    let mut covariance = Array3::<f32>::zeros((count, 2, 2));
    let mut forward_backward = Array1::<f32>::zeros(count);
    let mut deformation = Array3::<f32>::zeros((count, 2, 2));
    for (row, track) in tracks.enumerate() {
        points[(row, 0)] = track.position[0];
        points[(row, 1)] = track.position[1];
        status[row] = track.status as u8;
        residual[row] = track.residual;
        let [xx, xy, yy] = track.covariance;
        covariance[(row, 0, 0)] = xx;
        covariance[(row, 0, 1)] = xy;
        covariance[(row, 1, 0)] = xy;
        covariance[(row, 1, 1)] = yy;
        forward_backward[row] = track.forward_backward;
        for (index, entry) in track.deformation.into_iter().flatten().enumerate() {
            deformation[(row, index / 2, index % 2)] = entry;
        }
    }
    let dict = PyDict::new(py);
    dict.set_item("points", points.into_pyarray(py))?;
    dict.set_item("status", status.into_pyarray(py))?;
    dict.set_item("residual", residual.into_pyarray(py))?;
    dict.set_item("covariance", covariance.into_pyarray(py))?;
    dict.set_item("forward_backward", forward_backward.into_pyarray(py))?;
    dict.set_item("deformation", deformation.into_pyarray(py))?;
    Ok(dict)
}

/// Where each point of `prev` is in `next`.
#[pyfunction]
#[pyo3(signature = (prev, next, points, initial, mask, options))]
fn track_points<'py>(
    py: Python<'py>,
    prev: &Bound<'py, PyAny>,
    next: &Bound<'py, PyAny>,
    points: &Bound<'py, PyAny>,
    initial: Option<&Bound<'py, PyAny>>,
    mask: Option<&Bound<'py, PyAny>>,
    options: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyDict>> {
    let prev = AnyFrame::new("prev", prev)?;
    let next = AnyFrame::new("next", next)?;
    let views = pair(&prev, &next)?;
    let (height, width) = prev.dim();
    let mask = self::mask(mask, (height, width))?;
    let mask = mask.as_ref().map(PyReadonlyArray2::as_array);
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
            mask,
            &options
        ))
    })?;
    to_dict(py, tracks.len(), tracks.into_iter())
}

/// Positions (N, 2), found (N,) and errors (N,) after `cv2.calcOpticalFlowPyrLK`.
#[pyfunction]
#[pyo3(signature = (prev, next, points, initial, window, max_level, iterations, epsilon, min_eigenvalue, eigenvalue_as_error))]
#[allow(
    clippy::too_many_arguments,
    reason = "the arguments of OpenCV's function"
)]
#[allow(clippy::type_complexity, reason = "three arrays")]
fn track_bouguet<'py>(
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
    let options = BouguetOptions::default()
        .window_size(window.0, window.1)
        .max_level(max_level)
        .criteria(iterations, epsilon)
        .min_eigenvalue(min_eigenvalue)
        .eigenvalue_as_error(eigenvalue_as_error);
    let cost = cost(2, prev.dim(), points.len(), window.0 * window.1);
    let tracks = interrupt::run(py, cost, |execution: &Execution| {
        let options = options.execution(execution.clone());
        with_pair!(views, |prev, next| lk_core::track_bouguet(
            prev,
            next,
            &points,
            initial.as_deref(),
            &options
        ))
    })?;
    let positions =
        Array2::from_shape_fn((tracks.len(), 2), |(row, axis)| tracks[row].position[axis]);
    let found: Array1<u8> = tracks.iter().map(|track| u8::from(track.found)).collect();
    let errors: Array1<f32> = tracks.iter().map(|track| track.error).collect();
    Ok((
        positions.into_pyarray(py).into_any(),
        found.into_pyarray(py).into_any(),
        errors.into_pyarray(py).into_any(),
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
    Ok(pyramid
        .levels()
        .iter()
        .map(|plane| {
            let shape = (plane.height(), plane.width());
            Array2::from_shape_fn(shape, |(y, x)| plane.row(y)[x])
                .into_pyarray(py)
                .into_any()
        })
        .collect())
}

/// Positions (N, 2) and responses (N,) of the corners of a frame, the best first.
#[pyfunction]
#[pyo3(signature = (frame, mask, max_corners, quality, min_distance, block_size, harris))]
#[allow(
    clippy::too_many_arguments,
    reason = "the arguments of the Python function"
)]
fn detect_corners<'py>(
    py: Python<'py>,
    frame: &Bound<'py, PyAny>,
    mask: Option<&Bound<'py, PyAny>>,
    max_corners: isize,
    quality: f32,
    min_distance: f32,
    block_size: isize,
    harris: Option<f32>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let frame = AnyFrame::new("frame", frame)?;
    let (height, width) = frame.dim();
    let mask = self::mask(mask, (height, width))?;
    let mask = mask.as_ref().map(PyReadonlyArray2::as_array);
    let options = corner_options(max_corners, quality, min_distance, block_size, harris)?;
    let view = frame.view();
    let corners = interrupt::run(py, cost(1, frame.dim(), 0, 0), |execution: &Execution| {
        let options = options.execution(execution.clone());
        with_view!(view, |frame| lk_core::detect_corners(frame, mask, &options))
    })?;
    let positions = Array2::from_shape_fn((corners.len(), 2), |(row, axis)| {
        corners[row].position[axis]
    });
    let responses: Array1<f32> = corners.iter().map(|corner| corner.response).collect();
    Ok((
        positions.into_pyarray(py).into_any(),
        responses.into_pyarray(py).into_any(),
    ))
}

/// Points through a sequence; see `rsflow.PointTracker`.
#[pyclass(name = "PointTracker", module = "rsflow._core")]
struct PyPointTracker {
    tracker: PointTracker,
}

#[pymethods]
impl PyPointTracker {
    #[new]
    #[pyo3(signature = (options, max_corners, quality, min_distance))]
    fn new(
        options: &Bound<'_, PyDict>,
        max_corners: isize,
        quality: f32,
        min_distance: f32,
    ) -> PyResult<Self> {
        let corner_options = corner_options(max_corners, quality, min_distance, 3, None)?;
        let tracker = PointTracker::new(track_options(options)?, corner_options)
            .map_err(|error| to_python(&error))?;
        Ok(Self { tracker })
    }

    /// Take a frame; the arrays of the result by name.
    fn update<'py>(
        &mut self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        mask: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let frame = AnyFrame::new("frame", frame)?;
        let (height, width) = frame.dim();
        let mask = self::mask(mask, (height, width))?;
        let mask = mask.as_ref().map(PyReadonlyArray2::as_array);
        let tracker = &mut self.tracker;
        let view = frame.view();
        // The tracker is borrowed for the call, which a few milliseconds a frame end well before anyone waits.
        let rows: Vec<StreamPoint> = py
            .detach(|| {
                with_view!(view, |frame| tracker.update(frame, mask)).map(<[StreamPoint]>::to_vec)
            })
            .map_err(|error| to_python(&error))?;
        let dict = to_dict(py, rows.len(), rows.iter().map(|row| row.track))?;
        let ids: Array1<i64> = rows
            .iter()
            .map(|row| i64::try_from(row.id).unwrap_or(i64::MAX))
            .collect();
        let ages: Array1<u32> = rows.iter().map(|row| row.age).collect();
        let origins = Array2::from_shape_fn((rows.len(), 2), |(row, axis)| rows[row].origin[axis]);
        dict.set_item("ids", ids.into_pyarray(py))?;
        dict.set_item("ages", ages.into_pyarray(py))?;
        dict.set_item("origins", origins.into_pyarray(py))?;
        Ok(dict)
    }

    /// Forget the frame before and its points.
    fn reset(&mut self) {
        self.tracker.reset();
    }

    /// Whether the last frame began another scene.
    #[getter]
    fn scene_cut(&self) -> bool {
        self.tracker.scene_cut()
    }
}
