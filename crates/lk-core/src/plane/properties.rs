//! The plane's parts against plain versions of them, and what must hold for any motion and any lens.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use ndarray::Array2;
use proptest::prelude::*;

use super::motion::{View, rotate, rotation};
use super::tile::{Buffers, Place, REACH, SumTile, Sums};
use super::*;
use crate::SimdLevel;
use crate::frame::Plane;
use crate::shift::filters::{DERIVATIVE, taps};
use crate::simd::dispatch;

/// A lens that bends as those of webcams do, or none.
fn brown() -> impl Strategy<Value = Lens> {
    let coefficients = (-0.3..0.1, -0.05..0.1, -0.003..0.003, -0.003..0.003);
    (150.0..400.0, 0.95..1.05, coefficients).prop_map(|(focal, aspect, (k1, k2, p1, p2))| {
        let mut k = [0.0; 12];
        (k[0], k[1], k[2], k[3]) = (k1, k2, p1, p2);
        Lens::new([focal, aspect * focal], [80.7, 58.9], Distortion::Brown(k)).unwrap()
    })
}

fn fisheye() -> impl Strategy<Value = Lens> {
    let coefficients = (-0.05..0.05, -0.02..0.02, -0.005..0.005);
    (60.0..400.0, coefficients).prop_map(|(focal, (k1, k2, k3))| {
        Lens::new(
            [focal; 2],
            [80.7, 58.9],
            Distortion::Fisheye([k1, k2, k3, 0.0]),
        )
        .unwrap()
    })
}

/// A direction near that of the optical axis.
fn down(x: f64, y: f64) -> [f64; 3] {
    rotate(&rotation([x, y, 0.0]), [0.0, 0.0, 1.0])
}

/// Grey levels at a place on the plane, in heights; `fine` is about the pixels in a height.
fn ground(fine: f64, x: f64, y: f64) -> f64 {
    let (x, y) = (fine * x, fine * y);
    let wave = |a: f64, b: f64, c: f64| (a * x + b * y + c).sin();
    120.0
        + 16.0 * wave(0.31, 0.05, 0.3) * wave(-0.04, 0.27, 1.1)
        + 14.0 * wave(0.13, -0.41, 0.0)
        + 12.0 * wave(0.55, 0.23, 2.0)
        + 12.0 * wave(-0.19, 0.61, 0.7)
        + 12.0 * wave(0.071, 0.043, 1.3)
        + 10.0 * wave(0.43, -0.37, 0.2) * wave(0.017, 0.039, 0.6)
}

const SIZE: (usize, usize) = (120, 160);

/// Both frames of a motion, the first of which is the reference of the ground.
fn frames(lens: &Lens, interval: &PlaneInterval, motion: &PlaneMotion) -> Option<[Array2<f32>; 2]> {
    let view = View::new(lens, interval, SIZE.0, motion);
    let level = |pixel: [f64; 2]| {
        let ray = lens.ray(pixel)?;
        let far = motion::dot(interval.down, ray);
        Some(ground(lens.focal[0], ray[0] / far, ray[1] / far))
    };
    let mut made = [Array2::zeros(SIZE), Array2::zeros(SIZE)];
    for row in 0..SIZE.0 {
        for column in 0..SIZE.1 {
            let goal = [column as f64, row as f64];
            made[0][[row, column]] = level(goal)? as f32;
            let mut at = goal;
            for _ in 0..60 {
                let seen = view.carried(at)?;
                let off = [goal[0] - seen[0], goal[1] - seen[1]];
                at = [at[0] + off[0], at[1] + off[1]];
                if off[0].abs() + off[1].abs() < 1e-9 {
                    break;
                }
            }
            made[1][[row, column]] = level(at)? as f32;
        }
    }
    Some(made)
}

/// The largest displacement, in pixels, by which two motions differ over a frame.
fn apart(lens: &Lens, interval: &PlaneInterval, one: &PlaneMotion, other: &PlaneMotion) -> f64 {
    let views = [one, other].map(|motion| View::new(lens, interval, SIZE.0, motion));
    let mut most: f64 = 0.0;
    for y in [10.0, 60.0, 109.0] {
        for x in [10.0, 80.0, 149.0] {
            let [a, b] = [0, 1].map(|k| views[k].carried([x, y]).unwrap());
            most = most.max((a[0] - b[0]).hypot(a[1] - b[1]));
        }
    }
    most
}

