//! The parts against a plain reference in f64.

use proptest::prelude::*;

use super::super::padded_plane::{self, PaddedPlane};
use super::super::step::StepOptions;
use super::super::windows::{Made, Views};
use super::super::{median, propagate, step, upsample};
use crate::execution::Execution;
use crate::frame::Plane;
use crate::simd::SimdLevel;

/// A grid of pseudo-random values within `-most..most`.
pub(super) fn noise(width: usize, height: usize, seed: u32, most: f32) -> PaddedPlane {
    let mut grid = PaddedPlane::default();
    grid.resize(width, height).unwrap();
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(1);
    for y in 0..height {
        let row = grid.padded_mut(y);
        for value in &mut row[padded_plane::PAD..padded_plane::PAD + width] {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *value = ((state >> 8) as f32 / (1u32 << 23) as f32 - 1.0) * most;
        }
        padded_plane::extend(row, width);
    }
    grid
}

pub(super) fn at(grid: &PaddedPlane, y: isize, x: isize) -> f32 {
    let clamp = |value: isize, size: usize| value.clamp(0, size as isize - 1) as usize;
    grid.row(clamp(y, grid.height()))[clamp(x, grid.width())]
}

/// A bilinear sample, in f64; beyond the border the picture goes on as it is there.
fn sample(plane: &Plane, x: f64, y: f64) -> f64 {
    let (width, height) = (plane.width(), plane.height());
    let (x, y) = (
        x.clamp(0.0, (width - 1) as f64),
        y.clamp(0.0, (height - 1) as f64),
    );
    let (column, row) = ((x as usize).min(width - 2), (y as usize).min(height - 2));
    let (fx, fy) = (x - column as f64, y - row as f64);
    let value = |dy: usize, dx: usize| f64::from(plane.row(row + dy)[column + dx]);
    (1.0 - fy) * ((1.0 - fx) * value(0, 0) + fx * value(0, 1))
        + fy * ((1.0 - fx) * value(1, 0) + fx * value(1, 1))
}

/// What a bilinear sample lacks in phase, along one axis, of five pixels of `prev` and the flow.
fn lacks([a, b, c, d]: [f32; 4], flow: f32) -> f64 {
    let f = f64::from(flow - flow.floor());
    let third = 0.5 * f64::from(d - a) - f64::from(c - b);
    f * (1.0 - f) * (1.0 - 2.0 * f) / 6.0 * third
}

/// The pixels of a window that count: gx, gy, d, by their definition, in f64.
fn reference_window(
    views: Views<'_>,
    radius: usize,
    rephased: bool,
    (y, x): (usize, usize),
) -> Vec<[f64; 3]> {
    let Views {
        prev, next, u, v, ..
    } = views;
    let (width, height) = (prev.width(), prev.height());
    // The place is rounded to f32 as the fast one is: at a border that decides what counts.
    let place = |y: usize, x: usize| {
        (
            f64::from(x as f32 + u.row(y)[x]),
            f64::from(y as f32 + v.row(y)[x]),
        )
    };
    let warped = |y: usize, x: usize| {
        let (at_x, at_y) = place(y, x);
        let mut value = sample(next, at_x, at_y);
        let pixel = |y: usize, x: usize| prev.row(y)[x];
        if rephased && x >= 2 && x + 2 < width {
            let near = [x - 2, x - 1, x + 1, x + 2].map(|x| pixel(y, x));
            value -= lacks(near, u.row(y)[x]);
        }
        if rephased && y >= 2 && y + 2 < height {
            let near = [y - 2, y - 1, y + 1, y + 2].map(|y| pixel(y, x));
            value -= lacks(near, v.row(y)[x]);
        }
        value
    };
    let both = |y: usize, x: usize| f64::from(prev.row(y)[x]) + warped(y, x);
    let mut window = Vec::new();
    for y in y.saturating_sub(radius)..(y + radius + 1).min(height) {
        for x in x.saturating_sub(radius)..(x + radius + 1).min(width) {
            let (at_x, at_y) = place(y, x);
            if at_x < 0.0 || at_y < 0.0 || at_x > (width - 1) as f64 || at_y > (height - 1) as f64 {
                continue;
            }
            let gx = 0.25 * (both(y, (x + 1).min(width - 1)) - both(y, x.saturating_sub(1)));
            let gy = 0.25 * (both((y + 1).min(height - 1), x) - both(y.saturating_sub(1), x));
            window.push([gx, gy, warped(y, x) - f64::from(prev.row(y)[x])]);
        }
    }
    window
}

