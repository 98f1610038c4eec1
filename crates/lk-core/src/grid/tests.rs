//! Grids of made scenes, whose displacement is known.

mod kernels;

use ndarray::{Array2, ArrayView2, s};

use super::{Grid, GridOptions, GridShape, GridStatus, displacement_grid};
use crate::error::Error;
use crate::execution::Execution;
use crate::illumination::Illumination;
use crate::simd::SimdLevel;
use crate::support::Masks;

/// A texture without end, of waves of 5 to 21 pixels in all directions.
fn texture(x: f64, y: f64) -> f64 {
    let wave = |k: u32| {
        let k = f64::from(k);
        let (length, angle) = (0.3 + 0.9 * (k * 0.618).fract(), 2.4 * k);
        (length * (angle.cos() * x + angle.sin() * y) + 1.7 * k * k).sin()
    };
    120.0 + 14.0 * (0..24).map(wave).sum::<f64>()
}

/// Frames of `size` whose content moves by `motion`, a function of the place in the second, under `light`.
fn pair(
    size: [usize; 2],
    motion: impl Fn(f64, f64) -> [f64; 2],
    light: impl Fn(f64) -> f64,
) -> [Array2<f32>; 2] {
    let shape = (size[1], size[0]);
    let prev = Array2::from_shape_fn(shape, |(y, x)| texture(x as f64, y as f64) as f32);
    let next = Array2::from_shape_fn(shape, |(y, x)| {
        let (x, y) = (x as f64, y as f64);
        // The place in the first that comes here, by iteration.
        let (mut px, mut py) = (x, y);
        for _ in 0..40 {
            let [u, v] = motion(px, py);
            (px, py) = (x - u, y - v);
        }
        light(texture(px, py)) as f32
    });
    [prev, next]
}

/// The largest error of what is valid, and the share that is valid.
fn errors(grid: &Grid, motion: impl Fn(f64, f64) -> [f64; 2]) -> (f64, f64) {
    let (mut worst, mut valid) = (0.0f64, 0.0);
    for (at, node) in grid.nodes.iter().enumerate() {
        if node.is_valid() {
            let [x, y] = grid.place(at % grid.columns, at / grid.columns);
            let truth = motion(x, y);
            for (found, truth) in node.displacement.into_iter().zip(truth) {
                worst = worst.max((f64::from(found) - truth).abs());
            }
            valid += 1.0;
        }
    }
    (worst, valid / grid.nodes.len() as f64)
}

fn measure(frames: &[Array2<f32>; 2], masks: Masks<'_>, options: &GridOptions) -> Grid {
    displacement_grid(frames[0].view(), frames[1].view(), None, masks, options).unwrap()
}

#[test]
fn strain_turn_and_light_are_found() {
    let motion = |x: f64, y: f64| {
        [
            0.02 * (x - 80.0) - 0.03 * (y - 60.0) + 3.3,
            0.04 * (x - 80.0) + 0.01 * (y - 60.0) - 2.2,
        ]
    };
    let frames = pair([160, 128], motion, |grey| 0.8 * grey + 12.0);
    let grid = measure(&frames, Masks::default(), &GridOptions::default());
    assert_eq!((grid.columns, grid.rows, grid.first), (9, 7, [15.5, 15.5]));
    let (worst, valid) = errors(&grid, motion);
    assert!(worst < 0.004, "{worst}");
    assert!(valid > 0.95, "{valid}");
    let middle = &grid.nodes[3 * 9 + 4];
    for (found, truth) in middle
        .gradient
        .as_flattened()
        .iter()
        .zip([0.02, -0.03, 0.04, 0.01])
    {
        assert!((f64::from(*found) - truth).abs() < 3e-4, "{found} {truth}");
    }
    assert!((middle.gain - 0.8).abs() < 0.005);
    // next = gain * prev + offset where the node stands.
    assert!((middle.offset - 12.0).abs() < 1.0, "{}", middle.offset);
    assert!(middle.correlation > 0.99 && middle.residual < 2.0);
    assert!(middle.covariance[0][0] > 0.0 && middle.covariance[0][0] < 1e-4);
}

