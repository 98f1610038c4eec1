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

/// A square of this side that moves over ground that moves by (1, -1), with the motion of each pixel of `prev`, and
/// whether it is seen in both frames.
type Moving = (Array2<f32>, Array2<f32>, Array2<[f32; 2]>, Array2<bool>);
fn moving(side: isize, (u, v): (isize, isize)) -> Moving {
    let (height, width) = (240, 320);
    let (left, top) = (130 - u / 2, 90 - v / 2);
    let over =
        |x: isize, y: isize| (left..left + side).contains(&x) && (top..top + side).contains(&y);
    let over_next = |x: isize, y: isize| over(x - u, y - v);
    let mut frames = [
        field(height, width, (0, 0), 3, 1),
        field(height, width, (1, -1), 3, 1),
    ];
    let thing = [
        field(height, width, (0, 0), 3, 2),
        field(height, width, (u, v), 3, 2),
    ];
    for y in 0..height {
        for x in 0..width {
            let place = (x as isize, y as isize);
            for (at, covered) in [over(place.0, place.1), over_next(place.0, place.1)]
                .into_iter()
                .enumerate()
            {
                if covered {
                    frames[at][(y, x)] = thing[at][(y, x)];
                }
            }
        }
    }
    let motion = |y: usize, x: usize| {
        if over(x as isize, y as isize) {
            (u, v)
        } else {
            (1, -1)
        }
    };
    let truth = Array2::from_shape_fn((height, width), |(y, x)| {
        let (u, v) = motion(y, x);
        [u as f32, v as f32]
    });
    let seen = Array2::from_shape_fn((height, width), |(y, x)| {
        let (u, v) = motion(y, x);
        let (to_x, to_y) = (x as isize + u, y as isize + v);
        let inside = (0..width as isize).contains(&to_x) && (0..height as isize).contains(&to_y);
        inside && over_next(to_x, to_y) == over(x as isize, y as isize)
    });
    let [prev, next] = frames;
    (prev, next, truth, seen)
}

/// Of the pixels that are seen and move as `which` says: the share within a pixel of the truth, and the share of the
/// valid ones that are not.
fn right(
    field: &FlowField,
    (truth, seen): (&Array2<[f32; 2]>, &Array2<bool>),
    which: [f32; 2],
) -> (f32, f32) {
    let (mut near, mut count, mut valid, mut wrong) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
    for ((at, truth), seen) in truth.iter().enumerate().zip(seen) {
        let error = (field.uv()[2 * at] - truth[0]).hypot(field.uv()[2 * at + 1] - truth[1]);
        if !seen || *truth != which {
            continue;
        }
        count += 1.0;
        near += f32::from(u8::from(error < 1.0));
        if field.valid()[at] {
            valid += 1.0;
            wrong += f32::from(u8::from(error > 1.0));
        }
    }
    (near / count, wrong / valid.max(1.0))
}

#[test]
fn what_is_small_and_fast_is_found() {
    for (side, motion) in [(40, (30, 10)), (40, (-60, 40)), (64, (120, -20))] {
        let (prev, next, truth, seen) = moving(side, motion);
        let which = [motion.0 as f32, motion.1 as f32];
        for (light, next, (least, most)) in [
            ("steady", next.clone(), (0.7, 0.02)),
            // The light around what is lost is not known well.
            ("gain", next.mapv(|a| 0.75 * a + 10.0), (0.5, 0.05)),
        ] {
            for preset in PRESETS {
                let field = measure(
                    prev.view(),
                    next.view(),
                    &DenseOptions::default().preset(preset),
                );
                let (near, wrong) = right(&field, (&truth, &seen), which);
                assert!(
                    near > least && wrong < most,
                    "{preset:?} {side} {motion:?} {light}: {near} {wrong}"
                );
                let (near, wrong) = right(&field, (&truth, &seen), [1.0, -1.0]);
                assert!(
                    near > 0.95 && wrong < 0.02,
                    "{preset:?} {side} {motion:?} {light}, ground: {near} {wrong}"
                );
            }
        }
    }
}

#[test]
fn max_displacement_says_how_far_is_looked() {
    for preset in PRESETS {
        let run = |motion, most| {
            let (prev, next, truth, seen) = moving(48, motion);
            let options = DenseOptions::default()
                .preset(preset)
                .max_displacement(most);
            let field = measure(prev.view(), next.view(), &options);
            let near = right(&field, (&truth, &seen), [motion.0 as f32, motion.1 as f32]).0;
            if let Some(most) = most {
                for (uv, _) in field
                    .uv()
                    .chunks_exact(2)
                    .zip(field.valid())
                    .filter(|(_, valid)| **valid)
                {
                    assert!(uv[0].hypot(uv[1]) < most + 1.0, "{preset:?} {uv:?} {most}");
                }
            }
            near
        };
        // Half the frame is 160 pixels along x.
        for (motion, most, found) in [
            ((80, 0), Some(100.0), true),
            ((80, 0), Some(60.0), false),
            ((80, 0), Some(8.0), false),
            ((200, 0), None, false),
            ((200, 0), Some(220.0), true),
        ] {
            let near = run(motion, most);
            assert!(
                if found { near > 0.7 } else { near < 0.1 },
                "{preset:?} {motion:?} {most:?}: {near}"
            );
        }
    }
}
