//! Lines laid over pictures, for Python.

use lk_core::Ink;
use numpy::{PyReadonlyArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use crate::interrupt;

/// Add this file's names to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(lay_ink, module)?)
}

/// Lay lines over a picture, in place.
#[pyfunction]
fn lay_ink(
    py: Python<'_>,
    mut picture: PyReadwriteArray3<'_, u8>,
    ink: PyReadonlyArray2<'_, u8>,
    rim: PyReadonlyArray2<'_, u8>,
    which: Option<PyReadonlyArray2<'_, u8>>,
    colors: Vec<[u8; 3]>,
) -> PyResult<()> {
    let picture = picture.as_array_mut();
    let lines = Ink {
        ink: ink.as_array(),
        rim: rim.as_array(),
        which: which.as_ref().map(|which| which.as_array()),
        colors: &colors,
    };
    interrupt::run(py, 0, |_| lk_core::lay_ink(picture, lines))
}
