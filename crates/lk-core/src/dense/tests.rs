//! Properties of the whole.

mod greys;
mod hints;
mod parts;
mod refinement;
mod scenes;
mod sequences;
mod strips;

use ndarray::{Array2, Array3, s};

use super::*;
use crate::illumination::Illumination;
use crate::simd::SimdLevel;

/// A smooth scene with texture at several scales, seen after a motion of (u, v).
fn scene(height: usize, width: usize, u: f64, v: f64) -> Array2<f32> {
    Array2::from_shape_fn((height, width), |(y, x)| {
        let (x, y) = (x as f64 - u, y as f64 - v);
        let value = 120.0
            + 18.0 * (0.31 * x + 0.12 * y).sin()
            + 15.0 * (0.27 * y - 0.18 * x).cos()
            + 30.0 * (0.055 * x + 0.043 * y).sin()
            + 30.0 * (0.048 * y - 0.037 * x).cos()
            + 12.0 * (0.61 * x).cos() * (0.53 * y).sin();
        value as f32
    })
}

fn measure<T: Pixel>(prev: Frame<'_, T>, next: Frame<'_, T>, options: &DenseOptions) -> FlowField {
    dense_flow(prev, next, DenseHints::default(), options).unwrap()
}

/// Mean error over the picture without a border of 8 pixels.
fn error(field: &FlowField, u: f32, v: f32) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0f32);
    for y in 8..field.height() - 8 {
        for x in 8..field.width() - 8 {
            let at = 2 * (y * field.width() + x);
            sum += (field.uv()[at] - u).hypot(field.uv()[at + 1] - v);
            count += 1.0;
        }
    }
    sum / count
}

fn same_bits(a: &FlowField, b: &FlowField) -> bool {
    let bits = |values: &[f32]| {
        values
            .iter()
            .map(|value| value.to_bits())
            .collect::<Vec<_>>()
    };
    bits(a.uv()) == bits(b.uv())
        && bits(a.residual()) == bits(b.residual())
        && a.valid() == b.valid()
        && bits(a.light().0.data()) == bits(b.light().0.data())
}

const PRESETS: [Preset; 4] = [
    Preset::Ultrafast,
    Preset::Fast,
    Preset::Balanced,
    Preset::Accurate,
];

#[test]
fn recipes_stay_within_what_the_kernels_allow() {
    for preset in PRESETS {
        let recipe = recipe::Recipe::new(preset);
        for level in recipe.fine.iter().chain([&recipe.coarse]) {
            assert!((1..=3).contains(&level.radius) && level.sparse <= level.steps);
            assert!(level.distance <= 16 && level.median <= 16);
            assert!(level.steps + level.half_rounds + level.rounds > 0);
            assert!((1..=20).contains(&level.sweeps));
        }
        // Frames too small for a finer level are measured by this alone.
        assert!(recipe.coarse.steps > 0 && recipe.coarse.rounds > 0);
        assert!(recipe.finest <= 1);
        assert!((0.0..=0.25).contains(&recipe.smoothing_side()));
        let refine = recipe.refine;
        assert!((1..=3).contains(&refine.radius) && (1.0..2.0).contains(&refine.relaxation));
        for value in [
            recipe.match_ratio,
            recipe.damping,
            recipe.max_step,
            recipe.affine_gain,
            refine.alpha,
            refine.trace_floor,
            refine.data_epsilon,
            refine.smooth_epsilon,
            refine.edge_scale,
        ] {
            assert!(value > 0.0 && value.is_finite());
        }
    }
}

#[test]
fn a_shift_is_found_in_any_light() {
    let (height, width) = (150, 190);
    let prev = scene(height, width, 0.0, 0.0);
    for preset in PRESETS {
        for (u, v) in [(0.4, -0.3), (3.3, 2.6), (-9.4, 6.2)] {
            let steady = scene(height, width, u, v);
            let lights: [(&str, f32, Array2<f32>); 4] = [
                ("steady", 0.06, steady.clone()),
                ("offset", 0.06, steady.mapv(|a| a + 25.0)),
                ("gain", 0.06, steady.mapv(|a| 0.75 * a + 10.0)),
                ("ramp", 0.12, {
                    let mut lit = steady.clone();
                    lit.indexed_iter_mut()
                        .for_each(|((_, x), a)| *a *= 0.8 + 0.4 * x as f32 / width as f32);
                    lit
                }),
            ];
            for (light, most, next) in lights {
                let field = measure(
                    prev.view(),
                    next.view(),
                    &DenseOptions::default().preset(preset),
                );
                let error = error(&field, u as f32, v as f32);
                assert!(error < most, "{preset:?} ({u}, {v}) {light}: {error}");
                let valid = field.valid().iter().filter(|valid| **valid).count();
                assert!(
                    valid > height * width / 2,
                    "{preset:?} ({u}, {v}) {light}: {valid} valid"
                );
            }
        }
    }
}