#[test]
fn what_bends_takes_a_quadratic_shape() {
    let motion = |x: f64, y: f64| [0.9 * (x / 14.0).sin(), 0.7 * (y / 16.0).cos()];
    let frames = pair([160, 160], motion, |grey| grey);
    let of = |shape| {
        measure(
            &frames,
            Masks::default(),
            &GridOptions::default().shape(shape),
        )
    };
    let (affine, quadratic) = (of(GridShape::Affine), of(GridShape::Quadratic));
    let ((rough, _), (fine, valid)) = (errors(&affine, motion), errors(&quadratic, motion));
    assert!(
        fine < 0.03 && rough > 4.0 * fine && valid > 0.95,
        "{rough} {fine} {valid}"
    );
    // What the shape cannot follow stands in its covariance.
    let wide = |grid: &Grid| {
        grid.nodes
            .iter()
            .map(|node| f64::from(node.covariance[0][0]).sqrt())
            .fold(0.0, f64::max)
    };
    assert!(wide(&affine) > 0.3 * rough, "{} {rough}", wide(&affine));
}

#[test]
fn far_motion_is_sought_and_spreads() {
    let (sin, cos) = 0.2f64.sin_cos();
    let motion = |x: f64, y: f64| {
        let (x, y) = (x - 120.0, y - 100.0);
        [cos * x - sin * y - x + 23.0, sin * x + cos * y - y - 14.0]
    };
    let frames = pair([240, 200], motion, |grey| grey);
    let (worst, valid) = errors(
        &measure(&frames, Masks::default(), &GridOptions::default()),
        motion,
    );
    assert!(worst < 0.03 && valid > 0.7, "{worst} {valid}");
    // No further than asked for.
    let near = GridOptions::default().max_displacement(Some(8.0));
    let grid = measure(&frames, Masks::default(), &near);
    let most = grid
        .nodes
        .iter()
        .filter(|node| node.is_valid())
        .flat_map(|node| node.displacement);
    assert!(most.fold(0.0f32, |most, d| most.max(d.abs())) <= 8.0);
}

#[test]
fn pixels_that_do_not_count_change_nothing() {
    let motion = |x: f64, y: f64| [0.01 * x + 1.3, -0.01 * y + 0.4];
    let mut frames = pair([128, 128], motion, |grey| grey);
    let keep = [0, 1]
        .map(|_| Array2::from_shape_fn((128, 128), |(y, x)| !(60..75).contains(&y) || x < 40));
    let measured = |frames: &[Array2<f32>; 2]| {
        let masks = Masks::default().prev(keep[0].view()).next(keep[1].view());
        measure(frames, masks, &GridOptions::default())
    };
    let before = measured(&frames);
    for frame in &mut frames {
        frame.slice_mut(s![60..75, 40..]).fill(f32::NAN);
    }
    assert_eq!(measured(&frames), before);
    let (worst, valid) = errors(&before, motion);
    assert!(worst < 0.02 && valid > 0.9, "{worst} {valid}");
    // A window that lies in what does not count says so.
    let none = Array2::from_elem((128, 128), false);
    let masks = Masks::default().prev(none.view());
    let grid = measure(&frames, masks, &GridOptions::default());
    assert!(
        grid.nodes
            .iter()
            .all(|node| node.status == GridStatus::LowSupport)
    );
    assert!(grid.nodes.iter().all(|node| node.displacement[0].is_nan()));
}

#[test]
fn a_third_of_the_pixels_that_go_another_way_are_left_out() {
    let motion = |_: f64, _: f64| [1.4, -0.7];
    let mut frames = pair([128, 128], motion, |grey| grey);
    for (y, x) in ndarray::indices((128, 128)) {
        // Blots of 6 by 6 that are not of the scene.
        if (x / 6 * 7 + y / 6 * 5) % 4 == 0 {
            frames[1][(y, x)] = ((x * 31 + y * 17) % 13 * 20) as f32;
        }
    }
    let of = |robust| {
        let options = GridOptions::default().robust(robust);
        let grid = measure(&frames, Masks::default(), &options);
        errors(&grid, motion)
    };
    let ((plain, _), (robust, valid)) = (of(false), of(true));
    assert!(
        robust < 0.05 && valid > 0.9 && plain > 3.0 * robust,
        "{plain} {robust} {valid}"
    );
}

