//! `estimate_shift` against a plain reference in f64, and its symmetries.
//!
//! Long because one scene and one reference serve every property.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lk_core::{
    Execution, Illumination, Masks, Shift, ShiftDeformation, ShiftOptions, ShiftStatus, SimdLevel,
    estimate_shift,
};
use ndarray::{Array2, s};
use proptest::prelude::*;

/// A scene with structure at several scales, from a seed.
fn scene(seed: u32) -> impl Fn(f64, f64) -> f64 {
    let mut state = u64::from(seed) * 2 + 1;
    let mut random = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 31)
    };
    let waves: Vec<[f64; 4]> = (0..40)
        .map(|_| {
            let frequency = 0.1 + 0.9 * random();
            let angle = std::f64::consts::TAU * random();
            let phase = std::f64::consts::TAU * random();
            let height = 3.0 + 6.0 * random();
            [
                frequency * angle.cos(),
                frequency * angle.sin(),
                phase,
                height,
            ]
        })
        .collect();
    move |x, y| {
        120.0
            + waves
                .iter()
                .map(|[a, b, phase, height]| height * (a * x + b * y + phase).sin())
                .sum::<f64>()
    }
}

fn pair(
    seed: u32,
    size: (usize, usize),
    d: (f64, f64),
    gain: f64,
    offset: f64,
) -> (Array2<f32>, Array2<f32>) {
    let scene = scene(seed);
    let prev = Array2::from_shape_fn(size, |(y, x)| scene(x as f64, y as f64) as f32);
    let next = Array2::from_shape_fn(size, |(y, x)| {
        (gain * scene(x as f64 - d.0, y as f64 - d.1) + offset) as f32
    });
    (prev, next)
}

fn estimate(prev: &Array2<f32>, next: &Array2<f32>) -> Shift {
    estimate_shift(
        prev.view(),
        next.view(),
        Masks::default(),
        &ShiftOptions::default(),
    )
    .unwrap()
}

/// A windowed sinc of radius 6: the slow and obvious way to look between pixels.
fn sinc_at(frame: &Array2<f64>, x: f64, y: f64) -> f64 {
    let kernel = |t: f64| {
        let p = std::f64::consts::PI * t;
        let sinc = if t == 0.0 { 1.0 } else { p.sin() / p };
        sinc * (0.5 + 0.5 * (p / 6.5).cos())
    };
    let (left, top) = (x.floor() as isize - 5, y.floor() as isize - 5);
    let (mut total, mut norm) = (0.0, 0.0);
    for j in top..top + 12 {
        for i in left..left + 12 {
            let weight = kernel(x - i as f64) * kernel(y - j as f64);
            total += weight * frame[(j as usize, i as usize)];
            norm += weight;
        }
    }
    total / norm
}

/// Least squares for displacement, gain and offset by Gauss and Newton in f64, from a start near the truth.
fn reference(prev: &Array2<f32>, next: &Array2<f32>, start: (f64, f64)) -> (f64, f64) {
    let (prev, next) = (prev.mapv(f64::from), next.mapv(f64::from));
    let (height, width) = prev.dim();
    let (mut u, mut v) = start;
    let margin = 16;
    for _ in 0..5 {
        let mut normal = [[0.0f64; 5]; 4];
        for y in margin..height - margin {
            for x in margin..width - margin {
                let (x, y) = (x as f64, y as f64);
                let prev_at = |dx, dy| sinc_at(&prev, x - u / 2.0 + dx, y - v / 2.0 + dy);
                let next_at = |dx, dy| sinc_at(&next, x + u / 2.0 + dx, y + v / 2.0 + dy);
                let both = |dx: f64, dy: f64| f64::midpoint(prev_at(dx, dy), next_at(dx, dy));
                let h = 0.25;
                let row = [
                    (both(h, 0.0) - both(-h, 0.0)) / (2.0 * h),
                    (both(0.0, h) - both(0.0, -h)) / (2.0 * h),
                    1.0,
                    both(0.0, 0.0),
                ];
                let difference = next_at(0.0, 0.0) - prev_at(0.0, 0.0);
                for i in 0..4 {
                    for j in 0..4 {
                        normal[i][j] += row[i] * row[j];
                    }
                    normal[i][4] += row[i] * difference;
                }
            }
        }
        for i in 0..4 {
            let pivot = normal[i];
            for (index, other) in normal.iter_mut().enumerate() {
                let factor = if index == i { 0.0 } else { other[i] / pivot[i] };
                for j in 0..5 {
                    other[j] -= factor * pivot[j];
                }
            }
        }
        u -= normal[0][4] / normal[0][0];
        v -= normal[1][4] / normal[1][1];
    }
    (u, v)
}

