//! What streaming objects know, as Python keeps it: a damaged one is an error that names the part.

use lk_core::Plane;
use numpy::ndarray::{Dimension, Ix2};
use numpy::{Element, PyArray2, PyReadonlyArray, PyUntypedArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{raise, to_python};
use crate::frames::{aligned, described};
use crate::outputs::{filled, gathered};

/// The grey levels of `plane`.
pub(crate) fn plane_array<'py>(
    py: Python<'py>,
    plane: &Plane,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let shape = Ix2(plane.height(), plane.width());
    filled(py, "grey levels", shape, plane.data().iter().copied())
}

/// The plane of an array that [`plane_array`] gave.
pub(crate) fn array_plane(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Plane> {
    let array = array::<f32, Ix2>(name, value)?;
    let view = array.as_array();
    let (height, width) = view.dim();
    let mut plane = Plane::new(width, height).map_err(|error| to_python(&error))?;
    for (to, from) in plane.data_mut().iter_mut().zip(view.iter()) {
        *to = *from;
    }
    Ok(plane)
}

/// The elements of an array, row by row.
pub(crate) fn elements<T: Element + Copy, D: Dimension>(
    state: &Bound<'_, PyDict>,
    name: &str,
) -> PyResult<Vec<T>> {
    let array = array::<T, D>(name, &item(state, name)?)?;
    let view = array.as_array();
    gathered("a state", view.iter().copied())
}

fn array<'py, T: Element, D: Dimension>(
    name: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<PyReadonlyArray<'py, T, D>> {
    let unfit = || damaged(name, &described(value));
    value.cast::<PyUntypedArray>().map_err(|_| unfit())?;
    let array = aligned(value)?.extract::<PyReadonlyArray<'py, T, D>>();
    array.map_err(|_| unfit())
}

/// The part `name` of a state.
pub(crate) fn item<'py>(state: &Bound<'py, PyDict>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    state
        .get_item(name)?
        .ok_or_else(|| damaged(name, "nothing"))
}

/// The part `name` of a state, as a value of Rust.
pub(crate) fn entry<'py, T: for<'a> FromPyObject<'a, 'py>>(
    state: &Bound<'py, PyDict>,
    name: &str,
) -> PyResult<T> {
    let value = item(state, name)?;
    value
        .extract()
        .map_err(|_| damaged(name, &described(&value)))
}

fn damaged(name: &str, got: &str) -> PyErr {
    let message = format!("state: {name}: got {got}, expected what a state of this version has");
    raise("FormatError", message)
}
