//! `PointTracker` and `DenseFlow` over several frames, each with a mask of its own.

use arbitrary::Arbitrary;
use lk_core::{
    CornerOptions, DenseFlow, DenseHints, DenseOptions, Execution, FlowField, PointStatus,
    PointTracker, Preset, StreamPoint, TrackOptions, TrackedPoint, dense_flow,
};
use ndarray::Array2;

use crate::frames::{Frames, Grey, covered, mask};
use crate::{by_depth, others, plain, track};

/// Frames and their masks.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    masks: [Option<u16>; 4],
    corners: u8,
    min_distance: u8,
    /// Whether the objects are written down and read again after this frame.
    parked: u8,
    reset: bool,
}

/// Frames that are shown, back and forth between the two of the pair.
const SHOWN: usize = 4;

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

fn check_as<T: Grey>(case: &Case) {
    let (prev, next) = case.frames.pair::<T>();
    let pair = [prev.rows(), next.rows()];
    let masks = case.masks.map(|seed| mask(case.frames.size(), seed));
    let frames: Vec<&Array2<T>> = (0..SHOWN).map(|number| &pair[number % 2]).collect();
    points(case, &frames, &masks);
    // A frame is read at the scale of the one before, which need not hold the largest and smallest numbers there are.
    if case.frames.in_range() {
        dense(&frames, &masks);
    }
}

fn points<T: Grey>(case: &Case, frames: &[&Array2<T>], masks: &[Option<Array2<bool>>; SHOWN]) {
    let run = |execution: Execution, cover: Option<u64>| {
        let corners = CornerOptions::default()
            .max_corners(usize::from(case.corners % 60))
            .min_distance(f32::from(case.min_distance % 20))
            .execution(execution.clone());
        let options = TrackOptions::default().execution(execution);
        let mut tracker = PointTracker::new(options, corners).unwrap();
        let mut found: Vec<Vec<StreamPoint>> = Vec::new();
        for (number, (frame, mask)) in frames.iter().zip(masks).enumerate() {
            let shown = cover.map_or_else(
                || (*frame).clone(),
                |seed| covered(frame, mask.as_ref(), seed + number as u64),
            );
            let view = mask.as_ref().map(|mask| mask.view());
            found.push(tracker.update(shown.view(), view).unwrap().to_vec());
            if usize::from(case.parked) % SHOWN == number {
                let kept = tracker.snapshot().unwrap();
                tracker.restore(&kept).unwrap();
            }
            if case.reset && number == 1 {
                tracker.reset();
            }
        }
        found
    };
    let found = run(plain(), None);
    for (number, (rows, mask)) in found.iter().zip(masks).enumerate() {
        for row in rows {
            let new = row.track.status == PointStatus::New;
            if new {
                assert!(
                    row.track.position.iter().all(|value| value.is_finite()),
                    "{row:?}"
                );
            } else {
                track::meaning(&row.track);
            }
            if let Some(mask) = mask
                && (new || row.track.is_valid())
            {
                let [x, y] = row.track.position.map(|value| value.round() as usize);
                assert!(mask[(y, x)], "frame {number}: {row:?} at a masked pixel");
            }
        }
    }
    let all = |found: &[Vec<StreamPoint>]| -> Vec<_> {
        found
            .iter()
            .flat_map(|rows| {
                let tracks: Vec<TrackedPoint> = rows.iter().map(|row| row.track).collect();
                let names: Vec<(u64, u32)> = rows.iter().map(|row| (row.id, row.age)).collect();
                track::bits(&tracks).into_iter().zip(names)
            })
            .collect()
    };
    for execution in others() {
        assert_eq!(all(&run(execution, None)), all(&found));
    }
    for seed in [1, 9] {
        assert_eq!(
            all(&run(plain(), Some(seed))),
            all(&found),
            "masked pixels count"
        );
    }
}

/// A stream gives what each pair gives by itself.
fn dense<T: Grey>(frames: &[&Array2<T>], masks: &[Option<Array2<bool>>; SHOWN]) {
    let options = DenseOptions::default()
        .preset(Preset::Fast)
        .execution(plain());
    let mut stream = DenseFlow::new(options.clone()).unwrap();
    for number in 0..SHOWN {
        let mut streamed = FlowField::default();
        let before = number.saturating_sub(1);
        let hints = DenseHints::default()
            .mask(masks[before].as_ref().map(|mask| mask.view()))
            .next_mask(masks[number].as_ref().map(|mask| mask.view()));
        let is_pair = stream
            .update(frames[number].view(), hints, &mut streamed)
            .unwrap();
        assert_eq!(is_pair, number > 0);
        if is_pair {
            let alone = dense_flow(
                frames[before].view(),
                frames[number].view(),
                hints,
                &options,
            )
            .unwrap();
            crate::dense::same(&streamed, &alone);
        }
    }
}
