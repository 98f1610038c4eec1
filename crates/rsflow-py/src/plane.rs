//! The motion of a camera over a plane, for Python.

use lk_core::{
    Distortion, Lens, PlaneFit, PlaneInterval, PlaneMatch, PlaneMotion, PlaneNumber, PlaneOptions,
    PlaneTileStatus, PlaneTracker,
};
use numpy::ndarray::{Ix1, Ix2};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::errors::{raise, to_python};
use crate::frames::{AnyFrame, mask as borrow_mask, with_view};
use crate::interrupt;
use crate::outputs::{filled, gathered};
use crate::shared::{Caller, Shared};

/// What memory for tiles holds.
const TILES: &str = "tiles";

/// Add this file's names to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyPlaneTracker>()?;
    module.add_function(wrap_pyfunction!(fit_plane, module)?)?;
    module.add_function(wrap_pyfunction!(plane_tile_statuses, module)?)
}

/// Every status of a tile: its name and value.
#[pyfunction]
fn plane_tile_statuses() -> Vec<(&'static str, u8)> {
    PlaneTileStatus::ALL
        .iter()
        .map(|status| (status.name(), *status as u8))
        .collect()
}

/// Motion, normal matrix, pull, for each number its response (right side, score, curvatures); scale, widened, residual, correlation, settled; a row for each tile (middle,
/// displacement, residual, weight, information, correlation) and its status.
type Found<'py> = (
    (
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray2<f64>>,
    ),
    (f64, f64, f64, f64, bool),
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<u8>>),
);

/// What is known of the camera between two frames: turn, down, readout, growth; where to begin; levels; what is known of the
/// rotation, and its covariance; numbers whose effect is wanted: of the lens from 0 on, -1 and -2 for down, -3
/// for the readout.
#[derive(FromPyObject)]
struct Task(
    ([f64; 3], [f64; 3], f64, [f64; 3]),
    PlaneMotion,
    usize,
    ([f64; 3], [[f64; 3]; 3]),
    Vec<isize>,
);

impl Task {
    fn taken(self) -> (PlaneInterval, PlaneMotion, PlaneOptions) {
        let Self((turn, down, readout, growth), start, levels, (rotation, covariance), numbers) =
            self;
        let numbers = numbers
            .into_iter()
            .map(|number| match number {
                -1 => PlaneNumber::Down(0),
                -2 => PlaneNumber::Down(1),
                -3 => PlaneNumber::Readout,
                other => PlaneNumber::Lens(other.unsigned_abs()),
            })
            .collect();
        let interval = PlaneInterval::default()
            .turn(turn)
            .down(down)
            .rolling_shutter(readout)
            .growth(growth);
        let options = PlaneOptions::default()
            .levels(levels)
            .rotation(rotation)
            .rotation_covariance(covariance)
            .responses(numbers);
        (interval, start, options)
    }
}

fn lens_of(model: &str, focal: [f64; 2], centre: [f64; 2], coefficients: &[f64]) -> PyResult<Lens> {
    let mut all = [0.0; 12];
    if coefficients.len() > all.len() || (model == "fisheye" && coefficients.len() > 4) {
        let got = format!("distortion: got {} coefficients", coefficients.len());
        return Err(raise("OptionError", format!("{got}, expected fewer")));
    }
    all[..coefficients.len()].copy_from_slice(coefficients);
    let distortion = match model {
        "fisheye" => Distortion::Fisheye([all[0], all[1], all[2], all[3]]),
        _ => Distortion::Brown(all),
    };
    Lens::new(focal, centre, distortion).map_err(|error| to_python(&error))
}

/// The motion over a plane, frame by frame.
#[pyclass(frozen, name = "PlaneTracker", module = "rsflow._core")]
struct PyPlaneTracker(Shared<PlaneTracker>);

#[pymethods]
impl PyPlaneTracker {
    #[new]
    #[pyo3(signature = (model, focal, centre, coefficients))]
    fn new(
        model: &str,
        focal: [f64; 2],
        centre: [f64; 2],
        coefficients: Vec<f64>,
    ) -> PyResult<Self> {
        let lens = lens_of(model, focal, centre, &coefficients)?;
        Ok(Self(Shared::new(
            move || Ok(PlaneTracker::new(lens)),
            PlaneTracker::reset,
        )?))
    }