fn vector(size: f64) -> [std::ops::Range<f64>; 3] {
    std::array::from_fn(|_| -size..size)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_motion_is_found(
        lens in brown(), tilt in [-0.3..0.3f64, -0.3..0.3], turn in vector(0.02), way in vector(0.03),
        more in vector(0.004), start_off in [-1.0..1.0f64, -1.0..1.0],
    ) {
        let interval = PlaneInterval::default().turn(turn).down(down(tilt[0], tilt[1]));
        let truth = [way[0], way[1], way[2], more[0], more[1], more[2]];
        let made = frames(&lens, &interval, &truth);
        prop_assume!(made.is_some());
        let options = PlaneOptions::default().levels(2);
        let mut tracker = PlaneTracker::new(lens);
        for frame in made.iter().flatten() {
            tracker.push(frame.view(), None, &options.execution).unwrap();
        }
        let mut start = truth;
        for axis in 0..2 {
            start[axis] += start_off[axis] / lens.focal[axis];
        }
        let fit = tracker.motion(&interval, &start, &options).unwrap().unwrap();
        prop_assert!(fit.settled);
        // Twice the filters' bound on what all tiles have in common, and what the motion's bend over a tile adds.
        let off = apart(&lens, &interval, &truth, &fit.motion);
        prop_assert!(off < 0.01, "off by {} px", off);
        let worst = fit.tiles.iter().filter(|tile| tile.weight > 0.5).map(|tile| tile.residual[0].hypot(tile.residual[1]));
        prop_assert!(worst.fold(0.0, f64::max) < 0.05);
    }

    #[test]
    fn points_without_outliers_are_plain_least_squares(
        lens in brown(), tilt in [-0.2..0.2f64, -0.2..0.2], way in vector(0.05), turn in vector(0.02), seed in 0u64..1000,
    ) {
        let interval = PlaneInterval::default().turn(turn).down(down(tilt[0], tilt[1]));
        let truth = [way[0], way[1], way[2], 0.001, -0.002, 0.003];
        let view = View::new(&lens, &interval, SIZE.0, &truth);
        let mut state = seed.wrapping_mul(2) + 1;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1u32 << 31) - 0.5
        };
        let mut matches: Vec<PlaneMatch> = Vec::new();
        for _ in 0..60 {
            let prev = [80.0 + 150.0 * random(), 60.0 + 110.0 * random()];
            let Some(next) = view.carried(prev) else { continue };
            // No residual is so long that the weight depends on it by more than the comparison allows.
            let next = [next[0] + 2e-4 * random(), next[1] + 2e-4 * random()];
            let (xx, yy) = (0.02 + 0.01 * random(), 0.02 + 0.01 * random());
            matches.push(PlaneMatch { prev, next, covariance: [xx, 0.3 * (xx * yy).sqrt(), yy] });
        }
        let options = PlaneOptions::default();
        let fit = fit_plane(&matches, SIZE.0, &lens, &interval, &[0.0; 6], &options).unwrap().unwrap();
        let weights: Vec<f64> = fit.tiles.iter().map(|tile| tile.weight).collect();
        let (plain, normal) = least_squares(&matches, &weights, &lens, &interval, &truth);
        prop_assert!(apart(&lens, &interval, &plain, &fit.motion) < 2e-6);
        // The matrix is the plain one over one number: the square of the scale.
        let square = fit.scale * fit.scale;
        for (row, plain_row) in fit.normal.iter().zip(&normal) {
            for (value, plain) in row.iter().zip(plain_row) {
                let size = normal.iter().flatten().fold(0.0f64, |most, v| most.max(v.abs()));
                prop_assert!((value * square - plain).abs() < 1e-4 * size);
            }
        }
    }

    #[test]
    fn rays_undo_pictures(lens in prop_oneof![brown(), fisheye()], at in [-0.55..0.55f64, -0.45..0.45], depth in 0.1..10.0f64) {
        let pixel = lens.project([at[0] * depth, at[1] * depth, depth]);
        prop_assume!(pixel.is_some());
        let pixel = pixel.unwrap();
        let ray = lens.ray(pixel).unwrap();
        prop_assert!((ray[0] - at[0]).abs() < 1e-9 && (ray[1] - at[1]).abs() < 1e-9 && ray[2] == 1.0);
        let again = lens.project(ray).unwrap();
        prop_assert!((again[0] - pixel[0]).abs() < 1e-7 && (again[1] - pixel[1]).abs() < 1e-7);
    }

    #[test]
    fn a_tile_is_what_plain_loops_make_of_it(
        side in prop_oneof![Just(8usize), Just(16), Just(24), Just(32)], fraction in [-0.5..0.5f64, -0.5..0.5],
        gradient in [-0.1..0.1f64, -0.1..0.1, -0.1..0.1, -0.1..0.1], corner in [4usize..9, 4usize..9],
        by in [0usize..5, 0usize..5], weighted: bool, seed in 0u32..1000,
    ) {
        let frames = [0, 1].map(|k| plane(56, seed + 7919 * k));
        let place = Place { corners: [corner, [corner[0] + by[0], corner[1] + by[1]]], fraction, gradient };
        let mut weight = [[1.0f32; 32]; 32];
        for (y, row) in weight.iter_mut().enumerate() {
            for (x, value) in row.iter_mut().enumerate() {
                *value = ((x * 7 + y * 3 + seed as usize) % 5).min(1) as f32;
            }
        }
        let plain = plain_sums([&frames[0], &frames[1]], &place, side, weighted.then_some(&weight));
        let mut first = None;
        for level in SimdLevel::available() {
            let mut buffers = Buffers::default();
            buffers.weight = weight;
            let tile = SumTile { frames: [&frames[0], &frames[1]], place, side, weighted, buffers: &mut buffers };
            let sums = numbers(&dispatch(level, tile));
            let bits = sums.map(f64::to_bits);
            prop_assert_eq!(*first.get_or_insert(bits), bits, "{:?}", level);
            for (k, (value, (exact, size))) in sums.iter().zip(plain).enumerate() {
                // In units of the sum of the terms' sizes: what rounding of f32 may come to.
                prop_assert!((value - exact).abs() <= 4e-6 * size + 1e-9, "{}: {} {}", k, value, exact);
            }
        }
    }
}