/// What a window says, by its definition, in f64: pixels that count, then the means gx gx, gx gy, gy gy, gx d, gy d, d d.
pub(super) fn reference_moments(
    views: Views<'_>,
    Made {
        radius,
        centred,
        rephased,
    }: Made,
    place: (usize, usize),
) -> [f64; 7] {
    let window = reference_window(views, radius, rephased, place);
    let n = window.len().max(1) as f64;
    let mean = |k: usize| {
        if centred {
            window.iter().map(|q| q[k]).sum::<f64>() / n
        } else {
            0.0
        }
    };
    let means = [mean(0), mean(1), mean(2)];
    let cov = |j: usize, k: usize| {
        window
            .iter()
            .map(|q| (q[j] - means[j]) * (q[k] - means[k]))
            .sum::<f64>()
            / n
    };
    [
        window.len() as f64,
        cov(0, 0),
        cov(0, 1),
        cov(1, 1),
        cov(0, 2),
        cov(1, 2),
        cov(2, 2),
    ]
}

/// One step at one pixel by its definition, in f64: (u, v, energy).
pub(super) fn reference_step(
    views: Views<'_>,
    options: &StepOptions,
    (y, x): (usize, usize),
) -> (f64, f64, f64) {
    let [_, xx, xy, yy, xd, yd, dd] = reference_moments(views, options.windows(), (y, x));
    let damping = f64::from(options.damping);
    let (xx, yy) = (xx + damping, yy + damping);
    let det = xx * yy - xy * xy;
    let limit = |step: f64| step.clamp(-f64::from(options.max_step), f64::from(options.max_step));
    (
        f64::from(views.u.row(y)[x]) + limit((xy * yd - yy * xd) / det),
        f64::from(views.v.row(y)[x]) + limit((xy * xd - xx * yd) / det),
        dd,
    )
}

