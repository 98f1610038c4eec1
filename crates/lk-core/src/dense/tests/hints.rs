//! What a measurement may know besides its frames: masks, and a flow to start from.

use ndarray::{Array2, Array3, s};

use super::super::{DenseHints, DenseOptions, Preset, dense_flow};
use super::{PRESETS, scene};

#[test]
fn a_mask_keeps_other_motion_out() {
    let (prev, mut next) = (scene(120, 160, 0.0, 0.0), scene(120, 160, 1.5, 0.5));
    next.slice_mut(s![.., 80..])
        .assign(&scene(120, 160, -4.0, 3.0).slice(s![.., 80..]));
    let mask = Array2::from_shape_fn((120, 160), |(_, x)| x < 76);
    let hints = DenseHints {
        mask: Some(mask.view()),
        ..DenseHints::default()
    };
    let field = dense_flow(prev.view(), next.view(), hints, &DenseOptions::default()).unwrap();
    for y in 10..110 {
        for x in 8..160 {
            let at = y * 160 + x;
            let (u, v) = (field.uv()[2 * at], field.uv()[2 * at + 1]);
            assert_eq!(u.is_nan(), x >= 76);
            assert!(
                x >= 72 || (u - 1.5).hypot(v - 0.5) < 0.3,
                "{x} {y}: {u} {v}"
            );
            assert!(x < 76 || !field.valid()[at]);
        }
    }
}

#[test]
fn what_stays_with_the_sensor_is_kept_out_by_both_masks() {
    let (mut prev, mut next) = (scene(120, 160, 0.0, 0.0), scene(120, 160, 4.5, 1.5));
    let mask = Array2::from_shape_fn((120, 160), |(y, x)| {
        !(40..80).contains(&y) || !(50..110).contains(&x)
    });
    for frame in [&mut prev, &mut next] {
        for ((y, x), value) in frame.indexed_iter_mut() {
            if !mask[(y, x)] {
                *value = if (x / 5 + y / 5) % 2 == 0 {
                    20.0
                } else {
                    230.0
                };
            }
        }
    }
    let masked = DenseHints {
        mask: Some(mask.view()),
        next_mask: Some(mask.view()),
        ..DenseHints::default()
    };
    for preset in PRESETS {
        let options = DenseOptions::default().preset(preset);
        let field = dense_flow(prev.view(), next.view(), masked, &options).unwrap();
        let (with, largest) = {
            let (mut sum, mut count, mut largest) = (0.0, 0.0, 0.0f32);
            for y in 20..100 {
                for x in 20..140 {
                    let at = y * 160 + x;
                    let [u, v] = [field.uv()[2 * at], field.uv()[2 * at + 1]];
                    let to = mask[((y as f32 + 1.5) as usize, (x as f32 + 4.5) as usize)];
                    assert!(to || !field.valid()[at], "{preset:?} {x} {y}");
                    if mask[(y, x)] && to {
                        let error = (u - 4.5).hypot(v - 1.5);
                        (sum, count) = (sum + error, count + 1.0);
                        largest = largest.max(if field.valid()[at] { error } else { 0.0 });
                    }
                }
            }
            (sum / count, largest)
        };
        // What is measured at half the size is interpolated up to the mask.
        let most = if preset == Preset::Ultrafast {
            0.7
        } else {
            0.5
        };
        assert!(with < 0.1 && largest < most, "{preset:?}: {with} {largest}");
    }
}

#[test]
fn an_initial_flow_leads_to_what_is_beyond_the_pyramid() {
    let (prev, next) = (scene(120, 160, 0.0, 0.0), scene(120, 160, 25.0, -18.0));
    let mut initial = Array3::from_elem((120, 160, 2), 24.0f32);
    initial.slice_mut(s![.., .., 1]).fill(-17.0);
    initial[(0, 0, 0)] = f32::NAN;
    initial[(4, 8, 1)] = -1e12;
    initial[(0, 8, 0)] = f32::INFINITY;
    let hints = DenseHints {
        initial: Some(initial.view()),
        ..DenseHints::default()
    };
    let field = dense_flow(prev.view(), next.view(), hints, &DenseOptions::default()).unwrap();
    let at = 2 * (70 * 160 + 60);
    assert!((field.uv()[at] - 25.0).hypot(field.uv()[at + 1] + 18.0) < 0.1);
    assert!(field.uv().iter().all(|value| value.abs() < 1e3));
}