#[test]
fn what_is_blank_or_another_scene_is_not_measured() {
    let blank = Array2::from_elem((96, 96), 80u8);
    let options = GridOptions::default();
    let grid =
        displacement_grid(blank.view(), blank.view(), None, Masks::default(), &options).unwrap();
    assert!(
        grid.nodes
            .iter()
            .all(|node| !node.is_valid() && node.covariance[0][0].is_infinite())
    );
    let noise = |seed: u32| {
        Array2::from_shape_fn((160, 160), |(y, x)| {
            let mut h =
                (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed;
            h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
            ((h ^ (h >> 13)) % 256) as u8
        })
    };
    for robust in [false, true] {
        let options = GridOptions::default().robust(robust);
        let (prev, next) = (noise(1), noise(77));
        let masks = Masks::default();
        let grid = displacement_grid(prev.view(), next.view(), None, masks, &options).unwrap();
        let valid = grid.nodes.iter().filter(|node| node.is_valid()).count();
        assert!(valid <= 1, "{valid} of {}", grid.nodes.len());
    }
}

#[test]
fn threads_and_instructions_change_no_bit() {
    let motion = |x: f64, y: f64| [0.03 * x - 4.0, 0.5 * (y / 15.0).sin() + 7.0];
    let frames = pair([150, 130], motion, |grey| 1.1 * grey - 3.0);
    for (shape, robust) in [
        (GridShape::Translation, false),
        (GridShape::Affine, false),
        (GridShape::Quadratic, true),
    ] {
        let options = GridOptions::default()
            .shape(shape)
            .robust(robust)
            .window_size(29)
            .step(11);
        let of = |threads, level| {
            let execution = Execution::default().threads(threads).level(level);
            format!(
                "{:?}",
                measure(
                    &frames,
                    Masks::default(),
                    &options.clone().execution(execution)
                )
            )
        };
        let want = of(1, SimdLevel::Baseline);
        for level in SimdLevel::available() {
            for threads in [1, 2, 5] {
                assert!(of(threads, level) == want, "{shape} {level:?} {threads}");
            }
        }
    }
}

#[test]
fn light_may_change_as_far_as_it_is_said_to() {
    let motion = |_: f64, _: f64| [0.4, -0.3];
    let frames = pair([96, 96], motion, |grey| grey + 20.0);
    for (illumination, good) in [
        (Illumination::None, false),
        (Illumination::Offset, true),
        (Illumination::GainOffset, true),
    ] {
        let options = GridOptions::default().illumination(illumination);
        let grid = measure(&frames, Masks::default(), &options);
        let (worst, valid) = errors(&grid, motion);
        assert_eq!(
            worst < 0.005 && valid == 1.0,
            good,
            "{illumination} {worst} {valid}"
        );
    }
}

#[test]
fn a_first_guess_is_taken_where_there_is_one() {
    let motion = |_: f64, _: f64| [5.25, -3.5];
    let frames = pair([128, 96], motion, |grey| grey);
    let options = GridOptions::default();
    let (columns, rows) = options.nodes(128, 96);
    let mut initial = vec![[5.0f32, -3.0]; columns * rows];
    initial[3] = [f32::NAN; 2];
    let measured = |initial: Option<&[[f32; 2]]>| {
        let [prev, next] = [0, 1].map(|at| frames[at].view());
        displacement_grid(prev, next, initial, Masks::default(), &options)
    };
    let (worst, valid) = errors(&measured(Some(&initial)).unwrap(), motion);
    assert!(worst < 0.005 && valid == 1.0, "{worst} {valid}");
    let error = measured(Some(&initial[1..])).unwrap_err();
    assert!(
        matches!(
            error,
            Error::Shape {
                what: "initial",
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn frames_without_room_for_a_window_have_no_nodes() {
    let empty = ArrayView2::<u8>::from_shape((0, 0), &[]).unwrap();
    let masks = Masks::default();
    let grid = displacement_grid(empty, empty, None, masks, &GridOptions::default()).unwrap();
    assert_eq!((grid.columns, grid.rows, grid.nodes.len()), (0, 0, 0));
    // A frame as large as one window.
    let frame = Array2::from_shape_fn((32, 32), |(y, x)| texture(x as f64, y as f64) as f32);
    let options = GridOptions::default();
    let grid = displacement_grid(frame.view(), frame.view(), None, masks, &options).unwrap();
    assert_eq!(grid.nodes.len(), 1);
    assert!(grid.nodes[0].is_valid() && grid.nodes[0].displacement[0].abs() < 1e-3);
}