pub(super) fn plane(grid: &PaddedPlane, scale: f32) -> Plane {
    let mut plane = Plane::new(grid.width(), grid.height()).unwrap();
    for y in 0..grid.height() {
        for (to, from) in plane.row_mut(y).iter_mut().zip(grid.row(y)) {
            *to = 100.0 + scale * from;
        }
    }
    plane
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_step_is_the_least_squares_of_its_window(
        width in 2usize..40, height in 2usize..20, seed in any::<u32>(), radius in 1usize..4, centred in any::<bool>()
    ) {
        let (prev, next) = (noise(width, height, seed, 1.0), noise(width, height, seed ^ 0x5555, 1.0));
        let (prev, next) = (plane(&prev, 40.0), plane(&next, 40.0));
        let (u, v) = (noise(width, height, seed ^ 1, 2.5), noise(width, height, seed ^ 2, 2.5));
        let options = StepOptions { radius, centred, damping: 1.0, max_step: 1.0, measures: false };
        for level in SimdLevel::available() {
            let execution = Execution::default().threads(2).level(level);
            let (mut to_u, mut to_v, mut energy) = (PaddedPlane::default(), PaddedPlane::default(), PaddedPlane::default());
            let input = Views { prev: &prev, next: &next, u: &u, v: &v, halved: None, weight: None };
            step::step(input, &options, (&mut to_u, &mut to_v, &mut energy), &execution).unwrap();
            for y in 0..height {
                for x in 0..width {
                    let want = reference_step(input, &options, (y, x));
                    prop_assert!((f64::from(to_u.row(y)[x]) - want.0).abs() < 2e-2, "{} {}", to_u.row(y)[x], want.0);
                    prop_assert!((f64::from(to_v.row(y)[x]) - want.1).abs() < 2e-2);
                    let lost = energy.row(y)[x] == f32::MAX && want.2 == 0.0;
                    prop_assert!(lost || (f64::from(energy.row(y)[x]) - want.2).abs() < 1e-3 * want.2.max(10.0));
                }
            }
        }
    }

    #[test]
    fn a_median_is_the_middle_of_nine(
        width in 1usize..40, height in 1usize..12, seed in any::<u32>(), spacing in 1usize..4
    ) {
        let (u, v) = (noise(width, height, seed, 10.0), noise(width, height, !seed, 10.0));
        let d = spacing as isize;
        for level in SimdLevel::available() {
            let (mut to_u, mut to_v) = (PaddedPlane::default(), PaddedPlane::default());
            let execution = Execution::default().threads(2).level(level);
            median::median([&u, &v], spacing, [&mut to_u, &mut to_v], &execution).unwrap();
            for (from, to) in [(&u, &to_u), (&v, &to_v)] {
                for y in 0..height as isize {
                    for x in 0..width as isize {
                        let mut nine: Vec<_> = [-d, 0, d]
                            .into_iter()
                            .flat_map(|dy| [-d, 0, d].map(|dx| at(from, y + dy, x + dx)))
                            .collect();
                        nine.sort_by(f32::total_cmp);
                        prop_assert_eq!(at(to, y, x), nine[4]);
                    }
                }
            }
        }
    }

    #[test]
    fn a_pixel_takes_the_flow_of_the_best_neighbour(
        width in 1usize..40, height in 1usize..12, seed in any::<u32>(), distance in 1usize..4,
        slopes in any::<[[i8; 2]; 2]>().prop_map(|slopes| slopes.map(|axis| axis.map(|slope| f32::from(slope) / 256.0)))
    ) {
        let (u, v) = (noise(width, height, seed, 9.0), noise(width, height, !seed, 9.0));
        let mut energy = noise(width, height, seed ^ 77, 1.0);
        for y in 0..height {
            energy.padded_mut(y).iter_mut().for_each(|value| *value += 1.0);
        }
        for level in SimdLevel::available() {
            let (mut to_u, mut to_v) = (PaddedPlane::default(), PaddedPlane::default());
            let execution = Execution::default().threads(2).level(level);
            propagate::propagate((&u, &v), &energy, (distance, slopes), 0.9, (&mut to_u, &mut to_v), &execution).unwrap();
            for y in 0..height as isize {
                for x in 0..width as isize {
                    let mut best = (at(&energy, y, x) * 0.9, at(&u, y, x), at(&v, y, x));
                    let d = distance as isize;
                    for (dy, dx) in [-d, 0, d].into_iter().flat_map(|dy| [-d, 0, d].map(|dx| (dy, dx))) {
                        let other = at(&energy, y + dy, x + dx);
                        if (dy, dx) != (0, 0) && other < best.0 {
                            let along = |[x, y]: [f32; 2]| x * dx as f32 + y * dy as f32;
                            let brought = |grid, slopes| at(grid, y + dy, x + dx) - along(slopes);
                            best = (other, brought(&u, slopes[0]), brought(&v, slopes[1]));
                        }
                    }
                    prop_assert_eq!((at(&to_u, y, x), at(&to_v, y, x)), (best.1, best.2));
                }
            }
        }
    }

    #[test]
    fn a_flow_is_doubled_and_interpolated(width in 1usize..40, height in 1usize..12, seed in any::<u32>()) {
        let coarse = noise(width.div_ceil(2), height.div_ceil(2), seed, 3.0);
        let mut fine = PaddedPlane::default();
        upsample::upsample(&coarse, (width, height), 2.0, &mut fine, &Execution::default()).unwrap();
        for y in 0..height as isize {
            for x in 0..width as isize {
                let mean = |y: isize| 0.5 * (at(&coarse, y, x / 2) + at(&coarse, y, (x + 1) / 2));
                let want = mean(y / 2) + mean((y + 1) / 2);
                prop_assert!((at(&fine, y, x) - want).abs() < 1e-5);
            }
        }
    }
}
