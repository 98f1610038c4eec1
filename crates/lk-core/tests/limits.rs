//! Sizes and numbers that nothing holds are errors, and what a streaming object knows goes on elsewhere.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lk_core::{
    CornerOptions, DenseFlow, DenseHints, DenseOptions, Error, Execution, FlowField, MAX_THREADS,
    Masks, Plane, PointTracker, Preset, PyrLkOptions, Pyramid, ShiftOptions, TrackOptions,
    dense_flow, detect_corners, estimate_shift, set_num_threads, track_points, track_pyr_lk,
};
use ndarray::{Array2, ArrayView2};

fn is_shape<T>(result: Result<T, Error>) -> bool {
    matches!(result, Err(Error::Shape { .. }))
}

fn is_option<T>(result: Result<T, Error>) -> bool {
    matches!(result, Err(Error::Option { .. }))
}

/// Frames that move by (2, 1) pixels.
fn frame(index: usize) -> Array2<u8> {
    Array2::from_shape_fn((90, 130), |(y, x)| {
        let (x, y) = (x as f32 - 2.0 * index as f32, y as f32 - index as f32);
        let waves = (0.31 * x + 2.0 * (0.05 * y).sin()).sin() * (0.27 * y - 0.04 * x).cos();
        (120.0 + 60.0 * waves + 40.0 * (0.13 * x - 0.21 * y).sin()).round() as u8
    })
}

#[test]
fn planes_have_no_more_pixels_than_places_are_counted_by() {
    for (width, height) in [
        (usize::MAX, 2),
        (2, usize::MAX),
        (usize::MAX, 0),
        (1 << 20, 1 << 20),
        (1 << 31, 1),
    ] {
        assert!(is_shape(Plane::new(width, height)), "{width} x {height}");
        let mut plane = Plane::new(2, 3).unwrap();
        assert!(is_shape(plane.resize(width, height)));
        assert_eq!(
            (plane.width(), plane.height(), plane.data()),
            (2, 3, &[0.0; 6][..])
        );
    }
}

#[test]
fn frames_that_take_no_memory_are_too_large_all_the_same() {
    let one = Array2::<u8>::ones((1, 1));
    let huge: ArrayView2<'_, u8> = one.broadcast((1 << 20, 1 << 20)).unwrap();
    let hints = DenseHints::default();
    assert!(is_shape(dense_flow(
        huge,
        huge,
        hints,
        &DenseOptions::default()
    )));
    assert!(is_shape(estimate_shift(
        huge,
        huge,
        Masks::default(),
        &ShiftOptions::default()
    )));
    let points = [[5.0, 5.0]];
    let options = TrackOptions::default();
    assert!(is_shape(track_points(
        huge,
        huge,
        &points,
        None,
        Masks::default(),
        &options
    )));
    assert!(is_shape(track_pyr_lk(
        huge,
        huge,
        &points,
        None,
        &PyrLkOptions::default()
    )));
    assert!(is_shape(detect_corners(
        huge,
        None,
        &CornerOptions::default()
    )));
    assert!(is_shape(Pyramid::new(huge, 3, &Execution::default())));
    let mut tracker = PointTracker::new(options, CornerOptions::default()).unwrap();
    assert!(is_shape(tracker.update(huge, None).map(drop)));
}

#[test]
fn threads_are_bounded() {
    let picture = frame(0);
    assert!(is_option(set_num_threads(MAX_THREADS + 1)));
    let many = Execution::default().threads(usize::MAX);
    let options = CornerOptions::default().execution(many);
    assert!(is_option(detect_corners(picture.view(), None, &options)));
}

#[test]
fn any_number_of_corners_may_be_asked_for() {
    let picture = frame(0);
    for count in [1_000_000_000, usize::MAX] {
        let corners = CornerOptions::default().max_corners(count);
        let found = detect_corners(picture.view(), None, &corners)
            .unwrap()
            .len();
        let mut tracker = PointTracker::new(TrackOptions::default(), corners).unwrap();
        let tracked = tracker.update(picture.view(), None).unwrap().len();
        assert!(found > 20 && tracked > 20);
    }
}

#[test]
fn a_tracker_goes_on_elsewhere() {
    let make = || PointTracker::new(TrackOptions::default(), CornerOptions::default()).unwrap();
    let (mut first, mut other) = (make(), make());
    for index in 0..3 {
        first.update(frame(index).view(), None).unwrap();
    }
    let snapshot = first.snapshot().unwrap();
    other.update(frame(7).view(), None).unwrap();
    other.restore(&snapshot).unwrap();
    assert_eq!(other.snapshot().unwrap(), snapshot);
    for index in 3..5 {
        let (one, two) = (
            first.update(frame(index).view(), None),
            other.update(frame(index).view(), None),
        );
        // NaN of a new point's origin is not equal to itself.
        assert_eq!(format!("{:?}", one.unwrap()), format!("{:?}", two.unwrap()));
    }
    let mut damaged = snapshot.clone();
    damaged.ids.pop();
    assert!(is_shape(other.restore(&damaged)));
    damaged = snapshot.clone();
    damaged.next_id = 0;
    assert!(is_option(other.restore(&damaged)));
    damaged = snapshot;
    damaged.frame = None;
    assert!(is_shape(other.restore(&damaged)));
    assert!(
        other
            .update(frame(0).view(), None)
            .unwrap()
            .iter()
            .all(|point| point.age == 0)
    );
}

#[test]
fn a_flow_goes_on_elsewhere() {
    let make = || DenseFlow::new(DenseOptions::default().preset(Preset::Fast)).unwrap();
    let (mut first, mut other) = (make(), make());
    let (mut one, mut two) = (FlowField::default(), FlowField::default());
    assert!(first.snapshot().unwrap().is_none());
    for index in 0..3 {
        first
            .update(frame(index).view(), DenseHints::default(), &mut one)
            .unwrap();
    }
    let snapshot = first.snapshot().unwrap().unwrap();
    other.restore(Some(&snapshot)).unwrap();
    assert_eq!(other.snapshot().unwrap().as_ref(), Some(&snapshot));
    for index in 3..5 {
        let frame = frame(index);
        assert!(
            first
                .update(frame.view(), DenseHints::default(), &mut one)
                .unwrap()
        );
        assert!(
            other
                .update(frame.view(), DenseHints::default(), &mut two)
                .unwrap()
        );
        let bits = |field: &FlowField| {
            field
                .uv()
                .iter()
                .map(|value| value.to_bits())
                .collect::<Vec<_>>()
        };
        assert_eq!(bits(&one), bits(&two));
        assert_eq!(one.valid(), two.valid());
    }
    let mut damaged = snapshot.clone();
    damaged.counts = Plane::new(2, 2).unwrap();
    assert!(is_shape(other.restore(Some(&damaged))));
    for scale in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-45] {
        damaged = snapshot.clone();
        damaged.scale = scale;
        assert!(is_option(other.restore(Some(&damaged))));
    }
    damaged = snapshot;
    damaged.frame.data_mut()[7] = f32::NAN;
    assert!(is_option(other.restore(Some(&damaged))));
    assert!(
        !other
            .update(frame(0).view(), DenseHints::default(), &mut two)
            .unwrap()
    );
}