#[test]
fn the_light_is_reported() {
    let prev = scene(150, 190, 0.0, 0.0);
    let next = scene(150, 190, 1.0, 0.5).mapv(|a| 0.8 * a + 15.0);
    let field = measure(prev.view(), next.view(), &DenseOptions::default());
    let (gain, offset, halvings) = field.light();
    let (x, y) = (gain.width() / 2, gain.height() / 2);
    assert_eq!(gain.width(), 190usize.div_ceil(1 << halvings));
    assert!((gain.row(y)[x] - 0.8).abs() < 0.05, "{}", gain.row(y)[x]);
    assert!(
        (offset.row(y)[x] - 15.0).abs() < 6.0,
        "{}",
        offset.row(y)[x]
    );
}

#[test]
fn identical_frames_give_exactly_zero() {
    let noise = Array2::from_shape_fn((67, 93), |(y, x)| ((y * 7919 + x * 104_729) % 251) as u8);
    for preset in PRESETS {
        for illumination in [
            Illumination::None,
            Illumination::Offset,
            Illumination::GainOffset,
        ] {
            let options = DenseOptions::default()
                .preset(preset)
                .illumination(illumination);
            let field = measure(noise.view(), noise.view(), &options);
            assert!(
                field.uv().iter().all(|value| *value == 0.0),
                "{preset:?} {illumination}"
            );
            assert!(field.residual().iter().all(|value| *value == 0.0));
        }
    }
}

#[test]
fn threads_and_instructions_change_no_bit() {
    let (prev, next) = (scene(131, 170, 0.0, 0.0), scene(131, 170, 2.3, -1.2));
    for preset in PRESETS {
        let options = DenseOptions::default().preset(preset);
        let run = |execution| {
            measure(
                prev.view(),
                next.view(),
                &options.clone().execution(execution),
            )
        };
        let want = run(Execution::default().threads(1).level(SimdLevel::Baseline));
        for threads in [1, 2, 7] {
            for level in SimdLevel::available() {
                let got = run(Execution::default().threads(threads).level(level));
                assert!(same_bits(&want, &got), "{preset:?} {threads} {level:?}");
            }
        }
    }
}

#[test]
fn strides_and_types_change_no_bit() {
    let frame = |u: f64| scene(90, 120, u, 0.0).mapv(|a| a.round() as u8);
    let (prev, next) = (frame(0.0), frame(1.7));
    let options = DenseOptions::default();
    let cut = s![5..80, 8..101];
    let want = measure(
        prev.slice(cut).to_owned().view(),
        next.slice(cut).to_owned().view(),
        &options,
    );
    assert!(same_bits(
        &want,
        &measure(prev.slice(cut), next.slice(cut), &options)
    ));
    let (deep_prev, deep_next) = (prev.mapv(u16::from), next.mapv(u16::from));
    assert!(same_bits(
        &want,
        &measure(deep_prev.slice(cut), deep_next.slice(cut), &options)
    ));
    let (prev, next) = (prev.mapv(f32::from), next.mapv(f32::from));
    let (prev, next) = (
        prev.slice(cut).reversed_axes(),
        next.slice(cut).reversed_axes(),
    );
    let (prev, next) = (prev.to_owned(), next.to_owned());
    assert!(same_bits(&want, &measure(prev.t(), next.t(), &options)));
}

