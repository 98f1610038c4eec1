//! Threads: the only file that names rayon. Work is split into bands of rows or chunks of points.
//!
//! The pools belong to one process: after `fork()` the child builds its own. Where one thread is enough the work runs
//! on the caller's thread and no pool is touched. A band never reads what another band writes, and no sum crosses a
//! row, so the number of bands cannot change a bit of a result.

use std::cell::Cell;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, OnceLock};
use std::time::{Duration, Instant};

use arc_swap::ArcSwap;
use rayon::{ThreadPool, ThreadPoolBuilder, Yield};

use crate::error::{Error, Result};
use crate::execution::Execution;

/// Shortest bands, of about 10 us or more each, between two looks at a cancel flag.
const CANCELLABLE_BAND: usize = 16;

static REQUESTED: AtomicUsize = AtomicUsize::new(0);

/// The pools of one process, by thread count.
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
pub fn set_num_threads(threads: usize) {
    REQUESTED.store(threads, Ordering::Relaxed);
}

/// The number of threads of all calls that do not say otherwise; how many CPUs there are is asked once.
#[must_use]
pub fn num_threads() -> usize {
    // Asking reads files of the control groups: about 30 us, and every band of rows would pay it.
    static CPUS: OnceLock<usize> = OnceLock::new();
    match REQUESTED.load(Ordering::Relaxed) {
        0 => *CPUS
            .get_or_init(|| std::thread::available_parallelism().map_or(1, std::num::NonZero::get)),
        threads => threads,
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
    POOLS.rcu(|pools| {
        let mut by_threads = if pools.process == process {
            pools.by_threads.clone()
        } else {
            Vec::new()
        };
        if !by_threads.iter().any(|(count, _)| *count == threads) {
            by_threads.push((threads, Arc::clone(&built)));
        }
        Pools {
            process,
            by_threads,
        }
    });
    if current.process != process {
        // The threads of these pools stayed in the parent; to drop them would wait on locks that nobody holds here.
        std::mem::forget(current);
    }
    Ok(built)
}

/// Outputs that can be divided at a row, so that each band owns its part.
pub(crate) trait SplitRows: Sized + Send {
    /// The parts above and below `row`.
    fn split_at_row(self, row: usize) -> (Self, Self);
}

/// Rows of equal length in one slice.
#[derive(Debug)]
pub(crate) struct RowsMut<'a, T> {
    /// The rows, one after the other.
    pub(crate) data: &'a mut [T],
    /// Elements from one row to the next.
    pub(crate) stride: usize,
}

impl<'a, T> RowsMut<'a, T> {
    /// View `data` as rows of `stride` elements.
    pub(crate) fn new(data: &'a mut [T], stride: usize) -> Self {
        Self { data, stride }
    }

    /// Row `index` of this part.
    pub(crate) fn row_mut(&mut self, index: usize) -> &mut [T] {
        &mut self.data[index * self.stride..(index + 1) * self.stride]
    }
}

impl<T: Send> SplitRows for RowsMut<'_, T> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (above, below) = self.data.split_at_mut(row * self.stride);
        (Self::new(above, self.stride), Self::new(below, self.stride))
    }
}

/// One row for each even row of what is divided.
#[derive(Debug)]
pub(crate) struct EvenRows<'a, T> {
    rows: RowsMut<'a, T>,
    /// The first row of this part.
    start: usize,
}

impl<'a, T> EvenRows<'a, T> {
    /// All rows, from row 0 on.
    pub(crate) fn new(rows: RowsMut<'a, T>) -> Self {
        Self { rows, start: 0 }
    }

    /// What belongs to the even row `row`, counted from the first one of all.
    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [T] {
        self.rows.row_mut(row / 2 - self.start.div_ceil(2))
    }
}

impl<T: Send> SplitRows for EvenRows<'_, T> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let middle = self.start + row;
        let (above, below) = self
            .rows
            .split_at_row(middle.div_ceil(2) - self.start.div_ceil(2));
        (
            Self {
                rows: above,
                start: self.start,
            },
            Self {
                rows: below,
                start: middle,
            },
        )
    }
}

impl SplitRows for () {
    fn split_at_row(self, _row: usize) -> (Self, Self) {
        ((), ())
    }
}

impl<S: SplitRows> SplitRows for Option<S> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        self.map(|part| part.split_at_row(row)).unzip()
    }
}

macro_rules! split_tuples {
    ($($name:ident)+) => {
        impl<$($name: SplitRows),+> SplitRows for ($($name,)+) {
            #[allow(non_snake_case, reason = "one name serves as type and as variable")]
            fn split_at_row(self, row: usize) -> (Self, Self) {
                let ($($name,)+) = self;
                $(let $name = $name.split_at_row(row);)+
                (($($name.0,)+), ($($name.1,)+))
            }
        }
    };
}
split_tuples!(A B);
split_tuples!(A B C);
split_tuples!(A B C D);
split_tuples!(A B C D E);

