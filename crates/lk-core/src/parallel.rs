//! Threads: work is split into bands of rows or chunks of points. Only `pool` and `keep_warm` name rayon; without that
//! feature all of it runs on the caller's thread.
//!
//! Where one thread is enough the work runs on the caller's thread and no pool is touched. A band never reads what
//! another band writes, and no sum crosses a row, so the number of bands cannot change a bit of a result.

#[cfg(feature = "rayon")]
mod keep_warm;
#[cfg(feature = "rayon")]
mod pool;
#[cfg(not(feature = "rayon"))]
#[path = "parallel/one_thread.rs"]
mod pool;
mod split;

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::threads::{self, num_threads};

use pool::join;
pub(crate) use split::{EvenRows, RowsMut, SplitRows};

/// Shortest bands, of about 10 us or more each, between two looks at a cancel flag.
const CANCELLABLE_BAND: usize = 16;

/// Set the number of threads of all calls that do not say otherwise; 0 means one for each CPU. Without the feature
/// `rayon` it stays one.
///
/// # Errors
///
/// [`Error::Option`](crate::Error::Option) for more than [`MAX_THREADS`](crate::MAX_THREADS).
pub fn set_num_threads(threads: usize) -> Result<()> {
    threads::request(threads)?;
    pool::keep_only(num_threads());
    Ok(())
}

/// What the work on a band comes to.
pub(crate) trait Outcome {
    /// As a result.
    fn result(self) -> Result<()>;
}

impl Outcome for () {
    fn result(self) -> Result<()> {
        Ok(())
    }
}

impl Outcome for Result<()> {
    fn result(self) -> Self {
        self
    }
}

/// Call `work(rows, part)` for bands that together are `0..rows`, each with its own part of `outputs`.
///
/// A band has at least `min_rows` rows where there are as many; choose it so that a band costs well above the 10 us
/// that it takes to hand it to another thread.
///
/// # Errors
///
/// [`Error::Cancelled`](crate::Error::Cancelled) if the cancel flag was raised before the last band began, [`Error::Threads`](crate::Error::Threads) if no pool could
/// be started, that of a band that failed.
pub(crate) fn for_each_band<S, F, R>(
    execution: &Execution,
    rows: usize,
    min_rows: usize,
    outputs: S,
    work: F,
) -> Result<()>
where
    S: SplitRows,
    F: Fn(Range<usize>, S) -> R + Sync,
    R: Outcome,
{
    execution.check()?;
    let threads = execution.num_threads();
    let min_rows = min_rows.max(1);
    if rows == 0 {
        return Ok(());
    }
    // A call that can be cancelled must come by the flag often, however few threads share the rows.
    let longest = if execution.is_cancellable() {
        CANCELLABLE_BAND.saturating_mul(min_rows)
    } else {
        rows
    };
    if threads == 1 || rows <= min_rows {
        return one_by_one(execution, 0..rows, longest, outputs, &work);
    }
    // Four bands a thread level out bands of unequal cost; as many for each thread, so that none waits for the last one.
    let most = (rows / min_rows).clamp(1, 4 * threads);
    let bands = if most < threads {
        most
    } else {
        most - most % threads
    };
    let band = rows.div_ceil(bands).min(longest);
    pool::install(threads, || halve(execution, 0..rows, band, outputs, &work))?
}

/// The `min_rows` of [`for_each_band`] where all rows cost alike: two bands a thread, so that a thread that is held up
/// leaves one to another, unless they had fewer than `long` rows; then one, of at least `short` rows.
pub(crate) fn even_bands(execution: &Execution, rows: usize, [long, short]: [usize; 2]) -> usize {
    let threads = execution.num_threads();
    let half = rows.div_ceil(2 * threads);
    if half >= long {
        half
    } else {
        rows.div_ceil(threads).max(short)
    }
}

/// The bands in order, on the caller's thread.
fn one_by_one<S, F, R>(
    execution: &Execution,
    rows: Range<usize>,
    band: usize,
    mut outputs: S,
    work: &F,
) -> Result<()>
where
    S: SplitRows,
    F: Fn(Range<usize>, S) -> R + Sync,
    R: Outcome,
{
    let mut start = rows.start;
    while rows.end - start > band {
        execution.check()?;
        let (part, rest) = outputs.split_at_row(band);
        work(start..start + band, part).result()?;
        outputs = rest;
        start += band;
    }
    execution.check()?;
    work(start..rows.end, outputs).result()
}

/// Call `work` where [`for_each_band`] with the same setting hands nothing over from outside of its pool, and keep the
/// other threads of the pool warm for what it divides: to wake one costs tens of microseconds.
///
/// # Errors
///
/// [`Error::Threads`](crate::Error::Threads) if no pool could be started.
pub(crate) fn within_pool<R: Send>(
    execution: &Execution,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    execution.check()?;
    let threads = execution.num_threads();
    if threads == 1 {
        return work();
    }
    pool::within(threads, work)
}

fn halve<S, F, R>(
    execution: &Execution,
    rows: Range<usize>,
    band: usize,
    outputs: S,
    work: &F,
) -> Result<()>
where
    S: SplitRows,
    F: Fn(Range<usize>, S) -> R + Sync,
    R: Outcome,
{
    execution.check()?;
    if rows.len() <= band {
        return work(rows, outputs).result();
    }
    let bands = rows.len().div_ceil(band);
    let middle = rows.start + (bands / 2) * band;
    let (above, below) = outputs.split_at_row(middle - rows.start);
    let (first, second) = join(
        || halve(execution, rows.start..middle, band, above, work),
        || halve(execution, middle..rows.end, band, below, work),
    );
    first.and(second)
}

/// What both return, called at the same time where a thread is free.
///
/// # Errors
///
/// [`Error::Threads`](crate::Error::Threads) if no pool could be started.
pub(crate) fn both<A: Send, B: Send>(
    execution: &Execution,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> Result<(A, B)> {
    match execution.num_threads() {
        1 => Ok((first(), second())),
        threads => pool::install(threads, || join(first, second)),
    }
}

#[cfg(test)]
mod tests;
