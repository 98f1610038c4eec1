//! Computing without the GIL, and Ctrl-C while it lasts.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use lk_core::{Error, Execution};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::errors::to_python;

/// Between two looks for a signal: a quarter of the 0.2 s within which Ctrl-C must be honoured.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Calls over fewer pixels than this end well within 0.2 s and run on the caller's own thread.
pub(crate) const LONG_CALL_PIXELS: usize = 1 << 20;

/// Run `work` without the GIL. Where `pixels` says that it may last, it runs on a thread of its own while this one
/// looks for signals; an exception from a signal handler, such as `KeyboardInterrupt`, stops the work.
pub(crate) fn run<T, F>(py: Python<'_>, pixels: usize, work: F) -> PyResult<T>
where
    T: Send,
    F: FnOnce(&Execution) -> lk_core::Result<T> + Send,
{
    if pixels < LONG_CALL_PIXELS || !on_main_thread(py)? {
        return py
            .detach(|| work(&Execution::default()))
            .map_err(|error| to_python(&error));
    }
    let flag = Arc::new(AtomicBool::new(false));
    let execution = Execution::default().cancel(Arc::clone(&flag));
    let (result, interrupted) = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, finished) = channel::<()>();
            let worker = scope.spawn(move || {
                let result = work(&execution);
                drop(done);
                result
            });
            let mut interrupted = None;
            while let Err(RecvTimeoutError::Timeout) = finished.recv_timeout(LOOK_EVERY) {
                if interrupted.is_none()
                    && let Err(error) = Python::attach(|py| py.check_signals())
                {
                    interrupted = Some(error);
                    flag.store(true, Ordering::Relaxed);
                }
            }
            (worker.join(), interrupted)
        })
    });
    if let Some(error) = interrupted {
        return Err(error);
    }
    match result {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(Error::Cancelled)) => Err(PyRuntimeError::new_err("cancelled")),
        Ok(Err(error)) => Err(to_python(&error)),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// Only the main thread runs Python's signal handlers.
fn on_main_thread(py: Python<'_>) -> PyResult<bool> {
    let threading = py.import("threading")?;
    let main: u64 = threading
        .call_method0("main_thread")?
        .getattr("ident")?
        .extract()?;
    let this: u64 = threading.call_method0("get_ident")?.extract()?;
    Ok(main == this)
}
