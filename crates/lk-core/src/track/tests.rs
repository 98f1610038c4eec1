//! The fast code against a plain one in f64, and the properties that must hold for any input.

use ndarray::{Array2, s};
use proptest::prelude::*;

use super::*;
use crate::execution::Execution;
use crate::illumination::Illumination;
use crate::simd::SimdLevel;

/// A smooth picture that repeats nowhere near, at any position.
fn picture(x: f64, y: f64) -> f64 {
    120.0
        + 25.0 * (0.31 * x + 0.05 * y + 2.0 * (0.05 * y).sin()).sin() * (0.27 * y - 0.04 * x).cos()
        + 25.0 * (0.13 * x - 0.21 * y + 3.0 * (0.04 * x).cos()).sin()
        + 25.0 * (0.05 * x + 0.03 * y + (0.023 * x * y / 20.0).sin()).cos()
        + 15.0 * (0.45 * x + 0.38 * y + 2.0 * (0.06 * x).sin()).cos()
}

fn frame(height: usize, width: usize, dx: f64, dy: f64) -> Array2<f32> {
    Array2::from_shape_fn((height, width), |(y, x)| {
        picture(x as f64 - dx, y as f64 - dy) as f32
    })
}

fn grid(height: usize, width: usize, margin: usize) -> Vec<[f32; 2]> {
    let mut points = Vec::new();
    for y in (margin..height.saturating_sub(margin)).step_by(9) {
        for x in (margin..width.saturating_sub(margin)).step_by(11) {
            points.push([x as f32 + 0.25, y as f32 + 0.6]);
        }
    }
    points
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_window_finds_a_shift(
        width in 11usize..=63, height in 11usize..=63, dx in -2.0..2.0f64, dy in -2.0..2.0f64,
        gain in 0.7..1.4f64, offset in -20.0..20.0f64,
    ) {
        let prev = frame(120, 140, 0.0, 0.0);
        let next = frame(120, 140, dx, dy).mapv(|a| (gain * f64::from(a) + offset) as f32);
        let options = TrackOptions::default().window_size(width, height);
        let points = grid(120, 140, 36);
        let tracks = track_points(prev.view(), next.view(), &points, None, Masks::default(), &options).unwrap();
        for (point, track) in points.iter().zip(&tracks) {
            prop_assert_eq!(track.status, PointStatus::Tracked);
            let error = (f64::from(track.position[0] - point[0]) - dx)
                .hypot(f64::from(track.position[1] - point[1]) - dy);
            prop_assert!(error < 0.04, "{} px with {} x {}", error, width, height);
        }
    }

    #[test]
    fn nothing_panics(
        width in 1usize..50, height in 1usize..50, window in 3usize..=63, other in 3usize..=63,
        points in prop::collection::vec((-100.0..100.0f32, -100.0..100.0f32), 0..20),
        bad in prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::MAX, 0.0]),
        seed in any::<u64>(),
    ) {
        let noise = |salt: u64| Array2::from_shape_fn((height, width), |(y, x)| {
            let mixed = (x as u64 * 31 + y as u64 * 17 + salt).wrapping_mul(seed | 1) >> 40;
            if mixed.is_multiple_of(97) { bad } else { (mixed % 256) as f32 }
        });
        let (prev, next) = (noise(1), noise(2));
        let mut points: Vec<[f32; 2]> = points.into_iter().map(|(x, y)| [x, y]).collect();
        points.push([bad, 3.0]);
        let options = TrackOptions::default().window_size(window, other);
        let tracks = track_points(prev.view(), next.view(), &points, Some(&points), Masks::default(), &options).unwrap();
        prop_assert_eq!(tracks.len(), points.len());
        for track in tracks {
            prop_assert_eq!(track.is_valid(), track.position[0].is_finite());
            prop_assert_eq!(track.is_valid(), track.covariance[0].is_finite());
            prop_assert!(track.covariance.iter().all(|value| !value.is_nan()));
        }
    }

    #[test]
    fn threads_and_instructions_change_no_bit(dx in -6.0..6.0f64, window in 5usize..40) {
        let prev = frame(100, 130, 0.0, 0.0);
        let next = frame(100, 130, dx, 1.5);
        let points = grid(100, 130, 0);
        let run = |execution: Execution| {
            let options = TrackOptions::default().window_size(window, 21).execution(execution);
            let tracks = track_points(prev.view(), next.view(), &points, None, Masks::default(), &options).unwrap();
            tracks.iter().map(|track| {
                let mut bits = track.position.map(f32::to_bits).to_vec();
                bits.extend(track.covariance.map(f32::to_bits));
                bits.extend([track.residual.to_bits(), track.status as u32]);
                bits
            }).collect::<Vec<_>>()
        };
        let want = run(Execution::default().threads(1).level(SimdLevel::Baseline));
        for level in SimdLevel::available() {
            for threads in [1, 2, 7] {
                prop_assert_eq!(&run(Execution::default().threads(threads).level(level)), &want);
            }
        }
    }

    #[test]
    fn transposed_frames_give_transposed_points(dx in -4.0..4.0f64, dy in -4.0..4.0f64) {
        let prev = frame(110, 130, 0.0, 0.0);
        let next = frame(110, 130, dx, dy);
        let points = grid(110, 130, 20);
        let turned: Vec<[f32; 2]> = points.iter().map(|[x, y]| [*y, *x]).collect();
        let options = TrackOptions::default();
        let tracks = track_points(prev.view(), next.view(), &points, None, Masks::default(), &options).unwrap();
        let other = track_points(prev.t(), next.t(), &turned, None, Masks::default(), &options).unwrap();
        for (track, other) in tracks.iter().zip(&other) {
            prop_assert_eq!(track.status, other.status);
            if track.is_valid() {
                prop_assert!((track.position[0] - other.position[1]).abs() < 0.01);
                prop_assert!((track.position[1] - other.position[0]).abs() < 0.01);
            }
        }
    }

    #[test]
    fn swapped_frames_give_the_opposite(dx in -4.0..4.0f64, dy in -4.0..4.0f64) {
        let prev = frame(110, 130, 0.0, 0.0);
        let next = frame(110, 130, dx, dy);
        let points = grid(110, 130, 24);
        let options = TrackOptions::default();
        let there = track_points(prev.view(), next.view(), &points, None, Masks::default(), &options).unwrap();
        let moved: Vec<[f32; 2]> = there.iter().map(|track| track.position).collect();
        let back = track_points(next.view(), prev.view(), &moved, None, Masks::default(), &options).unwrap();
        for (point, back) in points.iter().zip(&back) {
            let error = (point[0] - back.position[0]).hypot(point[1] - back.position[1]);
            prop_assert!(error < 0.03, "{} px, {:?}", error, back);
        }
    }
}

