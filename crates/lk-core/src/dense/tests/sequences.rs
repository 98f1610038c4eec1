//! From frame to frame, beside pairs.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::super::{DenseFlow, DenseHints, DenseOptions, FlowField};
use super::{measure, same_bits, scene};
use crate::{Error, Execution};

#[test]
fn a_sequence_gives_the_bits_of_its_pairs() {
    let frames: Vec<_> = (0..4)
        .map(|k| scene(80, 100, 1.3 * f64::from(k), 0.4 * f64::from(k)))
        .collect();
    let options = DenseOptions::default();
    let (mut flow, mut field) = (
        DenseFlow::new(options.clone()).unwrap(),
        FlowField::default(),
    );
    for (k, frame) in frames.iter().enumerate() {
        let measured = flow
            .update(frame.view(), DenseHints::default(), &mut field)
            .unwrap();
        assert_eq!(measured, k > 0);
        if k > 0 {
            assert!(
                same_bits(
                    &measure(frames[k - 1].view(), frame.view(), &options),
                    &field
                ),
                "{k}"
            );
        }
    }
    flow.reset();
    assert!(
        !flow
            .update(frames[0].view(), DenseHints::default(), &mut field)
            .unwrap()
    );
}

#[test]
fn a_raised_flag_cancels_and_the_next_frame_is_a_first_one() {
    let frame = scene(60, 80, 0.0, 0.0);
    let flag = Arc::new(AtomicBool::new(false));
    let options = DenseOptions::default()
        .execution(Execution::default().threads(1).cancel(Arc::clone(&flag)));
    let (mut flow, mut field) = (DenseFlow::new(options).unwrap(), FlowField::default());
    assert!(
        !flow
            .update(frame.view(), DenseHints::default(), &mut field)
            .unwrap()
    );
    flag.store(true, std::sync::atomic::Ordering::Relaxed);
    let error = flow
        .update(frame.view(), DenseHints::default(), &mut field)
        .unwrap_err();
    assert_eq!(error, Error::Cancelled);
    flag.store(false, std::sync::atomic::Ordering::Relaxed);
    assert!(
        !flow
            .update(frame.view(), DenseHints::default(), &mut field)
            .unwrap()
    );
}
