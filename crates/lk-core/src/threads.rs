//! How many threads calls use that do not say otherwise.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::error::{Error, Result};

/// Most threads of a call: each has memory of its own, and more than there are CPUs gain nothing.
pub const MAX_THREADS: usize = 1024;

/// Threads that a call can have: without the feature `rayon`, that of its caller.
pub(crate) const AVAILABLE: usize = if cfg!(feature = "rayon") {
    MAX_THREADS
} else {
    1
};

/// What was asked for; 0 for one for each CPU.
static REQUESTED: AtomicUsize = AtomicUsize::new(0);

/// Ask for so many threads; 0 means one for each CPU.
///
/// # Errors
///
/// [`Error::Option`] for more than [`MAX_THREADS`].
pub(crate) fn request(threads: usize) -> Result<()> {
    check_threads(threads)?;
    REQUESTED.store(threads, Ordering::Relaxed);
    Ok(())
}

/// Hold a number of threads to the limit.
///
/// # Errors
///
/// [`Error::Option`] for more than [`MAX_THREADS`].
pub(crate) fn check_threads(threads: usize) -> Result<()> {
    if threads <= MAX_THREADS {
        return Ok(());
    }
    Err(Error::option(
        "threads",
        threads,
        format!("1 to {MAX_THREADS}, or 0 for one for each CPU"),
    ))
}

/// The number of threads of all calls that do not say otherwise; how many CPUs there are is asked once. Without the
/// feature `rayon` it is one.
#[must_use]
pub fn num_threads() -> usize {
    // Asking reads files of the control groups: about 30 us, and every band of rows would pay it.
    static CPUS: OnceLock<usize> = OnceLock::new();
    match REQUESTED.load(Ordering::Relaxed) {
        0 => *CPUS.get_or_init(|| {
            std::thread::available_parallelism()
                .map_or(1, std::num::NonZero::get)
                .min(AVAILABLE)
        }),
        threads => threads.min(AVAILABLE),
    }
}