/// Gauss and Newton over all points at once, from the truth on, with the rotation's prior of one radian.
fn least_squares(
    matches: &[PlaneMatch],
    weights: &[f64],
    lens: &Lens,
    interval: &PlaneInterval,
    truth: &PlaneMotion,
) -> (PlaneMotion, PlaneNormal) {
    let mut motion = *truth;
    let mut normal = [[0.0; 6]; 6];
    for _ in 0..6 {
        normal = [[0.0; 6]; 6];
        let mut right = [0.0; 6];
        let predicted = |motion: &PlaneMotion, at| {
            View::new(lens, interval, SIZE.0, motion)
                .carried(at)
                .unwrap()
        };
        for (point, weight) in matches.iter().zip(weights) {
            let here = predicted(&motion, point.prev);
            let slopes: [[f64; 2]; 6] = std::array::from_fn(|k| {
                let [mut more, mut less] = [motion; 2];
                more[k] += 1e-5;
                less[k] -= 1e-5;
                let (more, less) = (predicted(&more, point.prev), predicted(&less, point.prev));
                [(more[0] - less[0]) / 2e-5, (more[1] - less[1]) / 2e-5]
            });
            let [xx, xy, yy] = point.covariance;
            let whole = xx * yy - xy * xy;
            let inverse = [[yy / whole, -xy / whole], [-xy / whole, xx / whole]];
            for a in 0..2 {
                for b in 0..2 {
                    let share = weight * inverse[a][b];
                    for i in 0..6 {
                        right[i] += share * slopes[i][a] * (point.next[b] - here[b]);
                        for j in 0..6 {
                            normal[i][j] += share * slopes[i][a] * slopes[j][b];
                        }
                    }
                }
            }
        }
        let step = eliminated(normal, right);
        for (value, by) in motion.iter_mut().zip(step) {
            *value += by;
        }
    }
    (motion, normal)
}

/// Gauss's elimination with the largest pivot of each column.
fn eliminated(mut matrix: [[f64; 6]; 6], mut right: [f64; 6]) -> [f64; 6] {
    for column in 0..6 {
        let pivot = (column..6)
            .max_by(|a, b| {
                matrix[*a][column]
                    .abs()
                    .total_cmp(&matrix[*b][column].abs())
            })
            .unwrap();
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        for row in 0..6 {
            if row != column {
                let share = matrix[row][column] / matrix[column][column];
                for k in column..6 {
                    matrix[row][k] -= share * matrix[column][k];
                }
                right[row] -= share * right[column];
            }
        }
    }
    std::array::from_fn(|k| right[k] / matrix[k][k])
}

