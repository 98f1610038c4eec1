//! The pools of threads.
//!
//! They belong to one process: after `fork()` the child builds its own.

use std::sync::atomic::AtomicUsize;
use std::sync::{Arc, LazyLock};

use arc_swap::ArcSwap;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};
use crate::threads::num_threads;

use super::keep_warm::Call;
pub(super) use super::keep_warm::join;

/// The pools of one process, by thread count: that of the last call, and that of calls that do not say otherwise. Others
/// are let go, and their threads end once the last call that uses them does.
struct Pools {
    process: u32,
    by_threads: Vec<(usize, Arc<Pool>)>,
}

pub(super) struct Pool {
    threads: ThreadPool,
    /// Calls of [`within`] that are under way.
    pub(super) calls: AtomicUsize,
}

static POOLS: LazyLock<ArcSwap<Pools>> = LazyLock::new(|| {
    ArcSwap::from_pointee(Pools {
        process: std::process::id(),
        by_threads: Vec::new(),
    })
});

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

/// Let go of all pools but that of `wanted` threads.
pub(super) fn keep_only(wanted: usize) {
    let process = std::process::id();
    // The pools of a parent cannot be let go: see `pool`.
    if POOLS.load().process == process {
        POOLS.rcu(|pools| pools.kept(process, |count| count == wanted));
    }
}

/// The pool of `threads` threads of this process.
pub(super) fn pool(threads: usize) -> Result<Arc<Pool>> {
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

/// What `work` returns, called on a thread of the pool of `threads`.
///
/// # Errors
///
/// [`Error::Threads`] if no pool could be started.
pub(super) fn install<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> Result<R> {
    Ok(pool(threads)?.threads.install(work))
}

/// [`install`] that keeps the other threads of the pool warm for what `work` divides.
///
/// # Errors
///
/// [`Error::Threads`] if no pool could be started; that of `work`.
pub(super) fn within<R: Send>(
    threads: usize,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    let pool = pool(threads)?;
    let call = Call::begin(&pool.calls);
    pool.threads.install(|| call.run(threads - 1, work))
}
