//! Arrays for Python, whose memory may be refused.

use lk_core::Error;
use numpy::ndarray::{Array, Dimension};
use numpy::{Element, IntoPyArray, PyArray};
use pyo3::prelude::*;

use crate::errors::to_python;

/// As many values as the iterator says that it has.
pub(crate) fn gathered<T>(
    what: &'static str,
    values: impl ExactSizeIterator<Item = T>,
) -> PyResult<Vec<T>> {
    taken(what, values.len(), values)
}

fn with_room<T>(what: &'static str, count: usize) -> PyResult<Vec<T>> {
    let mut memory = Vec::new();
    memory.try_reserve_exact(count).map_err(|_| {
        to_python(&Error::Memory {
            what,
            bytes: count.saturating_mul(size_of::<T>()),
        })
    })?;
    Ok(memory)
}

fn taken<T>(what: &'static str, count: usize, values: impl Iterator<Item = T>) -> PyResult<Vec<T>> {
    let mut memory = with_room(what, count)?;
    memory.extend(values.take(count));
    Ok(memory)
}

/// An array of `shape` with these values, row by row.
pub(crate) fn filled<'py, T: Element, D: Dimension>(
    py: Python<'py>,
    what: &'static str,
    shape: D,
    values: impl Iterator<Item = T>,
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    let count = shape.size();
    owned(py, shape, taken(what, count, values)?)
}

/// An array of `shape` over this memory.
pub(crate) fn owned<'py, T: Element, D: Dimension>(
    py: Python<'py>,
    shape: D,
    values: Vec<T>,
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    let array = Array::from_shape_vec(shape, values)
        .map_err(|error| crate::errors::fault(&error.to_string()))?;
    Ok(array.into_pyarray(py))
}
