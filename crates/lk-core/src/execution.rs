//! How a call runs: on how many threads, with which instructions, and until when.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{Error, Result};
use crate::simd::SimdLevel;

/// How a call runs. None of it changes a bit of the result.
///
/// ```
/// use lk_core::{Execution, SimdLevel};
///
/// let plain = Execution::default().threads(1).level(SimdLevel::Baseline);
/// assert_eq!(plain.simd_level(), SimdLevel::Baseline);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Execution {
    threads: usize,
    level: Option<SimdLevel>,
    cancel: Option<Arc<AtomicBool>>,
}

impl Execution {
    /// Threads to use, at most [`crate::MAX_THREADS`]; 0, the default, follows [`crate::set_num_threads`].
    #[must_use]
    pub fn threads(mut self, threads: usize) -> Self {
        self.threads = threads;
        self
    }

    /// Instructions to use; a level that this CPU lacks falls back to the best that it has.
    #[must_use]
    pub fn level(mut self, level: SimdLevel) -> Self {
        self.level = Some(level.min(SimdLevel::detected()).here());
        self
    }

    /// A flag that stops the call with [`Error::Cancelled`] once it is true.
    #[must_use]
    pub fn cancel(mut self, flag: Arc<AtomicBool>) -> Self {
        self.cancel = Some(flag);
        self
    }

    /// Threads that a call with this setting uses; one without the feature `rayon`.
    #[must_use]
    pub fn num_threads(&self) -> usize {
        if self.threads == 0 {
            crate::threads::num_threads()
        } else {
            self.threads.min(crate::threads::AVAILABLE)
        }
    }

    /// Instructions that a call with this setting uses.
    #[must_use]
    pub fn simd_level(&self) -> SimdLevel {
        self.level.unwrap_or_else(SimdLevel::detected)
    }

    /// Whether there is a flag to look at.
    pub(crate) fn is_cancellable(&self) -> bool {
        self.cancel.is_some()
    }

    /// Whether a call may go on.
    ///
    /// # Errors
    ///
    /// [`Error::Cancelled`] once the cancel flag is true, [`Error::Option`] where the environment asks for instructions
    /// that are none, or the caller for too many threads.
    pub fn check(&self) -> Result<()> {
        crate::threads::check_threads(self.threads)?;
        if self.level.is_none() {
            SimdLevel::of_environment()?;
        }
        match &self.cancel {
            Some(flag) if flag.load(Ordering::Relaxed) => Err(Error::Cancelled),
            _ => Ok(()),
        }
    }
}
