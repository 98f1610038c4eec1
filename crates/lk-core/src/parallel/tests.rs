#![cfg(feature = "rayon")]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::keep_warm::help_while;
use super::pool::pool;
use super::*;
use crate::error::Error;

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
    let bands = |threads, rows| even_bands(&Execution::default().threads(threads), rows, [64, 16]);
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
        let result = for_each_band(&execution, 100, 1, (), |_, ()| -> () {
            panic!("must not run")
        });
        assert_eq!(result, Err(Error::Cancelled));
    }
}
