//! Times of the estimators on made pictures, one thread: `cargo bench`. Accuracy beside time, and OpenCV beside both, is
//! what `rsflow bench` measures.
#![allow(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

mod made;

use std::hint::black_box;

use criterion::Criterion;
use lk_core::{
    CornerDetector, CornerOptions, DenseFlow, DenseHints, DenseOptions, Distortion, Execution,
    FlowField, Lens, Masks, PlaneInterval, PlaneOptions, PlaneTracker, Preset, ShiftOptions,
    TrackOptions, detect_corners, estimate_shift, find_parallax, fit_camera, track_points,
};

use made::{SHIFT, pair, vectors};

fn shifts(criterion: &mut Criterion) {
    let options = ShiftOptions::default().execution(Execution::default().threads(1));
    for (width, height) in [(60, 60), (640, 480)] {
        let (prev, next) = pair(width, height);
        let run = || estimate_shift(prev.view(), next.view(), Masks::default(), &options).unwrap();
        assert!((run().dx - SHIFT.0).abs() < 0.05);
        criterion.bench_function(&format!("shift {width}x{height}"), |timer| {
            timer.iter(|| black_box(run()));
        });
    }
}

fn cameras(criterion: &mut Criterion) {
    let few = vectors(25, 20);
    let camera = fit_camera(&few, None);
    criterion.bench_function("camera 500 vectors", |timer| {
        timer.iter(|| black_box(fit_camera(&few, None)));
    });
    let many = vectors(60, 50);
    criterion.bench_function("parallax 3000 vectors", |timer| {
        timer.iter(|| black_box(find_parallax(&many, &camera, None)));
    });
}

fn points(criterion: &mut Criterion) {
    let (prev, next) = pair(640, 480);
    let one = Execution::default().threads(1);
    let corners = CornerOptions::default()
        .max_corners(400)
        .execution(one.clone());
    let options = TrackOptions::default().execution(one);
    let positions: Vec<[f32; 2]> = detect_corners(prev.view(), None, &corners)
        .unwrap()
        .iter()
        .map(|corner| corner.position)
        .collect();
    assert_eq!(positions.len(), 400);
    let mut detector = CornerDetector::default();
    let mut found = Vec::new();
    criterion.bench_function("corners 640x480", |timer| {
        timer.iter(|| {
            detector
                .detect(prev.view(), None, &corners, &mut found)
                .unwrap();
            black_box(found.len())
        });
    });
    criterion.bench_function("track 400 points 640x480", |timer| {
        timer.iter(|| {
            let tracks = track_points(
                prev.view(),
                next.view(),
                &positions,
                None,
                Masks::default(),
                &options,
            )
            .unwrap();
            black_box(tracks.len())
        });
    });
}

fn dense(criterion: &mut Criterion) {
    let (prev, next) = pair(640, 480);
    let options = DenseOptions::default()
        .preset(Preset::Fast)
        .execution(Execution::default().threads(1));
    let mut flow = DenseFlow::new(options).unwrap();
    let mut field = FlowField::default();
    criterion.bench_function("dense fast 640x480", |timer| {
        timer.iter(|| {
            flow.pair(
                prev.view(),
                next.view(),
                DenseHints::default(),
                black_box(&mut field),
            )
            .unwrap();
        });
    });
}

/// A frame taken in and the motion over a level plane, begun where the frame before leads to within a pixel.
fn plane(criterion: &mut Criterion) {
    let one = Execution::default().threads(1);
    for (width, height) in [(64, 64), (320, 240), (640, 480)] {
        let frames = pair(width, height);
        let focal = width as f64;
        let mut bent = [0.0; 12];
        bent[0] = -0.05;
        let centre = [0.5 * (width - 1) as f64, 0.5 * (height - 1) as f64];
        for (lens, distortion) in [("", [0.0; 12]), (" distorted", bent)] {
            let camera = Lens::new([focal; 2], centre, Distortion::Brown(distortion)).unwrap();
            let mut tracker = PlaneTracker::new(camera);
            let options = PlaneOptions::default()
                .rotation_std([1e-4; 3])
                .execution(one.clone());
            // To and fro, so that every frame is new.
            let (mut which, mut sign) = (0, -1.0);
            tracker.push(frames.1.view(), None, &one).unwrap();
            let mut run = || {
                let frame = [&frames.0, &frames.1][which];
                tracker.push(frame.view(), None, &one).unwrap();
                // The picture goes to the right where the camera goes to its left.
                let way = [-sign * (SHIFT.0 + 0.5) / focal, -sign * SHIFT.1 / focal];
                let start = [way[0], way[1], 0.0, 0.0, 0.0, 0.0];
                let fit = tracker.motion(&PlaneInterval::default(), &start, &options);
                (which, sign) = (1 - which, -sign);
                (fit.unwrap().unwrap(), -sign)
            };
            if lens.is_empty() {
                let (fit, sign) = run();
                assert!((fit.motion[0] * focal + sign * SHIFT.0).abs() < 0.05);
            }
            criterion.bench_function(&format!("plane {width}x{height}{lens}"), |timer| {
                timer.iter(|| black_box(run()));
            });
        }
    }
}

// Not criterion's macros: what they generate is public and has no documentation.
fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    cameras(&mut criterion);
    shifts(&mut criterion);
    points(&mut criterion);
    dense(&mut criterion);
    plane(&mut criterion);
    criterion.final_summary();
}
