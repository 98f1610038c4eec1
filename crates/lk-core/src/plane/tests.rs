//! The motion over a plane against scenes of which it is known exactly.

use ndarray::Array2;

use super::*;
use crate::{Execution, SimdLevel};

fn bent() -> Lens {
    let mut k = [0.0; 12];
    (k[0], k[1]) = (-0.25, 0.06);
    Lens::new([290.0, 290.0], [158.0, 121.0], Distortion::Brown(k)).unwrap()
}

/// Grey levels of the plane at (x, y), in heights.
fn ground(x: f64, y: f64) -> f64 {
    let mut sum = 0.0;
    let mut state = 12345u32;
    for _ in 0..24 {
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1u32 << 24)
        };
        let (a, b) = (300.0 * (random() - 0.5), 300.0 * (random() - 0.5));
        sum += (a * x + b * y + 6.3 * random()).sin();
    }
    128.0 + 10.0 * sum
}

/// Two frames of a camera that moves over the plane; the first is the reference of the ground.
fn pair(lens: &Lens, interval: &PlaneInterval, motion: &PlaneMotion) -> [Array2<f32>; 2] {
    let view = motion::View::new(lens, interval, 240, motion);
    let reference = |pixel: [f64; 2]| {
        let ray = lens.ray(pixel).unwrap();
        ground(ray[0], ray[1])
    };
    let first = Array2::from_shape_fn((240, 320), |(y, x)| reference([x as f64, y as f64]) as f32);
    // The second one by Newton's method on what the first is carried to.
    let second = Array2::from_shape_fn((240, 320), |(y, x)| {
        let goal = [x as f64, y as f64];
        let mut at = goal;
        for _ in 0..30 {
            let Some(seen) = view.carried(at) else { break };
            let off = [goal[0] - seen[0], goal[1] - seen[1]];
            at = [at[0] + off[0], at[1] + off[1]];
            if off[0].abs() + off[1].abs() < 1e-9 {
                break;
            }
        }
        reference(at) as f32
    });
    [first, second]
}

fn found(
    lens: &Lens,
    interval: &PlaneInterval,
    frames: &[Array2<f32>; 2],
    options: &PlaneOptions,
    start: &PlaneMotion,
) -> PlaneFit {
    let mut tracker = PlaneTracker::new(*lens);
    for frame in frames {
        tracker
            .push(frame.view(), None, &options.execution)
            .unwrap();
    }
    tracker.motion(interval, start, options).unwrap().unwrap()
}

#[test]
fn a_motion_is_found_from_the_frames() {
    let lens = bent();
    let interval = PlaneInterval::default().turn([0.002, -0.003, 0.004]).down([
        0.1,
        -0.05,
        (1.0f64 - 0.0125).sqrt(),
    ]);
    let truth = [0.03, -0.02, 0.01, 0.001, -0.002, 0.003];
    let frames = pair(&lens, &interval, &truth);
    let options = PlaneOptions::default().levels(3);
    let fit = found(
        &lens,
        &interval,
        &frames,
        &options,
        &[0.02, -0.01, 0.0, 0.0, 0.0, 0.0],
    );
    for (k, value) in truth.iter().enumerate() {
        let off = fit.motion[k] - value;
        assert!(off.abs() < 3e-5, "{k}: {off}");
    }
    assert!(fit.settled && fit.correlation > 0.99);
}

#[test]
fn threads_and_instructions_do_not_change_a_bit() {
    let lens = bent();
    let interval = PlaneInterval::default();
    let frames = pair(&lens, &interval, &[0.02, 0.01, 0.0, 0.0, 0.0, 0.0]);
    let mut seen = None;
    for level in SimdLevel::available() {
        for threads in [1, 3] {
            let execution = Execution::default().level(level).threads(threads);
            let options = PlaneOptions::default().execution(execution);
            let start = [0.018, 0.009, 0.0, 0.0, 0.0, 0.0];
            let fit = found(&lens, &interval, &frames, &options, &start);
            let bits = fit.motion.map(f64::to_bits);
            assert_eq!(*seen.get_or_insert(bits), bits, "{level:?} {threads}");
        }
    }
}

#[test]
fn pixels_that_a_mask_leaves_out_count_for_nothing() {
    let lens = bent();
    let interval = PlaneInterval::default();
    let truth = [0.02, -0.01, 0.0, 0.0, 0.0, 0.0];
    let frames = pair(&lens, &interval, &truth);
    let mask = Array2::from_shape_fn((240, 320), |(y, x)| !(60..200).contains(&x) || y > 170);
    let options = PlaneOptions::default().rotation_std([1e-5; 3]);
    let run = |frames: &[Array2<f32>; 2]| {
        let mut tracker = PlaneTracker::new(lens);
        for frame in frames {
            tracker
                .push(frame.view(), Some(mask.view()), &options.execution)
                .unwrap();
        }
        let start = [0.018, -0.009, 0.0, 0.0, 0.0, 0.0];
        tracker
            .motion(&interval, &start, &options)
            .unwrap()
            .unwrap()
    };
    let clean = run(&frames);
    let spoilt = frames.clone().map(|mut frame| {
        for (place, value) in frame.indexed_iter_mut() {
            if !mask[place] {
                *value = 255.0 - 0.5 * *value;
            }
        }
        frame
    });
    let fit = run(&spoilt);
    assert_eq!(fit.motion.map(f64::to_bits), clean.motion.map(f64::to_bits));
    assert!((fit.motion[0] - truth[0]).abs() < 2e-5);
}

#[test]
fn points_give_the_motion_too() {
    let lens = bent();
    let interval = PlaneInterval::default().turn([0.01, 0.0, 0.02]);
    let truth = [0.05, 0.02, -0.03, 0.002, 0.0, -0.001];
    let view = motion::View::new(&lens, &interval, 240, &truth);
    let matches: Vec<_> = (0..80)
        .map(|k| {
            let prev = [f64::from(k * 37 % 310), f64::from(k * 53 % 235)];
            let mut next = view.carried(prev).unwrap();
            // A third of them move otherwise.
            if k % 3 == 0 {
                next[0] += 5.0 + 0.1 * f64::from(k);
            }
            PlaneMatch {
                prev,
                next,
                covariance: [1e-4, 0.0, 1e-4],
            }
        })
        .collect();
    let options = PlaneOptions::default();
    let fit = fit_plane(&matches, 240, &lens, &interval, &[0.0; 6], &options)
        .unwrap()
        .unwrap();
    for (k, value) in truth.iter().enumerate() {
        assert!(
            (fit.motion[k] - value).abs() < 1e-6,
            "{k}: {}",
            fit.motion[k]
        );
    }
    let odd = fit
        .tiles
        .iter()
        .filter(|tile| tile.status == PlaneTileStatus::Outlier);
    assert_eq!(odd.count(), 27);
}

#[test]
fn bad_numbers_are_refused() {
    assert!(Lens::new([0.0, 300.0], [0.0; 2], Distortion::Brown([0.0; 12])).is_err());
    assert!(
        PlaneInterval::default()
            .down([0.0, 0.0, 2.0])
            .validate()
            .is_err()
    );
    assert!(
        PlaneOptions::default()
            .rotation_std([0.0; 3])
            .validate()
            .is_err()
    );
    let tracker = PlaneTracker::new(bent());
    let early = tracker.motion(
        &PlaneInterval::default(),
        &[0.0; 6],
        &PlaneOptions::default(),
    );
    assert!(early.is_err());
}
