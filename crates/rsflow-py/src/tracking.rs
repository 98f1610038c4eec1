//! Points: tracking between two frames, through a sequence, and corners to start from.

use lk_core::{
    CornerOptions, Deformation, Execution, Illumination, Masks, PointStatus, PointTracker,
    PyrLkOptions, TrackOptions, TrackedPoint, TrackerSnapshot,
};
use numpy::ndarray::{Ix1, Ix2, Ix3};
use numpy::{PyReadonlyArray2, PyUntypedArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{raise, to_python};
use crate::frames::{AnyFrame, aligned, described, mask, pair};
use crate::outputs::{filled, gathered};
use crate::shared::{Caller, Shared};
use crate::states::{array_plane, elements, entry, item, plane_array};
use crate::{interrupt, with_pair, with_view};

/// What memory for results holds.
const POINTS: &str = "points";

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
    module.add_function(wrap_pyfunction!(track_pyr_lk, module)?)?;
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
    value
        .cast::<PyUntypedArray>()
        .map_err(|_| unfit(name, value))?;
    let value = &aligned(value)?;
    let array = value
        .extract::<PyReadonlyArray2<'_, f32>>()
        .map_err(|_| unfit(name, value))?;
    let view = array.as_array();
    if view.ncols() != 2 {
        return Err(unfit(name, value));
    }
    gathered(POINTS, view.rows().into_iter().map(|row| [row[0], row[1]]))
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
    let deformation: Deformation = get("deformation")?
        .extract::<String>()?
        .parse()
        .map_err(|error| to_python(&error))?;
    let options = TrackOptions::default()
        .deformation(deformation)
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
    tracks: impl ExactSizeIterator<Item = TrackedPoint>,
) -> PyResult<Bound<'py, PyDict>> {
    let tracks = gathered(POINTS, tracks)?;
    let count = tracks.len();
    let matrices = |values: fn(&TrackedPoint) -> [f32; 4]| {
        filled(py, POINTS, Ix3(count, 2, 2), tracks.iter().flat_map(values))
    };
    let column =
        |value: fn(&TrackedPoint) -> f32| filled(py, POINTS, Ix1(count), tracks.iter().map(value));
    let positions = tracks.iter().flat_map(|track| track.position);
    let status = tracks.iter().map(|track| track.status as u8);
    let dict = PyDict::new(py);
    dict.set_item("points", filled(py, POINTS, Ix2(count, 2), positions)?)?;
    dict.set_item("status", filled(py, POINTS, Ix1(count), status)?)?;
    dict.set_item("residual", column(|track| track.residual)?)?;
    let covariance = matrices(|track| {
        let [xx, xy, yy] = track.covariance;
        [xx, xy, xy, yy]
    })?;
    dict.set_item("covariance", covariance)?;
    dict.set_item("forward_backward", column(|track| track.forward_backward)?)?;
    let deformation = matrices(|track| {
        let [[a, b], [c, d]] = track.deformation;
        [a, b, c, d]
    })?;
    dict.set_item("deformation", deformation)?;
    Ok(dict)
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
    let (height, width) = prev.dim();
    let mask = self::mask("mask", mask, (height, width))?;
    let next_mask = self::mask("next_mask", next_mask, (height, width))?;
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
    let level = |plane: &lk_core::Plane| {
        let shape = Ix2(plane.height(), plane.width());
        let values = plane.data().iter().copied();
        Ok(filled(py, "levels", shape, values)?.into_any())
    };
    pyramid.levels().iter().map(level).collect()
}

/// Positions (N, 2) and responses (N,) of the corners of a frame, the best first.
#[pyfunction]
#[pyo3(signature = (frame, mask, max_corners, quality, min_distance, block_size, harris, mask_corners_only=false))]
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
    mask_corners_only: bool,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let frame = AnyFrame::new("frame", frame)?;
    let (height, width) = frame.dim();
    let mask = self::mask("mask", mask, (height, width))?;
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

