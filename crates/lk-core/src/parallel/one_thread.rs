//! What stands for the pools without the feature `rayon`: everything runs on the caller's thread, in order.

use crate::error::Result;

/// There are none to let go.
pub(super) fn keep_only(_wanted: usize) {}

/// What `work` returns.
///
/// # Errors
///
/// None.
pub(super) fn install<R>(_threads: usize, work: impl FnOnce() -> R) -> Result<R> {
    Ok(work())
}

/// What `work` returns.
///
/// # Errors
///
/// That of `work`.
pub(super) fn within<R>(_threads: usize, work: impl FnOnce() -> Result<R>) -> Result<R> {
    work()
}

/// What both return, one after the other.
pub(super) fn join<A, B>(first: impl FnOnce() -> A, second: impl FnOnce() -> B) -> (A, B) {
    (first(), second())
}