#[test]
fn agrees_with_the_reference() {
    for (seed, d, gain, offset) in [
        (1, (0.3, -0.4), 1.0, 0.0),
        (2, (2.7, 1.2), 1.3, -15.0),
        (3, (-3.45, 4.1), 0.6, 30.0),
    ] {
        let (prev, next) = pair(seed, (56, 60), d, gain, offset);
        let found = estimate(&prev, &next);
        let (u, v) = reference(&prev, &next, (d.0 + 0.1, d.1 - 0.1));
        assert!(found.is_valid());
        assert!((u - d.0).hypot(v - d.1) < 1e-3, "{u} {v} {d:?}");
        assert!(
            (found.dx - u).hypot(found.dy - v) < 2e-3,
            "{found:?} {u} {v}"
        );
    }
}

/// A mask that leaves out a disc somewhere, of up to a quarter of the frame.
fn blob((height, width): (usize, usize), seed: u32) -> Array2<bool> {
    let (x, y) = (
        f64::from(seed % 97) / 97.0 * width as f64,
        f64::from(seed % 89) / 89.0 * height as f64,
    );
    let radius = 0.1 + 0.15 * f64::from(seed % 7) / 7.0;
    Array2::from_shape_fn((height, width), |(row, column)| {
        (column as f64 - x).hypot(row as f64 - y) > radius * width.min(height) as f64
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn any_motion_and_light_is_measured(
        seed in 0u32..10_000, width in 40usize..90, height in 40usize..90,
        share in (-0.3f64..0.3, -0.3f64..0.3), gain in 0.5f64..2.0, offset in -30.0f64..30.0
    ) {
        let d = (share.0 * width as f64, share.1 * height as f64);
        let (prev, next) = pair(seed, (height, width), d, gain, offset);
        let found = estimate(&prev, &next);
        prop_assert_eq!(found.status, ShiftStatus::Valid);
        prop_assert!((found.dx - d.0).hypot(found.dy - d.1) < 0.01, "{:?} {:?}", found, d);
        prop_assert!((found.gain - gain).abs() < 0.02 * gain, "{:?} {}", found, gain);
    }

    #[test]
    fn swapping_negates_and_transposing_transposes(
        seed in 0u32..10_000, width in 24usize..70, height in 24usize..70,
        d in (-4.0f64..4.0, -4.0f64..4.0)
    ) {
        let (prev, next) = pair(seed, (height, width), d, 1.1, 5.0);
        let there = estimate(&prev, &next);
        let back = estimate(&next, &prev);
        prop_assert_eq!(there.status, back.status);
        if there.is_valid() {
            // To the last bit from the same start; near a tie of two starts, within what the iteration leaves.
            let apart = (there.dx + back.dx).hypot(there.dy + back.dy);
            prop_assert!(apart < 1e-4, "{:?} {:?}", there, back);
        }
        let turned = estimate_shift(prev.t(), next.t(), Masks::default(), &ShiftOptions::default()).unwrap();
        if there.is_valid() && turned.is_valid() {
            let apart = (turned.dx - there.dy).hypot(turned.dy - there.dx);
            prop_assert!(apart < 2e-3, "{:?} {:?}", there, turned);
        }
    }

    #[test]
    fn identical_frames_did_not_move(
        seed in 0u32..10_000, width in 1usize..80, height in 1usize..80
    ) {
        let (prev, _) = pair(seed, (height, width), (0.0, 0.0), 1.0, 0.0);
        let found = estimate(&prev, &prev);
        if found.is_valid() {
            prop_assert_eq!((found.dx, found.dy), (0.0, 0.0));
        } else {
            // An edge in a small window gives the displacement across it.
            let across = found.status == ShiftStatus::Aperture && found.direction_variance.is_finite();
            prop_assert!(across || (found.dx.is_nan() && found.covariance[0][0].is_infinite()));
            prop_assert!(width < 32 || height < 32, "{:?} {} x {}", found, width, height);
        }
    }

    #[test]
    fn threads_and_levels_do_not_change_a_bit(
        seed in 0u32..10_000, width in 20usize..200, height in 20usize..200,
        d in (-6.0f64..6.0, -6.0f64..6.0), masked in any::<bool>(), deforms in any::<bool>()
    ) {
        let (mut prev, next) = pair(seed, (height, width), d, 0.9, 3.0);
        let keep = blob((height, width), seed);
        let masks = if masked {
            prev[(height / 2, width / 3)] = f32::NAN;
            Masks::default().prev(keep.view()).next(keep.view())
        } else {
            Masks::default()
        };
        let deformation = if deforms { ShiftDeformation::Affine } else { ShiftDeformation::None };
        let run = |execution: Execution| {
            let options = ShiftOptions::default().deformation(deformation).execution(execution);
            format!("{:?}", estimate_shift(prev.view(), next.view(), masks, &options).unwrap())
        };
        let want = run(Execution::default().threads(1).level(SimdLevel::Baseline));
        for level in SimdLevel::available() {
            for threads in [1, 2, 7] {
                prop_assert_eq!(&run(Execution::default().threads(threads).level(level)), &want);
            }
        }
    }

    #[test]
    fn what_was_measured_before_changes_no_bit(
        seed in 0u32..10_000, width in 20usize..120, height in 20usize..120,
        other in (20usize..120, 20usize..120), d in (-4.0f64..4.0, -4.0f64..4.0)
    ) {
        let (prev, next) = pair(seed, (height, width), d, 0.9, 3.0);
        let fresh = std::thread::scope(|scope| {
            scope.spawn(|| format!("{:?}", estimate(&prev, &next))).join().unwrap()
        });
        // Memory is kept from call to call: fill it with another window, with pixels left out.
        let (mut a, b) = pair(seed + 1, other, (1.3, -0.4), 1.2, 0.0);
        a[(other.0 / 2, other.1 / 2)] = f32::NAN;
        let mask = Array2::from_shape_fn(other, |(y, x)| (y + 2 * x) % 11 != 0);
        estimate_shift(a.view(), b.view(), Masks::default().prev(mask.view()), &ShiftOptions::default()).unwrap();
        prop_assert_eq!(format!("{:?}", estimate(&prev, &next)), fresh);
    }

    #[test]
    fn any_stride_is_read_alike(seed in 0u32..10_000, d in (-3.0f64..3.0, -3.0f64..3.0)) {
        let (prev, next) = pair(seed, (90, 100), d, 1.0, 0.0);
        let slice = s![5..85;2, 10..90;-2];
        let (a, b) = (prev.slice(slice), next.slice(slice));
        let options = ShiftOptions::default();
        let strided = estimate_shift(a, b, Masks::default(), &options).unwrap();
        let (a, b) = (a.to_owned(), b.to_owned());
        let packed = estimate_shift(a.view(), b.view(), Masks::default(), &options).unwrap();
        prop_assert_eq!(format!("{strided:?}"), format!("{packed:?}"));
    }
}

#[test]
fn frames_without_an_answer_get_a_status() {
    let flat = Array2::from_elem((60, 60), 80.0f32);
    assert_eq!(estimate(&flat, &flat).status, ShiftStatus::NoTexture);
    // Stripes that repeat: not even across them.
    let stripes = Array2::from_shape_fn((60, 60), |(_, x)| 100.0 + 30.0 * (0.7 * x as f32).sin());
    assert!(estimate(&stripes, &stripes).dx.is_nan());
    assert_eq!(estimate(&stripes, &stripes).status, ShiftStatus::Aperture);
    let (one, _) = pair(5, (60, 60), (0.0, 0.0), 1.0, 0.0);
    let (other, _) = pair(77, (60, 60), (0.0, 0.0), 1.0, 0.0);
    assert_eq!(estimate(&one, &other).status, ShiftStatus::NoMatch);
    for size in [(0, 0), (0, 7), (1, 1), (7, 100)] {
        let tiny = Array2::<f32>::zeros(size);
        assert_eq!(estimate(&tiny, &tiny).status, ShiftStatus::TooSmall);
    }
}

#[test]
fn a_pattern_that_repeats_is_ambiguous_unless_the_motion_is_short() {
    let pattern = |x: f64, y: f64| 110.0 + 30.0 * ((0.6 * x).sin() + (0.6 * y).sin());
    let prev = Array2::from_shape_fn((60, 60), |(y, x)| pattern(x as f64, y as f64) as f32);
    let next = Array2::from_shape_fn((60, 60), |(y, x)| {
        pattern(x as f64 - 2.25, y as f64 + 1.5) as f32
    });
    assert_eq!(estimate(&prev, &next).status, ShiftStatus::Ambiguous);
    let options = ShiftOptions::default().max_displacement(5.0);
    let found = estimate_shift(prev.view(), next.view(), Masks::default(), &options).unwrap();
    assert!((found.dx - 2.25).hypot(found.dy + 1.5) < 0.01, "{found:?}");
}

#[test]
fn light_that_is_not_modelled_is_not_invented() {
    let (prev, next) = pair(9, (60, 60), (1.5, -0.7), 1.0, 20.0);
    let options = ShiftOptions::default().illumination(Illumination::Offset);
    let found = estimate_shift(prev.view(), next.view(), Masks::default(), &options).unwrap();
    assert!((found.gain - 1.0).abs() < f64::EPSILON);
    assert!((found.offset - 20.0).abs() < 0.1);
}

/// A disc, anti-aliased, on plain ground, in whole grey levels.
fn disc(size: (usize, usize), radius: f64, at: (f64, f64)) -> Array2<u8> {
    Array2::from_shape_fn(size, |(y, x)| {
        let edge = radius - (x as f64 - at.0).hypot(y as f64 - at.1) + 0.5;
        (10.0 + 230.0 * edge.clamp(0.0, 1.0)).round() as u8
    })
}

#[test]
fn a_flat_disc_is_measured_in_any_light() {
    for illumination in [
        Illumination::None,
        Illumination::Offset,
        Illumination::GainOffset,
    ] {
        let options = ShiftOptions::default().illumination(illumination);
        for (size, radius) in [((48, 48), 12.0), ((120, 160), 20.0), ((120, 160), 40.0)] {
            for d in [
                (1.0, 1.0),
                (-2.0, 1.0),
                (3.0, -2.0),
                (0.0, 2.0),
                (0.25, -0.75),
            ] {
                let (x, y) = (size.1 as f64 / 2.0 + 3.4, size.0 as f64 / 2.0 - 2.2);
                let prev = disc(size, radius, (x, y));
                let next = disc(size, radius, (x + d.0, y + d.1));
                let found =
                    estimate_shift(prev.view(), next.view(), Masks::default(), &options).unwrap();
                assert_eq!(
                    found.status,
                    ShiftStatus::Valid,
                    "{illumination} {size:?} {d:?}"
                );
                let error = (found.dx - d.0).hypot(found.dy - d.1);
                assert!(
                    error < 0.05,
                    "{illumination} {size:?} {radius} {d:?} {found:?}"
                );
            }
        }
    }
}

#[test]
fn an_edge_gives_the_displacement_across_it() {
    for degrees in [0.0f64, 30.0, 90.0, 135.0] {
        let (nx, ny) = (degrees.to_radians().cos(), degrees.to_radians().sin());
        let edge = |across: f64| {
            Array2::from_shape_fn((64, 72), |(y, x)| {
                let t = nx * (x as f64 - 36.0) + ny * (y as f64 - 32.0) - across;
                (120.0 + 70.0 * (t / 2.5).tanh()) as f32
            })
        };
        let found = estimate(&edge(0.0), &edge(1.7));
        assert_eq!(found.status, ShiftStatus::Aperture, "{degrees} {found:?}");
        let [x, y] = found.direction;
        assert!((x * nx + y * ny).abs() > 0.9999, "{degrees} {found:?}");
        let across = found.dx * nx + found.dy * ny;
        assert!((across - 1.7).abs() < 0.05, "{degrees} {found:?}");
        assert!(found.direction_variance < 0.01, "{degrees} {found:?}");
        let [[xx, _], [_, yy]] = found.covariance;
        assert!(xx.is_infinite() || yy.is_infinite(), "{degrees} {found:?}");
        if degrees == 0.0 {
            assert!(xx < 0.01 && yy.is_infinite(), "{found:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn a_window_that_deforms_gives_its_centre_and_its_gradient(
        seed in 0u32..10_000, size in 40usize..70, d in (-3.0f64..3.0, -3.0f64..3.0),
        gradient in prop::array::uniform4(-0.04f64..0.04), gain in 0.7f64..1.4
    ) {
        let scene = scene(seed);
        let middle = (size as f64 - 1.0) / 2.0;
        let [a, b, c, e] = gradient;
        // next(x + d + G (x - c)) = prev(x): look back from each pixel of next.
        let (aa, ee) = (1.0 + a, 1.0 + e);
        let determinant = aa * ee - b * c;
        let prev = Array2::from_shape_fn((size, size), |(y, x)| scene(x as f64, y as f64) as f32);
        let next = Array2::from_shape_fn((size, size), |(y, x)| {
            let (u, v) = (x as f64 - middle - d.0, y as f64 - middle - d.1);
            let x = (ee * u - b * v) / determinant + middle;
            let y = (aa * v - c * u) / determinant + middle;
            (gain * scene(x, y) + 5.0) as f32
        });
        let options = ShiftOptions::default().deformation(ShiftDeformation::Affine).max_displacement(8.0);
        let found = estimate_shift(prev.view(), next.view(), Masks::default(), &options).unwrap();
        prop_assert_eq!(found.status, ShiftStatus::Valid, "{:?}", found);
        prop_assert!((found.dx - d.0).hypot(found.dy - d.1) < 0.02, "{:?} {:?}", found, d);
        for (got, want) in found.gradient.iter().flatten().zip(gradient) {
            prop_assert!((got - want).abs() < 2e-3, "{:?} {:?}", found, gradient);
        }
        prop_assert!((found.gain - gain).abs() < 0.03 * gain, "{:?} {}", found, gain);
    }

    #[test]
    fn what_is_masked_in_either_frame_says_nothing(
        seed in 0u32..10_000, width in 50usize..90, height in 50usize..90,
        d in (-4.0f64..4.0, -4.0f64..4.0), fixed in any::<bool>(), grey in 0.0f32..255.0
    ) {
        let (mut prev, mut next) = pair(seed, (height, width), d, 1.1, 5.0);
        let keep = blob((height, width), seed);
        let other = blob((height, width), seed.wrapping_mul(31) + 7);
        let (of_prev, of_next) = if fixed { (&keep, &keep) } else { (&keep, &other) };
        let run = |prev: &Array2<f32>, next: &Array2<f32>| {
            let masks = Masks::default().prev(of_prev.view()).next(of_next.view());
            estimate_shift(prev.view(), next.view(), masks, &ShiftOptions::default()).unwrap()
        };
        let clean = run(&prev, &next);
        for (frame, mask) in [(&mut prev, of_prev), (&mut next, of_next)] {
            for (value, counts) in frame.iter_mut().zip(mask) {
                if !counts {
                    *value = if seed % 2 == 0 { f32::NAN } else { grey };
                }
            }
        }
        let found = run(&prev, &next);
        prop_assert_eq!(found.status, ShiftStatus::Valid, "{:?}", found);
        prop_assert!((found.dx - d.0).hypot(found.dy - d.1) < 0.02, "{:?} {:?}", found, d);
        let apart = (found.dx - clean.dx).hypot(found.dy - clean.dy);
        prop_assert!(apart < 1e-3, "{:?} {:?}", found, clean);
    }
}

#[test]
fn too_little_support_is_told() {
    let (prev, next) = pair(3, (60, 60), (1.0, 2.0), 1.0, 0.0);
    let left = Array2::from_shape_fn((60, 60), |(_, x)| x < 30);
    let right = left.mapv(|counts| !counts);
    let run = |masks: Masks<'_>| {
        estimate_shift(prev.view(), next.view(), masks, &ShiftOptions::default())
            .unwrap()
            .status
    };
    let none = Array2::from_elem((60, 60), false);
    assert_eq!(
        run(Masks::default().prev(none.view())),
        ShiftStatus::TooSmall
    );
    let apart = run(Masks::default().prev(left.view()).next(right.view()));
    assert!(matches!(
        apart,
        ShiftStatus::TooLittleOverlap | ShiftStatus::NoMatch | ShiftStatus::TooSmall
    ));
}
