//! Threads: only here and in [`keep_warm`] is rayon named. Work is split into bands of rows or chunks of points.
//!
//! The pools belong to one process: after `fork()` the child builds its own. Where one thread is enough the work runs
//! on the caller's thread and no pool is touched. A band never reads what another band writes, and no sum crosses a
//! row, so the number of bands cannot change a bit of a result.

mod keep_warm;
mod split;

use std::ops::Range;
use std::sync::atomic::AtomicUsize;
use std::sync::{Arc, LazyLock};

use arc_swap::ArcSwap;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::threads::{self, num_threads};

use keep_warm::{Call, join};
pub(crate) use split::{EvenRows, RowsMut, SplitRows};

/// Shortest bands, of about 10 us or more each, between two looks at a cancel flag.
const CANCELLABLE_BAND: usize = 16;

/// The pools of one process, by thread count: that of the last call, and that of calls that do not say otherwise. Others
/// are let go, and their threads end once the last call that uses them does.
struct Pools {
    process: u32,
    by_threads: Vec<(usize, Arc<Pool>)>,
}

struct Pool {
    threads: ThreadPool,
    /// Calls of [`within_pool`] that are under way.
    calls: AtomicUsize,
}

static POOLS: LazyLock<ArcSwap<Pools>> = LazyLock::new(|| {
    ArcSwap::from_pointee(Pools {
        process: std::process::id(),
        by_threads: Vec::new(),
    })
});

/// Set the number of threads of all calls that do not say otherwise; 0 means one for each CPU.
///
/// # Errors
///
/// [`Error::Option`] for more than [`MAX_THREADS`](crate::MAX_THREADS).
pub fn set_num_threads(threads: usize) -> Result<()> {
    threads::request(threads)?;
    let (process, wanted) = (std::process::id(), num_threads());
    // The pools of a parent cannot be let go: see `pool`.
    if POOLS.load().process == process {
        POOLS.rcu(|pools| pools.kept(process, |count| count == wanted));
    }
    Ok(())
}

impl Pools {
    /// Those whose count is wanted; none of another process.
    fn kept(&self, process: u32, wanted: impl Fn(usize) -> bool) -> Self {
        let own = self.by_threads.iter().filter(|_| self.process == process);
        Self {
            process,
            by_threads: own.filter(|(count, _)| wanted(*count)).cloned().collect(),
        }
    }
}

/// The pool of `threads` threads of this process.
fn pool(threads: usize) -> Result<Arc<Pool>> {
    let process = std::process::id();
    let current = POOLS.load_full();
    if current.process == process
        && let Some((_, pool)) = current
            .by_threads
            .iter()
            .find(|(count, _)| *count == threads)
    {
        return Ok(Arc::clone(pool));
    }
    let built = ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|index| format!("lk-core-{index}"))
        .build()
        .map_err(|error| Error::Threads {
            threads,
            reason: error.to_string(),
        })?;
    let built = Arc::new(Pool {
        threads: built,
        calls: AtomicUsize::new(0),
    });
    let usual = num_threads();
    POOLS.rcu(|pools| {
        let mut pools = pools.kept(process, |count| count == threads || count == usual);
        if !pools.by_threads.iter().any(|(count, _)| *count == threads) {
            pools.by_threads.push((threads, Arc::clone(&built)));
        }
        pools
    });
    if current.process != process {
        // The threads of these pools stayed in the parent; to drop them would wait on locks that nobody holds here.
        std::mem::forget(current);
    }
    Ok(built)
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
/// [`Error::Cancelled`] if the cancel flag was raised before the last band began, [`Error::Threads`] if no pool could
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
    pool(threads)?
        .threads
        .install(|| halve(execution, 0..rows, band, outputs, &work))
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
/// [`Error::Threads`] if no pool could be started.
pub(crate) fn within_pool<R: Send>(
    execution: &Execution,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    execution.check()?;
    let threads = execution.num_threads();
    if threads == 1 {
        return work();
    }
    let pool = pool(threads)?;
    let call = Call::begin(&pool.calls);
    pool.threads.install(|| call.run(threads - 1, work))
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
/// [`Error::Threads`] if no pool could be started.
pub(crate) fn both<A: Send, B: Send>(
    execution: &Execution,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> Result<(A, B)> {
    match execution.num_threads() {
        1 => Ok((first(), second())),
        threads => Ok(pool(threads)?.threads.install(|| join(first, second))),
    }
}

#[cfg(test)]
mod tests;