/// Memory is kept from call to call; what was in it must not be seen.
#[test]
fn what_was_tracked_before_changes_no_bit() {
    let (prev, next) = (frame(100, 130, 0.0, 0.0), frame(100, 130, 2.3, 1.5));
    let points = grid(100, 130, 0);
    let track = |prev: &Array2<f32>, next: &Array2<f32>, side: usize| {
        let one = Execution::default().threads(1);
        let options = TrackOptions::default()
            .window_size(side, side)
            .execution(one);
        let tracks = track_points(
            prev.view(),
            next.view(),
            &points,
            None,
            Masks::default(),
            &options,
        )
        .unwrap();
        let bits = |track: &TrackedPoint| {
            let position = track.position.map(f32::to_bits);
            (position, track.covariance.map(f32::to_bits), track.status)
        };
        tracks.iter().map(bits).collect::<Vec<_>>()
    };
    for side in [5usize, 17, 21, 39] {
        // A thread of its own has no memory yet.
        let want =
            std::thread::scope(|scope| scope.spawn(|| track(&prev, &next, side)).join().unwrap());
        for (bad, other) in [(f32::NAN, 63), (f32::MAX, 45), (f32::INFINITY, 9)] {
            let spoilt = Array2::from_elem((100, 130), bad);
            track(&spoilt, &next, other);
            track(&next, &spoilt, other);
            assert_eq!(
                track(&prev, &next, side),
                want,
                "{side} after {bad} and {other}"
            );
        }
    }
}

#[test]
fn no_motion_is_exactly_none() {
    let still = frame(90, 110, 0.0, 0.0);
    for illumination in [
        Illumination::None,
        Illumination::Offset,
        Illumination::GainOffset,
    ] {
        let options = TrackOptions::default().illumination(illumination);
        let points = grid(90, 110, 0);
        let tracks = track_points(
            still.view(),
            still.view(),
            &points,
            None,
            Masks::default(),
            &options,
        )
        .unwrap();
        for (point, track) in points.iter().zip(&tracks) {
            assert_eq!(track.position, *point);
        }
    }
}

#[test]
fn strides_change_no_bit() {
    let prev = frame(200, 260, 0.0, 0.0);
    let next = frame(200, 260, 1.2, -0.8);
    let options = TrackOptions::default();
    let points = grid(80, 100, 15);
    let (a, b) = (
        prev.slice(s![10..170;2, 20..220;2]),
        next.slice(s![10..170;2, 20..220;2]),
    );
    let strided = track_points(a, b, &points, None, Masks::default(), &options).unwrap();
    let (a, b) = (a.to_owned(), b.to_owned());
    let dense = track_points(
        a.view(),
        b.view(),
        &points,
        None,
        Masks::default(),
        &options,
    )
    .unwrap();
    assert_eq!(strided, dense);
}

#[test]
fn misuse_is_an_error_that_says_what() {
    let prev = Array2::<u8>::zeros((20, 30));
    let next = Array2::<u8>::zeros((20, 31));
    let options = TrackOptions::default();
    let message = |result: Result<Vec<TrackedPoint>>| result.unwrap_err().to_string();
    assert_eq!(
        message(track_points(
            prev.view(),
            next.view(),
            &[],
            None,
            Masks::default(),
            &options
        )),
        "next: got (20, 31), expected the shape of prev, (20, 30)"
    );
    assert_eq!(
        message(track_points(
            prev.view(),
            prev.view(),
            &[],
            Some(&[[0.0; 2]]),
            Masks::default(),
            &options
        )),
        "initial: got 1 points, expected one for each of the 0 points"
    );
    let mask = Array2::from_elem((2, 2), true);
    assert_eq!(
        message(track_points(
            prev.view(),
            prev.view(),
            &[],
            None,
            Masks::default().next(mask.view()),
            &options
        )),
        "next_mask: got (2, 2), expected the shape of the frames, (20, 30)"
    );
}