/// Call `work(rows, part)` for bands that together are `0..rows`, each with its own part of `outputs`.
///
/// A band has at least `min_rows` rows where there are as many; choose it so that a band costs well above the 10 us
/// that it takes to hand it to another thread.
///
/// # Errors
///
/// [`Error::Cancelled`] if the cancel flag was raised before the last band began, [`Error::Threads`] if no pool could
/// be started.
pub(crate) fn for_each_band<S, F>(
    execution: &Execution,
    rows: usize,
    min_rows: usize,
    outputs: S,
    work: F,
) -> Result<()>
where
    S: SplitRows,
    F: Fn(Range<usize>, S) + Sync,
{
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
fn one_by_one<S, F>(
    execution: &Execution,
    rows: Range<usize>,
    band: usize,
    mut outputs: S,
    work: &F,
) -> Result<()>
where
    S: SplitRows,
    F: Fn(Range<usize>, S) + Sync,
{
    let mut start = rows.start;
    while rows.end - start > band {
        execution.check()?;
        let (part, rest) = outputs.split_at_row(band);
        work(start..start + band, part);
        outputs = rest;
        start += band;
    }
    execution.check()?;
    work(start..rows.end, outputs);
    Ok(())
}

/// Call `work` where [`for_each_band`] with the same setting hands nothing over from outside of its pool, and keep the
/// other threads of the pool awake for what it divides: to wake one costs tens of microseconds.
///
/// # Errors
///
/// [`Error::Threads`] if no pool could be started.
pub(crate) fn within_pool<R: Send>(
    execution: &Execution,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    let threads = execution.num_threads();
    if threads == 1 {
        return work();
    }
    let pool = pool(threads)?;
    let call = Call::begin(&pool);
    pool.threads.install(|| {
        let (mut work, mut result) = (Some(work), None);
        accompany(threads - 1, &call, &mut || {
            let _over = RaiseOnDrop(&call.over);
            result = work.take().map(busy);
        });
        result.unwrap_or(Err(Error::Cancelled))
    })
}

/// A call of [`within_pool`].
struct Call<'a> {
    pool: &'a Pool,
    /// Whether its work is done.
    over: AtomicBool,
}

impl<'a> Call<'a> {
    fn begin(pool: &'a Pool) -> Self {
        pool.calls.fetch_add(1, Ordering::Relaxed);
        Self {
            pool,
            over: AtomicBool::new(false),
        }
    }

    /// Whether a thread may wait for work of this call: where there are others, they have work for all.
    fn wants_company(&self) -> bool {
        !self.over.load(Ordering::Acquire) && self.pool.calls.load(Ordering::Relaxed) == 1
    }
}

