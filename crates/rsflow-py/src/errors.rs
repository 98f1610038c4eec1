//! lk-core's errors as the exceptions of `rsflow.errors`.

use lk_core::Error;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// The exception of `rsflow.errors` with this name, and with this message.
pub(crate) fn raise(name: &'static str, message: String) -> PyErr {
    Python::attach(|py| {
        static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
        let class = MODULE
            .get_or_try_init(py, || Ok::<_, PyErr>(py.import("rsflow.errors")?.unbind()))
            .and_then(|module| Ok(module.bind(py).getattr(name)?.cast_into::<PyType>()?));
        match class {
            Ok(class) => PyErr::from_type(class, message),
            Err(error) => error,
        }
    })
}

/// The Python exception for an error of lk-core.
pub(crate) fn to_python(error: &Error) -> PyErr {
    let message = error.to_string();
    match error {
        Error::Shape { .. } => raise("ShapeError", message),
        Error::Option { .. } => raise("OptionError", message),
        _ => PyRuntimeError::new_err(message),
    }
}
