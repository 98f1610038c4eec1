//! Points, their options and results as Python has them.

use lk_core::{CornerOptions, Deformation, Illumination, TrackOptions, TrackedPoint};
use numpy::ndarray::{Ix1, Ix2, Ix3};
use numpy::{PyReadonlyArray2, PyUntypedArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{raise, to_python};
use crate::frames::{aligned, described};
use crate::outputs::{filled, gathered};

/// What memory for results holds.
pub(crate) const POINTS: &str = "points";

/// Pixels of a frame, or of the windows of its points, that cost as much as one of those by which [`interrupt::run`]
/// counts: a pyramid or corners take some 3 ns a pixel, a point some 20 ns a pixel of its window.
const FRAME_PIXELS: usize = 1 << 4;
const WINDOW_PIXELS: usize = 1 << 3;

/// The cost of a call over this many frames, points and pixels a window, for [`interrupt::run`].
pub(crate) fn cost(
    frames: usize,
    (height, width): (usize, usize),
    points: usize,
    window: usize,
) -> usize {
    (frames * height * width / FRAME_PIXELS)
        .saturating_add(points.saturating_mul(window) / WINDOW_PIXELS)
}

/// An (N, 2) float32 array as points.
pub(crate) fn points_of(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<[f32; 2]>> {
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

/// An option that Python gives as any whole number.
fn fallback(name: &'static str, value: Option<isize>) -> PyResult<Option<usize>> {
    value
        .map(|value| {
            usize::try_from(value)
                .map_err(|_| to_python(&lk_core::Error::option(name, value, "not less than 0")))
        })
        .transpose()
}

/// The options that both the function and the tracker take.
pub(crate) fn track_options(options: &Bound<'_, PyDict>) -> PyResult<TrackOptions> {
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

pub(crate) fn corner_options(
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
pub(crate) fn to_dict<'py>(
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
