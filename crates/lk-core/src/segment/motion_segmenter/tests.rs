use ndarray::Array2;

use super::*;
use crate::segment::made::{Numbers, every_way};

const SIZE: (usize, usize) = (801, 403);

/// A noisy picture over which a chequered square of 41 pixels goes 4 to the right a frame, and whether a pixel is of it.
fn shown(number: usize) -> (Array2<u8>, Vec<bool>) {
    let mut numbers = Numbers::new(number as u64);
    let left = 100 + 4 * number;
    let covers = |x: usize, y: usize| (left..left + 41).contains(&x) && (150..191).contains(&y);
    let frame = Array2::from_shape_fn((SIZE.1, SIZE.0), |(y, x)| {
        let level = if covers(x, y) {
            (((x - left) / 3 * 7919 + y / 3 * 4729) % 211) as f64 + 20.0
        } else {
            90.0 + 25.0 * (x as f64 / 9.0).sin() + 20.0 * (y as f64 / 7.0).cos()
        };
        (level + 1.5 * numbers.normal()).round() as u8
    });
    let truth = (0..SIZE.0 * SIZE.1).map(|at| covers(at % SIZE.0, at / SIZE.0));
    (frame, truth.collect())
}

/// The square's flow, for blocks of `by` pixels.
fn flow(number: usize, by: usize) -> (Vec<f32>, Vec<bool>, (usize, usize)) {
    let size = (SIZE.0.div_ceil(by), SIZE.1.div_ceil(by));
    let truth = shown(number).1;
    let uv = (0..size.0 * size.1).flat_map(|at| {
        let (x, y) = (at % size.0 * by, at / size.0 * by);
        let (x, y) = ((x + by / 2).min(SIZE.0 - 1), (y + by / 2).min(SIZE.1 - 1));
        [
            if truth[y * SIZE.0 + x] {
                4.0 / by as f32
            } else {
                0.0
            },
            0.0,
        ]
    });
    (uv.collect(), vec![true; size.0 * size.1], size)
}

#[test]
fn large_frames_are_judged_at_half_their_resolution() {
    for camera_moves in [false, true] {
        let mut first: Option<Vec<u8>> = None;
        for by in [1, 2] {
            for execution in every_way() {
                let options = SegmenterOptions::new(camera_moves, 40, 1.0, 0.29);
                let mut segmenter = MotionSegmenter::new(options, SIZE).unwrap();
                assert_eq!(segmenter.reduced_size(), (401, 202));
                for number in 0..14 {
                    let (uv, valid, size) = flow(number, by);
                    let given = GivenFlow {
                        uv: &uv,
                        valid: &valid,
                        size,
                    };
                    let given = (number > 0).then_some(given);
                    let seen = segmenter
                        .update(shown(number).0.view(), given, None, &execution)
                        .unwrap();
                    // Of 1.5 levels, with what rounding and interpolation add.
                    assert!(
                        number < 10 || (1.2..2.4).contains(&seen.noise),
                        "{}",
                        seen.noise
                    );
                    if number == 7 {
                        let kept = segmenter.snapshot();
                        segmenter = MotionSegmenter::new(
                            SegmenterOptions::new(camera_moves, 40, 1.0, 0.29),
                            SIZE,
                        )
                        .unwrap();
                        segmenter.restore(&kept).unwrap();
                        let mut scene = vec![f32::NAN; SIZE.0 * SIZE.1];
                        segmenter.scene(&mut scene, &execution).unwrap();
                        assert!(scene[20 * SIZE.0 + 20].is_finite());
                    }
                }
                let truth = shown(13).1;
                let pairs = || {
                    segmenter
                        .moving()
                        .iter()
                        .map(|moves| *moves == 1)
                        .zip(&truth)
                };
                let wrong = pairs().filter(|(moves, truth)| moves != *truth).count();
                // What the thing has just left, and its rims that look like the scene, are not told in each frame.
                assert!(wrong < 41 * 41 / 3, "{wrong} wrong");
                assert_eq!(
                    first.get_or_insert(segmenter.moving().to_vec()),
                    segmenter.moving()
                );

                let pixels = SIZE.0 * SIZE.1;
                let (mut length, mut motion) = (vec![0.0; pixels], vec![0.0; 2 * pixels]);
                segmenter
                    .motion(0.4, &mut length, &mut motion, &execution)
                    .unwrap();
                let middle = 170 * SIZE.0 + 172;
                assert!(
                    (length[middle] - 4.0).abs() < 0.2 && (motion[2 * middle] - 4.0).abs() < 0.2
                );
                let mut scene = vec![0.0; pixels];
                segmenter.scene(&mut scene, &execution).unwrap();
                let still = shown(13).0;
                let error =
                    |(x, y): (usize, usize)| f32::from(still[(y, x)]) - scene[y * SIZE.0 + x];
                assert!(
                    [(400, 300), (20, 20), (800, 402)]
                        .map(error)
                        .iter()
                        .all(|error| error.abs() < 8.0)
                );
            }
        }
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let mut segmenter =
        MotionSegmenter::new(SegmenterOptions::new(false, 40, 1.0, 0.29), SIZE).unwrap();
    let one = &every_way()[0];
    let (frame, _) = shown(0);
    let small = frame.slice(ndarray::s![1.., ..]);
    assert!(segmenter.update(small, None, None, one).is_err());
    assert!(
        segmenter
            .update(frame.view(), None, Some(&[true]), one)
            .is_err()
    );
    segmenter.update(frame.view(), None, None, one).unwrap();
    for size in [SIZE, (400, 200)] {
        let given = GivenFlow {
            uv: &[0.0; 2],
            valid: &[true],
            size,
        };
        assert!(
            segmenter
                .update(frame.view(), Some(given), None, one)
                .is_err()
        );
    }
    assert!(segmenter.scene(&mut [0.0], one).is_err());
}
