//! `displacement_grid` for Python.

use lk_core::{Execution, Grid, GridNode, GridOptions, GridShape, GridStatus, Illumination, Masks};
use numpy::PyReadonlyArray2;
use numpy::ndarray::{Ix2, Ix3, Ix4};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{raise, to_python};
use crate::frames::{AnyFrame, mask as borrow_mask, pair, with_pair};
use crate::interrupt;
use crate::outputs::filled;
use crate::points::{cost, points_of};

/// What memory for results holds.
const NODES: &str = "nodes";

/// Add this file's functions to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(displacement_grid, module)?)?;
    module.add_function(wrap_pyfunction!(grid_statuses, module)?)
}

/// Every status: its name and value.
#[pyfunction]
fn grid_statuses() -> Vec<(&'static str, u8)> {
    GridStatus::ALL
        .iter()
        .map(|status| (status.name(), *status as u8))
        .collect()
}

/// The motion of each node of a grid; see `rsflow.displacement_grid`.
#[pyfunction]
#[pyo3(signature = (prev, next, initial, mask, next_mask, options))]
fn displacement_grid<'py>(
    py: Python<'py>,
    prev: &Bound<'py, PyAny>,
    next: &Bound<'py, PyAny>,
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
    let initial = initial
        .map(|initial| points_of("initial", initial))
        .transpose()?;
    let options = grid_options(options)?;
    let (height, width) = prev.dim();
    let (columns, rows) = options.nodes(width, height);
    let nodes = columns.saturating_mul(rows);
    let cost = cost(8, (height, width), nodes, options.window_area());
    let grid = interrupt::run(py, cost, |execution: &Execution| {
        let options = options.execution(execution.clone());
        with_pair!(views, |prev, next| lk_core::displacement_grid(
            prev,
            next,
            initial.as_deref(),
            masks,
            &options
        ))
    })?;
    to_dict(py, &grid)
}

fn grid_options(options: &Bound<'_, PyDict>) -> PyResult<GridOptions> {
    let get = |name: &str| -> PyResult<Bound<'_, PyAny>> {
        options
            .get_item(name)?
            .ok_or_else(|| raise("OptionError", format!("{name}: missing")))
    };
    let pixels = |name: &str| -> PyResult<usize> {
        let value: isize = get(name)?.extract()?;
        Ok(usize::try_from(value).unwrap_or(0))
    };
    let shape: GridShape = get("shape")?
        .extract::<String>()?
        .parse()
        .map_err(|error| to_python(&error))?;
    let illumination: Illumination = get("illumination")?
        .extract::<String>()?
        .parse()
        .map_err(|error| to_python(&error))?;
    let options = GridOptions::default()
        .window_size(pixels("window_size")?)
        .step(pixels("step")?)
        .shape(shape)
        .robust(get("robust")?.extract()?)
        .illumination(illumination)
        .max_displacement(get("max_displacement")?.extract()?);
    options.validate().map_err(|error| to_python(&error))?;
    Ok(options)
}

/// The arrays of a result, by the names that the Python side gives them.
fn to_dict<'py>(py: Python<'py>, grid: &Grid) -> PyResult<Bound<'py, PyDict>> {
    let (rows, columns, nodes) = (grid.rows, grid.columns, &grid.nodes);
    let column = |value: fn(&GridNode) -> f32| {
        filled(py, NODES, Ix2(rows, columns), nodes.iter().map(value))
    };
    let dict = PyDict::new(py);
    dict.set_item("first", (grid.first[0], grid.first[1]))?;
    let raw = nodes.iter().flat_map(|node| node.displacement);
    dict.set_item("raw", filled(py, NODES, Ix3(rows, columns, 2), raw)?)?;
    let status = nodes.iter().map(|node| node.status as u8);
    dict.set_item("status", filled(py, NODES, Ix2(rows, columns), status)?)?;
    let gradient = nodes
        .iter()
        .flat_map(|node| node.gradient.into_iter().flatten());
    dict.set_item(
        "gradient",
        filled(py, NODES, Ix4(rows, columns, 2, 2), gradient)?,
    )?;
    let covariance = nodes
        .iter()
        .flat_map(|node| node.covariance.into_iter().flatten());
    let covariance = filled(py, NODES, Ix4(rows, columns, 6, 6), covariance)?;
    dict.set_item("joint_covariance", covariance)?;
    dict.set_item("residual", column(|node| node.residual)?)?;
    dict.set_item("correlation", column(|node| node.correlation)?)?;
    dict.set_item("gain", column(|node| node.gain)?)?;
    dict.set_item("offset", column(|node| node.offset)?)?;
    Ok(dict)
}
