//! Computing without the GIL, and Ctrl-C while it lasts.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use lk_core::{Error, Execution};
use pyo3::prelude::*;

use crate::errors::{caught, fault, to_python};

/// Between two looks for a signal: a quarter of the 0.2 s within which Ctrl-C must be honoured.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);

/// Calls over fewer pixels than this end well within 0.2 s and run on the caller's own thread.
pub(crate) const LONG_CALL_PIXELS: usize = 1 << 20;

thread_local! {
    /// How many callers work at the same time, this one among them.
    static BESIDE: Cell<usize> = const { Cell::new(1) };
}

/// From now on calls of this thread keep to it, unless there are more threads than callers that work at the same time: to hand
/// rows to threads that are busy for another caller costs more than it gains.
pub(crate) fn share_threads(callers: usize) {
    BESIDE.set(callers.max(1));
}

/// An execution of this thread's calls.
fn execution() -> Execution {
    let callers = BESIDE.get();
    if callers > 1 && lk_core::num_threads() <= callers {
        return Execution::default().threads(1);
    }
    Execution::default()
}

/// What becomes an exception.
pub(crate) trait Raised {
    fn raised(self) -> PyErr;
}

impl Raised for Error {
    fn raised(self) -> PyErr {
        to_python(&self)
    }
}

impl Raised for PyErr {
    fn raised(self) -> PyErr {
        self
    }
}

/// Run `work` without the GIL. Where `pixels` says that it may last, it runs on a thread of its own while this one
/// looks for signals; an exception from a signal handler, such as `KeyboardInterrupt`, stops the work. A panic in it is
/// an exception like any other.
pub(crate) fn run<T, E, F>(py: Python<'_>, pixels: usize, work: F) -> PyResult<T>
where
    T: Send,
    E: Raised,
    F: FnOnce(&Execution) -> Result<T, E> + Send,
{
    let work = |execution: &Execution| caught(|| work(execution))?.map_err(Raised::raised);
    if pixels < LONG_CALL_PIXELS || !on_main_thread(py)? {
        let execution = execution();
        return py.detach(|| work(&execution));
    }
    let flag = Arc::new(AtomicBool::new(false));
    let execution = execution().cancel(Arc::clone(&flag));
    let (result, interrupted) = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, finished) = channel::<()>();
            let worker = std::thread::Builder::new().spawn_scoped(scope, move || {
                let result = work(&execution);
                drop(done);
                result
            });
            let worker = match worker {
                Ok(worker) => worker,
                Err(error) => {
                    let reason = error.to_string();
                    return (Err(to_python(&Error::Threads { threads: 1, reason })), None);
                }
            };
            let mut interrupted = None;
            while let Err(RecvTimeoutError::Timeout) = finished.recv_timeout(SIGNAL_INTERVAL) {
                if interrupted.is_none()
                    && let Err(error) = Python::attach(|py| py.check_signals())
                {
                    interrupted = Some(error);
                    flag.store(true, Ordering::Relaxed);
                }
            }
            let joined = worker.join();
            (
                joined.unwrap_or_else(|_| Err(fault("panicked"))),
                interrupted,
            )
        })
    });
    if let Some(error) = interrupted {
        return Err(error);
    }
    result
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