/// Grey levels without any order, but those of neighbours alike.
fn plane(side: usize, seed: u32) -> Plane {
    let mut made = Plane::new(side, side).unwrap();
    let mut state = seed;
    for y in 0..side {
        for x in 0..side {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = (state >> 8) as f32 / (1u32 << 24) as f32;
            made.row_mut(y)[x] = 100.0
                + 40.0 * (0.5 * x as f32).sin()
                + 30.0 * (0.4 * y as f32).cos()
                + 20.0 * noise;
        }
    }
    made
}

fn numbers(s: &Sums) -> [f64; 15] {
    [
        s.n, s.x, s.y, s.m, s.t, s.xx, s.xy, s.yy, s.xm, s.ym, s.mm, s.xt, s.yt, s.mt, s.tt,
    ]
}

/// A frame at a pixel of a tile, moved by half of the fraction: forward, or back by the reversed filters.
fn sampled(plane: &Plane, place: &Place, which: usize, x: isize, y: isize) -> f64 {
    let filters = place
        .fraction
        .map(|fraction| taps(0.5 * fraction).map(f64::from));
    let mut sum = 0.0;
    for j in 0..5 {
        for i in 0..5 {
            let [a, b] = if which == 1 { [i, j] } else { [4 - i, 4 - j] };
            let column = place.corners[which][0] as isize + x + i as isize - 2;
            let row = place.corners[which][1] as isize + y + j as isize - 2;
            sum +=
                filters[0][a] * filters[1][b] * f64::from(plane.row(row as usize)[column as usize]);
        }
    }
    sum
}

/// Which of the gradient, the mean and the difference are multiplied for each sum.
const PRODUCTS: [[usize; 2]; 10] = [
    [0, 0],
    [0, 1],
    [1, 1],
    [0, 2],
    [1, 2],
    [2, 2],
    [0, 3],
    [1, 3],
    [2, 3],
    [3, 3],
];

/// The sums in f64, pixel by pixel, each with the sum of the sizes of what f32 rounds in it: grey levels up to 200.
fn plain_sums(
    frames: [&Plane; 2],
    place: &Place,
    side: usize,
    weight: Option<&[[f32; 32]; 32]>,
) -> [(f64, f64); 15] {
    let sample = |which: usize, x: isize, y: isize| sampled(frames[which], place, which, x, y);
    let mean = |x: isize, y: isize| 0.5 * (sample(0, x, y) + sample(1, x, y));
    // The level that is taken from the mean: the kernel's middle, from which its border of two is off.
    let half = (side / 2) as isize + 2 + REACH as isize / 2 - 4;
    let level = mean(half, half);
    let centre = 0.5 * (side as f64 - 1.0);
    let mut sums = [(0.0, 0.0); 15];
    for y in 0..side as isize {
        for x in 0..side as isize {
            let (mut gx, mut gy) = (0.0, 0.0);
            for (k, tap) in DERIVATIVE.iter().enumerate() {
                gx += f64::from(*tap) * mean(x + k as isize - 2, y);
                gy += f64::from(*tap) * mean(x, y + k as isize - 2);
            }
            let [ux, uy, vx, vy] = place.gradient;
            let (off_x, off_y) = (x as f64 - centre, y as f64 - centre);
            let grown = gx * (ux * off_x + uy * off_y) + gy * (vx * off_x + vy * off_y);
            let values = [
                gx,
                gy,
                mean(x, y) - level,
                sample(1, x, y) - sample(0, x, y) + grown,
            ];
            let w = weight.map_or(1.0, |weight| f64::from(weight[y as usize][x as usize]));
            let mut add = |which: usize, term: f64, size: f64| {
                sums[which].0 += w * term;
                sums[which].1 += w * (200.0 * size + 1.0);
            };
            add(0, 1.0, 0.0);
            for (k, value) in values.iter().enumerate() {
                add(1 + k, *value, 1.0);
            }
            for (k, [a, b]) in PRODUCTS.iter().enumerate() {
                add(
                    5 + k,
                    values[*a] * values[*b],
                    values[*a].abs().max(values[*b].abs()),
                );
            }
        }
    }
    sums
}
