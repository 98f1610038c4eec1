//! `PlaneTracker` over two frames: the same motion for every thread count and CPU level, finite numbers or none.

use arbitrary::Arbitrary;
use lk_core::{Distortion, Execution, Lens, PlaneInterval, PlaneOptions, PlaneTracker};

use crate::frames::{Frames, Grey, mask};
use crate::{by_depth, others, plain};

/// Frames, lens, attitude, start.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    masks: [Option<u16>; 2],
    /// Focal length, in widths of 1/32.
    focal: u8,
    /// Radial, radial, tangential, tangential, radial; in 1/128.
    distortion: [i8; 5],
    /// Straight down, in 1/128 beyond the optical axis.
    tilt: (i8, i8),
    /// In 1/256 rad.
    turn: (i8, i8, i8),
    /// In 1/256 of the height, and of a radian.
    start: [i8; 6],
    /// In 1/1024 rad.
    rotation_std: u8,
    /// In 1/128 of the interval.
    readout: i8,
}

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

fn check_as<T: Grey>(case: &Case) {
    let (height, width) = case.frames.size();
    let (prev, next) = case.frames.pair::<T>();
    let focal = width as f64 * (1.0 + f64::from(case.focal)) / 32.0;
    let mut numbers = [0.0; 12];
    for (number, given) in numbers.iter_mut().zip(case.distortion) {
        *number = f64::from(given) / 128.0;
    }
    let centre = [0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)];
    let Ok(lens) = Lens::new([focal; 2], centre, Distortion::Brown(numbers)) else {
        return;
    };
    let (x, y) = (
        f64::from(case.tilt.0) / 128.0,
        f64::from(case.tilt.1) / 128.0,
    );
    let length = (x * x + y * y + 1.0).sqrt();
    let turn = [case.turn.0, case.turn.1, case.turn.2].map(|angle| f64::from(angle) / 256.0);
    let interval = PlaneInterval::default()
        .down([x / length, y / length, 1.0 / length])
        .turn(turn)
        .rolling_shutter(f64::from(case.readout) / 128.0);
    let start = case.start.map(|value| f64::from(value) / 256.0);
    let std = f64::from(case.rotation_std) / 1024.0;
    let run = |execution: &Execution| -> Option<String> {
        let mut tracker = PlaneTracker::new(lens.clone());
        for (frame, seed) in [(prev.view(), case.masks[0]), (next.view(), case.masks[1])] {
            let mask = mask(case.frames.size(), seed);
            tracker
                .push(frame, mask.as_ref().map(|mask| mask.view()), execution)
                .ok()?;
        }
        let options = PlaneOptions::default()
            .rotation_std([std; 3])
            .execution(execution.clone());
        match tracker.motion(&interval, &start, &options) {
            Err(error) => Some(error.to_string()),
            Ok(None) => None,
            Ok(Some(fit)) => {
                assert!(fit.motion.iter().all(|value| value.is_finite()), "{fit:?}");
                // Debug prints every bit that matters of a finite number.
                Some(format!("{fit:?}"))
            }
        }
    };
    let found = run(&plain());
    for execution in others() {
        assert_eq!(run(&execution), found, "{execution:?}");
    }
}
