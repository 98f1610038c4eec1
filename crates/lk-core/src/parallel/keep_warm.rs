//! Threads that are kept warm during a call: to wake one takes tens of microseconds, more than a band of a small level.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rayon::Yield;

use crate::error::{Error, Result};

/// A call of [`within_pool`](super::within_pool).
pub(super) struct Call<'a> {
    /// Calls of its pool that are under way.
    calls: &'a AtomicUsize,
    /// Whether its work is done.
    over: AtomicBool,
}

impl<'a> Call<'a> {
    pub(super) fn begin(calls: &'a AtomicUsize) -> Self {
        calls.fetch_add(1, Ordering::Relaxed);
        Self {
            calls,
            over: AtomicBool::new(false),
        }
    }

    /// Call `work` on a thread of the pool while up to `helpers` others wait for what it divides.
    pub(super) fn run<R: Send>(
        &self,
        helpers: usize,
        work: impl FnOnce() -> Result<R> + Send,
    ) -> Result<R> {
        let (mut work, mut result) = (Some(work), None);
        accompany(helpers, self, &mut || {
            let _over = RaiseOnDrop(&self.over);
            result = work.take().map(busy);
        });
        result.unwrap_or(Err(Error::Cancelled))
    }

    /// Whether a thread may wait for work of this call: where there are others, they have work for all.
    fn wants_company(&self) -> bool {
        !self.over.load(Ordering::Acquire) && self.calls.load(Ordering::Relaxed) == 1
    }
}

impl Drop for Call<'_> {
    fn drop(&mut self) {
        self.calls.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A flag that is raised at the end of a scope, also by a panic.
struct RaiseOnDrop<'a>(&'a AtomicBool);

impl Drop for RaiseOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Call `work` while up to `threads` other threads of the pool wait for what it divides.
fn accompany(threads: usize, call: &Call<'_>, work: &mut (dyn FnMut() + Send)) {
    if threads == 0 {
        work();
        return;
    }
    rayon::join(
        || accompany(threads - 1, call, work),
        || {
            // A thread that has come by from the midst of its own work must return to it.
            if BUSY.get() == 0 {
                help_while(|| call.wants_company());
            }
        },
    );
}

/// How long a thread spins for work before it may fall asleep: some times what waking it costs.
const SPIN_TIME: Duration = Duration::from_micros(200);

/// Spins on what is waited for between two polls of the queues, which are left to those who fill them meanwhile.
const SPINS_PER_POLL: usize = 8;

/// Polls of the queues between two offers of the CPU to other processes.
const POLLS_PER_YIELD: usize = 8;

/// Do what others of the pool have to do, while `wanted` and not long without any.
pub(super) fn help_while(wanted: impl Fn() -> bool) {
    let (mut last, mut polls) = (None, 0);
    while wanted() {
        if rayon::yield_now() == Some(Yield::Executed) {
            (last, polls) = (None, 0);
            continue;
        }
        for _ in 0..SPINS_PER_POLL {
            if !wanted() {
                return;
            }
            std::hint::spin_loop();
        }
        polls += 1;
        if polls % POLLS_PER_YIELD == 0 {
            if last.get_or_insert_with(Instant::now).elapsed() > SPIN_TIME {
                return;
            }
            std::thread::yield_now();
        }
    }
}

thread_local! {
    /// How deep a thread of a pool is within work that others wait for.
    static BUSY: Cell<usize> = const { Cell::new(0) };
}

/// Call `work`, which this thread must not leave for long.
fn busy<R>(work: impl FnOnce() -> R) -> R {
    struct Depth;
    impl Drop for Depth {
        fn drop(&mut self) {
            BUSY.set(BUSY.get() - 1);
        }
    }
    BUSY.set(BUSY.get() + 1);
    let _depth = Depth;
    work()
}

/// What both return, called at the same time where a thread of the pool is free; on one of them.
pub(super) fn join<A: Send, B: Send>(
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    let [taken, over] = [const { AtomicBool::new(false) }; 2];
    rayon::join(
        || {
            let result = busy(first);
            // To fall asleep and be woken costs more than to wait for what is nearly done.
            if taken.load(Ordering::Acquire) {
                busy(|| help_while(|| !over.load(Ordering::Acquire)));
            }
            result
        },
        || {
            taken.store(true, Ordering::Release);
            let _over = RaiseOnDrop(&over);
            busy(second)
        },
    )
}