#[test]
fn every_size_is_answered() {
    for (height, width) in [
        (0, 0),
        (0, 5),
        (1, 1),
        (1, 40),
        (40, 1),
        (2, 2),
        (3, 17),
        (5, 4),
        (16, 16),
        (17, 33),
    ] {
        let (prev, next) = (
            scene(height, width, 0.0, 0.0),
            scene(height, width, 0.5, 0.0),
        );
        for preset in PRESETS {
            let field = measure(
                prev.view(),
                next.view(),
                &DenseOptions::default().preset(preset),
            );
            assert_eq!(field.uv().len(), 2 * height * width);
            let measurable = height >= 2 && width >= 2;
            assert!(
                field
                    .uv()
                    .iter()
                    .all(|value| value.is_finite() == measurable),
                "{height} {width}"
            );
            assert!(measurable || !field.valid().iter().any(|valid| *valid));
        }
    }
}

#[test]
fn without_texture_nothing_is_valid() {
    let flat = Array2::from_elem((60, 80), 100u8);
    let edge = Array2::from_shape_fn((60, 80), |(_, x)| if x < 40 { 50u8 } else { 200 });
    for frame in [flat, edge] {
        let field = measure(frame.view(), frame.view(), &DenseOptions::default());
        assert!(!field.valid().iter().any(|valid| *valid));
    }
}

#[test]
fn what_is_not_finite_stays_where_it_is() {
    let (mut prev, mut next) = (scene(120, 160, 0.0, 0.0), scene(120, 160, 1.5, 0.5));
    prev[(40, 50)] = f32::NAN;
    prev.slice_mut(s![60..64, 100..110]).fill(f32::INFINITY);
    next[(90, 30)] = f32::NEG_INFINITY;
    for preset in PRESETS {
        let field = measure(
            prev.view(),
            next.view(),
            &DenseOptions::default().preset(preset),
        );
        for y in 0..120 {
            for x in 0..160 {
                let at = y * 160 + x;
                assert_eq!(
                    field.uv()[2 * at].is_nan(),
                    !prev[(y, x)].is_finite(),
                    "{x} {y}"
                );
            }
        }
        assert!(!field.valid()[90 * 160 + 29] && !field.valid()[89 * 160 + 28]);
        let (at, far) = (2 * (40 * 160 + 56), 2 * (20 * 160 + 120));
        for at in [at, far] {
            assert!(
                (field.uv()[at] - 1.5).hypot(field.uv()[at + 1] - 0.5) < 0.2,
                "{preset:?}"
            );
        }
    }
    let nothing = Array2::from_elem((50, 60), f32::NAN);
    let field = measure(nothing.view(), nothing.view(), &DenseOptions::default());
    assert!(
        field.uv().iter().all(|value| value.is_nan()) && !field.valid().iter().any(|valid| *valid)
    );
}

#[test]
fn misuse_is_refused_with_a_message() {
    let (small, large) = (Array2::<u8>::zeros((4, 5)), Array2::<u8>::zeros((4, 6)));
    let options = DenseOptions::default();
    let message = |result: Result<FlowField>| result.unwrap_err().to_string();
    assert_eq!(
        message(dense_flow(
            small.view(),
            large.view(),
            DenseHints::default(),
            &options
        )),
        "next: got (4, 6), expected the shape of prev, (4, 5)"
    );
    let mask = Array2::from_elem((5, 4), true);
    let hints = DenseHints {
        mask: Some(mask.view()),
        ..DenseHints::default()
    };
    assert_eq!(
        message(dense_flow(small.view(), small.view(), hints, &options)),
        "mask: got (5, 4), expected the shape of the frames, (4, 5)"
    );
    let initial = Array3::zeros((4, 5, 3));
    let hints = DenseHints {
        initial: Some(initial.view()),
        ..DenseHints::default()
    };
    assert_eq!(
        message(dense_flow(small.view(), small.view(), hints, &options)),
        "initial: got (4, 5, 3), expected (4, 5, 2)"
    );
    for most in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let error =
            DenseFlow::new(DenseOptions::default().max_displacement(Some(most))).unwrap_err();
        let want =
            format!("max_displacement: got {most}, expected a positive number of pixels, or None");
        assert_eq!(error.to_string(), want);
    }
    assert_eq!(
        "slow".parse::<Preset>().unwrap_err().to_string(),
        "preset: got \"slow\", expected \"ultrafast\", \"fast\", \"balanced\" or \"accurate\""
    );
}
