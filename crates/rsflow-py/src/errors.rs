//! lk-core's errors, and panics, as the exceptions of `rsflow.errors`.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;

use lk_core::Error;
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
    let name = match error {
        Error::Shape { .. } => "ShapeError",
        Error::Option { .. } => "OptionError",
        Error::Memory { .. } => "OutOfMemoryError",
        _ => "RsflowError",
    };
    raise(name, error.to_string())
}

/// The Python exception for what must not happen.
pub(crate) fn fault(what: &str) -> PyErr {
    raise(
        "InternalError",
        format!(
            "{what}: this is a fault of rsflow {}, not of the call; please report it with what was passed",
            env!("CARGO_PKG_VERSION")
        ),
    )
}

/// What the last panic said and where, of any thread.
static LAST_PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Keep what panics say for the exception that [`caught`] makes of them, in place of printing it.
pub(crate) fn keep_panics() {
    std::panic::set_hook(Box::new(|panic| {
        // A lock that is held, as by a thread that a fork left behind, is not waited for.
        if let Ok(mut last) = LAST_PANIC.try_lock() {
            *last = Some(panic.to_string().replace('\n', " "));
        }
    }));
}

/// Call `work`; a panic in it, or in a thread that it waits for, is an exception.
pub(crate) fn caught<T>(work: impl FnOnce() -> T) -> PyResult<T> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|_| {
        let said = LAST_PANIC.try_lock().ok().and_then(|mut last| last.take());
        fault(said.as_deref().unwrap_or("panicked"))
    })
}
