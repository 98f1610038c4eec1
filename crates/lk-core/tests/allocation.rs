//! A sequence allocates nothing once its memory is there, on one thread.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use allocation_counter::measure;
use lk_core::{
    CornerDetector, CornerOptions, DenseFlow, DenseHints, DenseOptions, Execution, FlowField,
    PointTracker, Preset, TrackOptions,
};
use ndarray::Array2;

const FRAMES: usize = 8;

/// A picture that repeats nowhere near, moved by (1.3, -0.6) pixels from frame to frame.
fn frames() -> Vec<Array2<u8>> {
    let picture = |x: f64, y: f64| {
        120.0
            + 40.0 * (0.31 * x + 2.0 * (0.05 * y).sin()).sin() * (0.27 * y - 0.04 * x).cos()
            + 40.0 * (0.13 * x - 0.21 * y + 3.0 * (0.04 * x).cos()).sin()
    };
    (0..FRAMES)
        .map(|index| {
            let time = index as f64;
            Array2::from_shape_fn((240, 320), |(y, x)| {
                picture(x as f64 - 1.3 * time, y as f64 + 0.6 * time).round() as u8
            })
        })
        .collect()
}

#[test]
fn tracking_allocates_nothing_after_the_second_frame() {
    let one = Execution::default().threads(1);
    let mut tracker = PointTracker::new(
        TrackOptions::default().execution(one.clone()),
        CornerOptions::default().max_corners(150).execution(one),
    )
    .unwrap();
    let mut counts = Vec::new();
    for frame in &frames() {
        let mut tracked = 0;
        let info = measure(|| {
            let points = tracker.update(frame.view(), None).unwrap();
            tracked = points.iter().filter(|point| point.track.is_valid()).count();
        });
        counts.push(info.count_total);
        assert!(counts.len() == 1 || tracked > 100, "{tracked} points");
    }
    assert!(counts[0] > 0, "the counter does not count");
    assert_eq!(counts[2..], [0; FRAMES - 2], "{counts:?}");
}

#[test]
fn corners_allocate_nothing_after_the_first_frame() {
    let options = CornerOptions::default().execution(Execution::default().threads(1));
    let mut detector = CornerDetector::default();
    let mut corners = Vec::new();
    let mut counts = Vec::new();
    let frames = frames();
    // One frame again and again: another may have more candidates than there is room for.
    for _ in 0..3 {
        let info = measure(|| {
            detector
                .detect(frames[0].view(), None, &options, &mut corners)
                .unwrap();
        });
        assert!(!corners.is_empty());
        counts.push(info.count_total);
    }
    assert!(counts[0] > 0, "the counter does not count");
    assert_eq!(counts[1..], [0, 0], "{counts:?}");
}

#[test]
fn dense_flow_allocates_nothing_after_the_second_frame() {
    for preset in [Preset::Fast, Preset::Balanced, Preset::Accurate] {
        let options = DenseOptions::default()
            .preset(preset)
            .execution(Execution::default().threads(1));
        let mut flow = DenseFlow::new(options).unwrap();
        let mut field = FlowField::default();
        let mut counts = Vec::new();
        for frame in &frames() {
            let info = measure(|| {
                flow.update(frame.view(), DenseHints::default(), &mut field)
                    .unwrap();
            });
            counts.push(info.count_total);
        }
        assert!(counts[0] > 0, "the counter does not count");
        assert_eq!(counts[2..], [0; FRAMES - 2], "{preset:?} {counts:?}");
    }
}