impl Drop for Call<'_> {
    fn drop(&mut self) {
        self.pool.calls.fetch_sub(1, Ordering::Relaxed);
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

/// How long a thread waits for work before it may fall asleep.
const PATIENCE: Duration = Duration::from_micros(200);

/// Looks at what is waited for between two looks at the queues, which are left to those who fill them meanwhile.
const GLANCES: usize = 8;

/// Looks at the queues between two offers of the CPU to other processes.
const LOOKS: usize = 8;

/// Do what others of the pool have to do, while `wanted` and not long without any.
fn help_while(wanted: impl Fn() -> bool) {
    let (mut last, mut looks) = (None, 0);
    while wanted() {
        if rayon::yield_now() == Some(Yield::Executed) {
            (last, looks) = (None, 0);
            continue;
        }
        for _ in 0..GLANCES {
            if !wanted() {
                return;
            }
            std::hint::spin_loop();
        }
        looks += 1;
        if looks % LOOKS == 0 {
            if last.get_or_insert_with(Instant::now).elapsed() > PATIENCE {
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

fn halve<S, F>(
    execution: &Execution,
    rows: Range<usize>,
    band: usize,
    outputs: S,
    work: &F,
) -> Result<()>
where
    S: SplitRows,
    F: Fn(Range<usize>, S) + Sync,
{
    execution.check()?;
    if rows.len() <= band {
        work(rows, outputs);
        return Ok(());
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

/// [`both`] on a thread of the pool.
fn join<A: Send, B: Send>(
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_every_row_once() {
        for rows in [0usize, 1, 2, 7, 64, 1001] {
            for threads in [1, 2, 7] {
                for min_rows in [1, 3, 50] {
                    let mut seen = vec![0u32; rows * 2];
                    let mut index = vec![0usize; rows];
                    let flag = Arc::new(AtomicBool::new(false));
                    let execution = Execution::default().threads(threads).cancel(flag);
                    let outputs = (RowsMut::new(&mut seen, 2), RowsMut::new(&mut index, 1));
                    for_each_band(
                        &execution,
                        rows,
                        min_rows,
                        outputs,
                        |range, (mut seen, mut index)| {
                            for (local, row) in range.enumerate() {
                                seen.row_mut(local).iter_mut().for_each(|cell| *cell += 1);
                                index.row_mut(local)[0] = row;
                            }
                        },
                    )
                    .unwrap();
                    assert!(seen.iter().all(|cell| *cell == 1));
                    assert!(index.iter().enumerate().all(|(row, found)| row == *found));
                }
            }
        }
    }

    /// Rows that know who they are, by bands within bands.
    fn squares(execution: &Execution, rows: usize) -> Vec<usize> {
        let mut squares = vec![0; rows];
        within_pool(execution, || {
            for _ in 0..3 {
                for_each_band(
                    execution,
                    rows,
                    1,
                    RowsMut::new(&mut squares, 1),
                    |range, part| {
                        for (square, row) in part.data.iter_mut().zip(range) {
                            *square += row * row;
                        }
                    },
                )?;
            }
            Ok(())
        })
        .unwrap();
        squares
    }

    #[test]
    fn calls_at_once_do_not_disturb_each_other() {
        let want: Vec<_> = (0..301).map(|row| 3 * row * row).collect();
        std::thread::scope(|scope| {
            for threads in [1, 2, 2, 3, 3, 7] {
                let want = &want;
                scope.spawn(move || {
                    let execution = Execution::default().threads(threads);
                    for _ in 0..50 {
                        assert_eq!(squares(&execution, want.len()), *want);
                    }
                });
            }
        });
    }

    #[test]
    fn both_are_called_wherever_they_are_asked_for() {
        for threads in [1, 2, 5] {
            let execution = Execution::default().threads(threads);
            let ask = || both(&execution, || squares(&execution, 9), || "second");
            let (rows, second) = ask().unwrap();
            assert_eq!((rows[8], second), (3 * 64, "second"));
            let within = within_pool(&execution, ask).unwrap();
            assert_eq!(within, (rows, second));
        }
    }

    #[test]
    fn a_panic_leaves_the_threads_to_the_next_call() {
        // A pool of its own: no other test has calls in it.
        let threads = 4;
        let execution = Execution::default().threads(threads);
        for _ in 0..3 {
            let result = std::panic::catch_unwind(|| {
                within_pool(&execution, || {
                    for_each_band(&execution, 64, 1, (), |rows, ()| {
                        assert!(!rows.contains(&40), "row 40");
                    })
                })
            });
            assert!(result.is_err());
            assert_eq!(pool(threads).unwrap().calls.load(Ordering::Relaxed), 0);
            assert_eq!(squares(&execution, 5), [0, 3, 12, 27, 48]);
        }
    }

    #[test]
    fn nobody_waits_long_for_work() {
        let execution = Execution::default().threads(6);
        within_pool(&execution, || {
            help_while(|| true);
            Ok(())
        })
        .unwrap();
        // The first has no more to do; the second goes on for long.
        let long = Duration::from_millis(20);
        let (_, slept) = both(
            &execution,
            || (),
            || {
                let start = Instant::now();
                std::thread::sleep(long);
                start.elapsed()
            },
        )
        .unwrap();
        assert!(slept >= long);
    }

    #[test]
    fn even_rows_go_with_their_bands() {
        for rows in [1usize, 2, 7, 64, 101] {
            for threads in [1, 2, 7] {
                let mut even = vec![usize::MAX; rows.div_ceil(2)];
                let execution = Execution::default().threads(threads);
                let outputs = Some(EvenRows::new(RowsMut::new(&mut even, 1)));
                for_each_band(&execution, rows, 1, outputs, |range, part| {
                    let mut part = part.unwrap();
                    for row in range.filter(|row| row % 2 == 0) {
                        part.row_mut(row)[0] = row;
                    }
                })
                .unwrap();
                assert!(
                    even.iter()
                        .enumerate()
                        .all(|(place, row)| *row == 2 * place)
                );
            }
        }
    }

    #[test]
    fn even_bands_are_two_a_thread_where_they_are_long() {
        let bands =
            |threads, rows| even_bands(&Execution::default().threads(threads), rows, [64, 16]);
        assert_eq!(bands(1, 480), 240);
        assert_eq!(bands(2, 480), 120);
        assert_eq!(bands(2, 120), 60);
        assert_eq!(bands(2, 20), 16);
        assert_eq!(bands(8, 480), 60);
        assert_eq!(bands(64, 480), 16);
    }

    #[test]
    fn a_raised_flag_cancels() {
        for threads in [1, 2] {
            let flag = Arc::new(AtomicBool::new(true));
            let execution = Execution::default().threads(threads).cancel(flag);
            let result = for_each_band(&execution, 100, 1, (), |_, ()| panic!("must not run"));
            assert_eq!(result, Err(Error::Cancelled));
        }
    }
}
