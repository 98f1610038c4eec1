//! Whole pictures: large motion, clipped light, edges of motion.

use ndarray::{Array2, s};

use super::super::*;
use super::{PRESETS, error, measure};

/// Those that measure the finest level.
const FINE: [Preset; 3] = [Preset::Fast, Preset::Balanced, Preset::Accurate];

/// Noise smoothed over about `size` pixels, in grey levels around 120, from an unbounded plane: seen after a motion.
fn field(
    height: usize,
    width: usize,
    (u, v): (isize, isize),
    size: isize,
    seed: u64,
) -> Array2<f32> {
    let hash = |y: isize, x: isize| {
        let mut state = (y as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
            ^ (x as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
            ^ seed;
        state ^= state >> 29;
        state = state.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        state ^= state >> 32;
        (state & 0xffff) as f32 / 65_535.0 - 0.5
    };
    let value = |y: isize, x: isize, size: isize| {
        let (row, column) = (y.div_euclid(size), x.div_euclid(size));
        let (fy, fx) = (
            y.rem_euclid(size) as f32 / size as f32,
            x.rem_euclid(size) as f32 / size as f32,
        );
        let ease = |f: f32| f * f * (3.0 - 2.0 * f);
        let (fy, fx) = (ease(fy), ease(fx));
        let upper = hash(row, column) * (1.0 - fx) + hash(row, column + 1) * fx;
        let lower = hash(row + 1, column) * (1.0 - fx) + hash(row + 1, column + 1) * fx;
        upper * (1.0 - fy) + lower * fy
    };
    Array2::from_shape_fn((height, width), |(y, x)| {
        let (y, x) = (y as isize - v + 10_000, x as isize - u + 10_000);
        120.0
            + 60.0 * value(y, x, size)
            + 60.0 * value(y, x, 3 * size)
            + 50.0 * value(y, x, 9 * size)
    })
}

/// Mean error over the pixels that stay in the picture, and the share of them that is valid.
fn seen(field: &FlowField, (u, v): (isize, isize)) -> (f32, f32) {
    let (mut sum, mut valid, mut count) = (0.0, 0.0f32, 0.0f32);
    for y in 8..field.height() as isize - 8 {
        for x in 8..field.width() as isize - 8 {
            let (to_x, to_y) = (x + u, y + v);
            if to_x < 8
                || to_y < 8
                || to_x >= field.width() as isize - 8
                || to_y >= field.height() as isize - 8
            {
                continue;
            }
            let at = y as usize * field.width() + x as usize;
            sum += (field.uv()[2 * at] - u as f32).hypot(field.uv()[2 * at + 1] - v as f32);
            valid += f32::from(u8::from(field.valid()[at]));
            count += 1.0;
        }
    }
    (sum / count, valid / count)
}

#[test]
fn motion_of_a_quarter_of_the_picture_is_found_in_any_light() {
    let (height, width) = (240, 320);
    let prev = field(height, width, (0, 0), 3, 1);
    for motion in [(60, 0), (80, 30), (-50, 60)] {
        let steady = field(height, width, motion, 3, 1);
        for (light, next) in [
            ("steady", steady.clone()),
            ("gain", steady.mapv(|a| 0.75 * a + 10.0)),
        ] {
            for preset in PRESETS {
                let options = DenseOptions::default().preset(preset);
                let (error, valid) = seen(&measure(prev.view(), next.view(), &options), motion);
                assert!(error < 0.25, "{preset:?} {motion:?} {light}: {error}");
                assert!(valid > 0.9, "{preset:?} {motion:?} {light}: {valid}");
            }
        }
    }
}

#[test]
fn two_large_motions_are_both_found() {
    let (height, width) = (240, 320);
    let (left, right) = ((-40, 30), (36, -28));
    let mut prev = field(height, width, (0, 0), 3, 1);
    let mut next = field(height, width, left, 3, 1);
    prev.slice_mut(s![.., 160..])
        .assign(&field(height, width, (0, 0), 3, 2).slice(s![.., 160..]));
    next.slice_mut(s![.., 160..])
        .assign(&field(height, width, right, 3, 2).slice(s![.., 160..]));
    let found = measure(prev.view(), next.view(), &DenseOptions::default());
    for (columns, (u, v)) in [(60..110, left), (190..260, right)] {
        for y in (60..180).step_by(10) {
            for x in columns.clone().step_by(10) {
                let at = 2 * (y * width + x);
                let (found_u, found_v) = (found.uv()[at], found.uv()[at + 1]);
                assert!(
                    (found_u - u as f32).hypot(found_v - v as f32) < 0.5,
                    "({x}, {y}): {found_u} {found_v}"
                );
            }
        }
    }
}

#[test]
fn what_a_sensor_clips_leads_nowhere() {
    let (height, width) = (200, 260);
    let prev = field(height, width, (0, 0), 4, 3).mapv(|a| a.round().clamp(0.0, 255.0) as u8);
    // A ramp that brings the right third of the picture to the limit of the sensor.
    let mut next = field(height, width, (3, -2), 4, 3);
    next.indexed_iter_mut()
        .for_each(|((_, x), a)| *a *= 0.7 + 1.5 * x as f32 / width as f32);
    let next = next.mapv(|a| a.round().clamp(0.0, 255.0) as u8);
    for preset in FINE {
        let found = measure(
            prev.view(),
            next.view(),
            &DenseOptions::default().preset(preset),
        );
        let error = error(&found, 3.0, -2.0);
        assert!(error < 0.25, "{preset:?}: {error}");
        assert!(
            !found.valid()[100 * width + 250],
            "{preset:?}: a clipped window has nothing to measure"
        );
    }
}

#[test]
fn an_edge_of_motion_is_not_valid_and_the_rest_is() {
    let (height, width) = (160, 240);
    let mut prev = field(height, width, (0, 0), 3, 4);
    let mut next = prev.clone();
    let thing = field(height, width, (0, 0), 3, 5);
    prev.slice_mut(s![50..110, 80..160])
        .assign(&thing.slice(s![50..110, 80..160]));
    let moved = field(height, width, (6, 3), 3, 5);
    next.slice_mut(s![53..113, 86..166])
        .assign(&moved.slice(s![53..113, 86..166]));
    for preset in FINE {
        let found = measure(
            prev.view(),
            next.view(),
            &DenseOptions::default().preset(preset),
        );
        let (mut wrong, mut right, mut edge, mut flagged) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
        for y in 8..height - 8 {
            for x in 8..width - 8 {
                let inside = (50..110).contains(&y) && (80..160).contains(&x);
                let (u, v) = if inside { (6.0, 3.0) } else { (0.0, 0.0) };
                let at = y * width + x;
                let error = (found.uv()[2 * at] - u).hypot(found.uv()[2 * at + 1] - v);
                if found.valid()[at] {
                    right += 1.0;
                    wrong += f32::from(u8::from(error > 1.0));
                }
                // Covered in `next`.
                if !inside && (53..113).contains(&y) && (86..166).contains(&x) {
                    edge += 1.0;
                    flagged += f32::from(u8::from(!found.valid()[at]));
                }
            }
        }
        assert!(
            right > 0.8 * ((height - 16) * (width - 16)) as f32,
            "{preset:?}: {right}"
        );
        assert!(wrong < 0.005 * right, "{preset:?}: {wrong} of {right}");
        assert!(flagged > 0.9 * edge, "{preset:?}: {flagged} of {edge}");
    }
}