    /// Take the next frame.
    fn push(
        &self,
        py: Python<'_>,
        frame: &Bound<'_, PyAny>,
        mask: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let frame = AnyFrame::new("image", frame)?;
        let mask = borrow_mask("mask", mask, frame.dim())?;
        let mask = mask.as_ref().map(PyReadonlyArray2::as_array);
        let view = frame.view();
        let caller = Caller::new();
        interrupt::run(py, 0, |execution| {
            self.0.with(caller, execution, |tracker| {
                with_view!(view, |frame| tracker.push(frame, mask, execution))
                    .map_err(|error| to_python(&error))
            })
        })
    }

    /// Take the last frame back.
    fn take_back(&self, py: Python<'_>) -> PyResult<()> {
        let caller = Caller::new();
        interrupt::run(py, 0, |execution| {
            self.0.with(caller, execution, |tracker| {
                tracker.take_back();
                Ok::<(), PyErr>(())
            })
        })
    }

    /// Forget all frames.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        if self.0.renew_if_lost()? {
            return Ok(());
        }
        let caller = Caller::new();
        interrupt::run(py, 0, |execution| {
            self.0.with(caller, execution, |tracker| {
                tracker.reset();
                Ok::<(), PyErr>(())
            })
        })
    }

    /// The motion between the last two frames.
    fn motion<'py>(&self, py: Python<'py>, task: Task) -> PyResult<Option<Found<'py>>> {
        let (interval, start, options) = task.taken();
        let caller = Caller::new();
        let fit = interrupt::run(py, 0, |execution| {
            self.0.with(caller, execution, |tracker| {
                tracker
                    .motion(&interval, &start, &options.execution(execution.clone()))
                    .map_err(|error| to_python(&error))
            })
        })?;
        fit.map(|fit| found(py, &fit)).transpose()
    }
}

/// The motion over a plane from points: rows of x, y in the first frame, x, y in the second, covariance xx, xy, yy.
#[pyfunction]
#[allow(
    clippy::too_many_arguments,
    reason = "the arguments of the Python function"
)]
#[pyo3(signature = (model, focal, centre, coefficients, rows, matches, task))]
fn fit_plane<'py>(
    py: Python<'py>,
    model: &str,
    focal: [f64; 2],
    centre: [f64; 2],
    coefficients: Vec<f64>,
    rows: usize,
    matches: PyReadonlyArray2<'py, f64>,
    task: Task,
) -> PyResult<Option<Found<'py>>> {
    let lens = lens_of(model, focal, centre, &coefficients)?;
    let view = matches.as_array();
    let values: Vec<f64> = gathered("points", view.iter().copied())?;
    let matches: Vec<PlaneMatch> = values
        .as_chunks::<7>()
        .0
        .iter()
        .map(|[a, b, c, d, xx, xy, yy]| PlaneMatch {
            prev: [*a, *b],
            next: [*c, *d],
            covariance: [*xx, *xy, *yy],
        })
        .collect();
    let (interval, start, options) = task.taken();
    let fit = interrupt::run(py, 0, |_| {
        lk_core::fit_plane(&matches, rows, &lens, &interval, &start, &options)
    })?;
    fit.map(|fit| found(py, &fit)).transpose()
}

fn found<'py>(py: Python<'py>, fit: &PlaneFit) -> PyResult<Found<'py>> {
    let count = fit.tiles.len();
    let rows = fit.tiles.iter().flat_map(|tile| {
        let [mx, my] = tile.middle;
        let [dx, dy] = tile.displacement;
        let [rx, ry] = tile.residual;
        let [xx, xy, yy] = tile.information;
        [
            mx,
            my,
            dx,
            dy,
            rx,
            ry,
            tile.weight,
            xx,
            xy,
            yy,
            tile.correlation,
        ]
    });
    let responses = fit.responses.iter().flat_map(|response| {
        let score = std::iter::once(&response.score);
        let right = response.right.iter().chain(score);
        right.chain(&response.curvature).copied()
    });
    let known = fit.responses.len();
    let normal = fit.normal.iter().flatten().copied();
    let statuses = fit.tiles.iter().map(|tile| tile.status as u8);
    Ok((
        (
            filled(py, TILES, Ix1(6), fit.motion.iter().copied())?,
            filled(py, TILES, Ix2(6, 6), normal)?,
            filled(py, TILES, Ix1(6), fit.pull.iter().copied())?,
            filled(py, TILES, Ix2(known, 7 + known), responses)?,
        ),
        (
            fit.scale,
            fit.widened,
            fit.residual,
            fit.correlation,
            fit.settled,
        ),
        (
            filled(py, TILES, Ix2(count, 11), rows)?,
            filled(py, TILES, Ix1(count), statuses)?,
        ),
    ))
}
