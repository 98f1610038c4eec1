//! Objects that threads share: one call at a time, and none that waits for a thread that a fork has left behind.

use std::cell::Cell;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use arc_swap::ArcSwap;
use lk_core::Execution;
use pyo3::prelude::*;

use crate::errors::{raise, to_python};

/// Polls of a value that another thread has, yielding the CPU between them, before a thread sleeps, and for how long.
const YIELDS: usize = 64;
const SLEEP: Duration = Duration::from_micros(100);

/// A value that one call has at a time.
pub(crate) struct Shared<T> {
    /// What it begins with, and goes on with where it was lost to a fork.
    fresh: Box<dyn Fn() -> PyResult<T> + Send + Sync>,
    /// What is done with it after a panic, which may have left it half changed.
    mend: fn(&mut T),
    slot: ArcSwap<Slot<T>>,
}

struct Slot<T> {
    /// The process and the thread whose call has the value; 0: nobody.
    holder: AtomicU64,
    value: Mutex<T>,
}

impl<T> Slot<T> {
    fn new(value: T) -> Arc<Self> {
        Arc::new(Self {
            holder: AtomicU64::new(0),
            value: Mutex::new(value),
        })
    }
}

/// A thread that calls: a call may compute on others.
#[derive(Clone, Copy)]
pub(crate) struct Caller(u32);

impl Caller {
    /// This thread.
    pub(crate) fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(1);
        thread_local! {
            static NUMBER: Cell<u32> = const { Cell::new(0) };
        }
        if NUMBER.get() == 0 {
            NUMBER.set(NEXT.fetch_add(1, Ordering::Relaxed));
        }
        Self(NUMBER.get())
    }
}

/// Lets go of a value at the end of a call, also by a panic.
struct LetGo<'a>(&'a AtomicU64);

impl Drop for LetGo<'_> {
    fn drop(&mut self) {
        self.0.store(0, Ordering::Release);
    }
}

impl<T> Shared<T> {
    pub(crate) fn new(
        fresh: impl Fn() -> PyResult<T> + Send + Sync + 'static,
        mend: fn(&mut T),
    ) -> PyResult<Self> {
        let slot = ArcSwap::new(Slot::new(fresh()?));
        Ok(Self {
            fresh: Box::new(fresh),
            mend,
            slot,
        })
    }

    /// Call `work` with the value, once no other call has it.
    pub(crate) fn with<R>(
        &self,
        caller: Caller,
        execution: &Execution,
        work: impl FnOnce(&mut T) -> PyResult<R>,
    ) -> PyResult<R> {
        let slot = self.slot.load_full();
        let process = std::process::id();
        let me = u64::from(process) << 32 | u64::from(caller.0);
        let mut polls = 0;
        while let Err(holder) =
            slot.holder
                .compare_exchange(0, me, Ordering::Acquire, Ordering::Relaxed)
        {
            if holder >> 32 != u64::from(process) {
                return Err(raise(
                    "RsflowError",
                    "this object was in a call of another thread when the process was forked, and that thread is not \
                     here to end it: make a new one, or reset() this one, which then begins anew"
                        .to_owned(),
                ));
            }
            if holder == me {
                return Err(raise(
                    "RsflowError",
                    "this object is in a call of this very thread, which waits for this one"
                        .to_owned(),
                ));
            }
            execution.check().map_err(|error| to_python(&error))?;
            polls += 1;
            if polls < YIELDS {
                std::thread::yield_now();
            } else {
                std::thread::sleep(SLEEP);
            }
        }
        let _let_go = LetGo(&slot.holder);
        let mut value = slot.value.lock().unwrap_or_else(|poisoned| {
            let mut value = PoisonError::into_inner(poisoned);
            (self.mend)(&mut value);
            slot.value.clear_poison();
            value
        });
        work(&mut value)
    }

    /// Replace the value if a fork has left it to a thread that is not here; whether it did.
    pub(crate) fn renew_if_lost(&self) -> PyResult<bool> {
        let holder = self.slot.load().holder.load(Ordering::Acquire);
        if holder == 0 || holder >> 32 == u64::from(std::process::id()) {
            return Ok(false);
        }
        let lost = self.slot.swap(Slot::new((self.fresh)()?));
        // A lock that is held is not taken apart.
        std::mem::forget(lost);
        Ok(true)
    }
}