/// Points through a sequence; see `rsflow.PointTracker`.
#[pyclass(frozen, name = "PointTracker", module = "rsflow._core")]
struct PyPointTracker(Shared<PointTracker>);

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
        let corners = corner_options(max_corners, quality, min_distance, 3, None)?;
        let options = track_options(options)?;
        let fresh = move || {
            PointTracker::new(options.clone(), corners.clone()).map_err(|error| to_python(&error))
        };
        Ok(Self(Shared::new(fresh, PointTracker::reset)?))
    }

    /// Take a frame; the arrays of the result by name.
    fn update<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        mask: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let frame = AnyFrame::new("frame", frame)?;
        let (height, width) = frame.dim();
        let mask = self::mask("mask", mask, (height, width))?;
        let mask = mask.as_ref().map(PyReadonlyArray2::as_array);
        let view = frame.view();
        let rows = self.call(py, |tracker| {
            with_view!(view, |frame| tracker.update(frame, mask))
                .map_err(|error| to_python(&error))
                .and_then(|rows| gathered(POINTS, rows.iter().copied()))
        })?;
        let dict = to_dict(py, rows.iter().map(|row| row.track))?;
        let ids = rows
            .iter()
            .map(|row| i64::try_from(row.id).unwrap_or(i64::MAX));
        let ages = rows.iter().map(|row| row.age);
        let origins = rows.iter().flat_map(|row| row.origin);
        let count = rows.len();
        dict.set_item("ids", filled(py, POINTS, Ix1(count), ids)?)?;
        dict.set_item("ages", filled(py, POINTS, Ix1(count), ages)?)?;
        dict.set_item("origins", filled(py, POINTS, Ix2(count, 2), origins)?)?;
        Ok(dict)
    }

    /// Forget the frame before and its points.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        if self.0.renew_if_lost()? {
            return Ok(());
        }
        self.call(py, |tracker| {
            tracker.reset();
            Ok(())
        })
    }

    /// Whether the last frame began another scene.
    #[getter]
    fn scene_cut(&self, py: Python<'_>) -> PyResult<bool> {
        self.call(py, |tracker| Ok(tracker.scene_cut()))
    }

    /// What is known so far, for `restore`.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let snapshot = self.call(py, |tracker| {
            tracker.snapshot().map_err(|error| to_python(&error))
        })?;
        let count = snapshot.points.len();
        let points = snapshot.points.iter().flatten().copied();
        let (ids, ages) = (snapshot.ids.iter().copied(), snapshot.ages.iter().copied());
        let frame = snapshot.frame.as_ref();
        let state = PyDict::new(py);
        state.set_item(
            "frame",
            frame.map(|frame| plane_array(py, frame)).transpose()?,
        )?;
        let support = snapshot.support.iter().copied();
        let pixels = support.len();
        state.set_item("support", filled(py, POINTS, Ix1(pixels), support)?)?;
        state.set_item("points", filled(py, POINTS, Ix2(count, 2), points)?)?;
        state.set_item("ids", filled(py, POINTS, Ix1(count), ids)?)?;
        state.set_item("ages", filled(py, POINTS, Ix1(count), ages)?)?;
        state.set_item("next_id", snapshot.next_id)?;
        state.set_item("scene_cut", snapshot.scene_cut)?;
        Ok(state)
    }

    /// Take over what `state` gave, perhaps elsewhere.
    fn restore(&self, py: Python<'_>, state: &Bound<'_, PyDict>) -> PyResult<()> {
        let frame = item(state, "frame")?;
        let frame = Some(frame).filter(|frame| !frame.is_none());
        let points: Vec<f32> = elements::<f32, Ix2>(state, "points")?;
        let pairs = points.as_chunks::<2>().0.iter().copied();
        let snapshot = TrackerSnapshot {
            frame: frame
                .map(|frame| array_plane("frame", &frame))
                .transpose()?,
            support: elements::<u8, Ix1>(state, "support")?,
            points: gathered(POINTS, pairs)?,
            ids: elements::<u64, Ix1>(state, "ids")?,
            ages: elements::<u32, Ix1>(state, "ages")?,
            next_id: entry(state, "next_id")?,
            scene_cut: entry(state, "scene_cut")?,
        };
        self.call(py, |tracker| {
            tracker
                .restore(&snapshot)
                .map_err(|error| to_python(&error))
        })
    }
}

impl PyPointTracker {
    /// Call `work` with the tracker, on this thread: the few milliseconds that a frame takes end well before anyone
    /// waits.
    fn call<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut PointTracker) -> PyResult<R> + Send,
    ) -> PyResult<R> {
        let caller = Caller::new();
        interrupt::run(py, 0, |execution| self.0.with(caller, execution, work))
    }
}
