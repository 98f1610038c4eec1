//! A round of refinement, sparse steps and the ways of sampling, against plain references.

use proptest::prelude::*;

use super::super::confidence::{self, Judged};
use super::super::padded_plane::PaddedPlane;
use super::super::recipe::REFINE;
use super::super::refine::{RefineRecipe, RoundOptions};
use super::super::step::StepOptions;
use super::super::windows::{Made, Views};
use super::super::{half_round, refine, step, upsample};
use super::parts::{at, noise, plane, reference_moments, reference_step};
use crate::Execution;
use crate::simd::SimdLevel;

/// What a round is tested with.
fn round_options(radius: usize, sweeps: usize, slope: f32) -> RoundOptions {
    RoundOptions {
        recipe: RefineRecipe {
            radius,
            relaxation: 1.6,
            ..REFINE
        },
        sweeps,
        centred: true,
        slopes: [[slope, -0.5 * slope], [2.0 * slope, slope]],
    }
}

/// The equations of a round, in f64: of each pixel half the weight of smoothness, and the matrix of the data (xx, xy, yy) with
/// its right side.
struct System {
    smooth: Vec<f64>,
    data: Vec<[f64; 5]>,
}

/// The flow that a round at one pixel in `apart` x `apart` begins with, and its equations by their definition; `scale` is
/// what the flow is multiplied by.
fn reference_system(
    views: Views<'_>,
    [u, v]: [&PaddedPlane; 2],
    options: &RoundOptions,
    (apart, scale): (usize, f64),
) -> (Vec<[f64; 2]>, System) {
    let recipe = &options.recipe;
    let (width, height) = (u.width(), u.height());
    let square = |value: f32| f64::from(value) * f64::from(value);
    let step = apart as f64;
    let slopes = options.slopes.map(|axis| axis.map(f64::from));
    let mut flow = Vec::new();
    let mut system = System {
        smooth: Vec::new(),
        data: Vec::new(),
    };
    for y in 0..height {
        for x in 0..width {
            let (own_u, own_v) = (f64::from(u.row(y)[x]), f64::from(v.row(y)[x]));
            let (own_u, own_v) = (scale * own_u, scale * own_v);
            flow.push([own_u, own_v]);
            let place = (apart * y, apart * x);
            let [_, xx, xy, yy, xd, yd, dd] = reference_moments(views, options.windows(), place);
            let (row, column) = (y as isize, x as isize);
            let rough: f64 = [u, v]
                .iter()
                .zip(slopes)
                .map(|(grid, [along_x, along_y])| {
                    let value = |dy, dx| scale * f64::from(at(grid, row + dy, column + dx));
                    let across = 0.5 * (value(0, 1) - value(0, -1)) / step - along_x;
                    let down = 0.5 * (value(1, 0) - value(-1, 0)) / step - along_y;
                    across * across + down * down
                })
                .sum();
            let strength =
                0.5 * f64::from(recipe.alpha) * square(recipe.edge_scale) / (step * step);
            let spread = (rough + square(recipe.smooth_epsilon)).sqrt();
            system
                .smooth
                .push(strength / ((square(recipe.edge_scale) + xx + yy) * spread));
            let share = 1.0 / (xx + yy + f64::from(recipe.trace_floor));
            let data = share / (dd.max(0.0) * share + square(recipe.data_epsilon));
            system.data.push([
                xx * data,
                xy * data,
                yy * data,
                (xx * own_u + xy * own_v - xd) * data,
                (xy * own_u + yy * own_v - yd) * data,
            ]);
        }
    }
    (flow, system)
}

/// One round at one pixel in `apart` x `apart` by its definition, in f64; `scale` is what the flow is multiplied by, `flow`
/// that of all pixels.
fn reference_round(
    views: Views<'_>,
    grids: [&PaddedPlane; 2],
    options: &RoundOptions,
    (apart, scale): (usize, f64),
) -> Vec<[f64; 2]> {
    let (width, height) = (grids[0].width(), grids[0].height());
    let index = |y: usize, x: usize| y * width + x;
    let step = apart as f64;
    let slopes = options.slopes.map(|axis| axis.map(f64::from));
    let (mut flow, System { smooth, data }) =
        reference_system(views, grids, options, (apart, scale));
    // The neighbour's place, mirrored, and which way it lies.
    let beside = |place: usize, side: isize, size: usize| {
        let moved = place as isize + side;
        if moved < 0 {
            (1, 2.0)
        } else if moved == size as isize {
            (size - 2, -2.0)
        } else {
            (moved as usize, 0.0)
        }
    };
    for half in 0..2 * options.sweeps {
        for y in 0..height {
            for x in 0..width {
                if (x + y) % 2 != half % 2 {
                    continue;
                }
                let here = index(y, x);
                let [a, b, c, bu, bv] = data[here];
                let (mut joined, mut right) = (0.0, [bu, bv]);
                for (along, side) in [(0, -1), (0, 1), (1, -1), (1, 1)] {
                    let (near, mirrored) = if along == 0 {
                        let (column, mirrored) = beside(x, side, width);
                        (index(y, column), mirrored)
                    } else {
                        let (row, mirrored) = beside(y, side, height);
                        (index(row, x), mirrored)
                    };
                    let joint = smooth[here] + smooth[near];
                    joined += joint;
                    for axis in 0..2 {
                        // What a mirrored place has on the slope, and what this one should have beside it.
                        let slope = step * slopes[axis][along];
                        let expected = flow[near][axis] - slope * mirrored - slope * side as f64;
                        right[axis] += joint * expected;
                    }
                }
                let (a, c) = (a + joined, c + joined);
                let det = a * c - b * b;
                let solved = [
                    (c * right[0] - b * right[1]) / det,
                    (a * right[1] - b * right[0]) / det,
                ];
                let relaxation = f64::from(options.recipe.relaxation);
                for axis in 0..2 {
                    let now = flow[here][axis];
                    flow[here][axis] = now + relaxation * (solved[axis] - now);
                }
            }
        }
    }
    flow
}

/// A flow that is even but for a slope and `rough` noise: sixteen places beside each other, nearly so, or anywhere.
fn gentle(width: usize, height: usize, seed: u32, slope: f32, rough: f32) -> PaddedPlane {
    let mut grid = noise(width, height, seed, rough);
    let start = (seed % 7) as f32 - 3.0;
    for y in 0..height {
        let row = grid.padded_mut(y);
        for x in 0..width {
            row[super::super::padded_plane::PAD + x] += start + slope * (x + y) as f32;
        }
        super::super::padded_plane::extend(row, width);
    }
    grid
}

/// Whether one window holds something to measure, how well it fits after a step, both negative where something is amiss, and
/// its mean squared difference, in f64.
fn reference_judgement(
    views: Views<'_>,
    made: Made,
    place: (usize, usize),
    [du, dv]: [f64; 2],
) -> [f64; 3] {
    let [n, xx, xy, yy, xd, yd, dd] = reference_moments(views, made, place);
    let texture = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
    let after =
        dd + 2.0 * (du * xd + dv * yd) + du * (xx * du + xy * dv) + dv * (xy * du + yy * dv);
    let size = 2 * made.radius + 1;
    let explained = (16.0 + texture).min(3.0 * texture) - after;
    let enough = n - 0.5 * (size * size) as f64;
    let least = f64::from(confidence::least_texture(size));
    [(texture - least).min(enough), explained, after.max(0.0)]
}

/// Whether `got` says so, but for rounding.
fn judged_so(got: f32, [told, fit]: [f64; 2], tolerance: f64) -> bool {
    let nothing = got == confidence::NOTHING;
    let close = (f64::from(got) - fit).abs() < tolerance * (1.0 + fit.abs());
    // At the limit either is right.
    (told < tolerance && nothing) || (told > -tolerance && close)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_last_step_or_round_judges_its_windows(
        width in 2usize..70, height in 2usize..40, seed in any::<u32>(), radius in 1usize..4, threads in 1usize..4,
        contrast in 1usize..4
    ) {
        let (prev, next) = (noise(width, height, seed, 1.0), noise(width, height, seed ^ 0x5555, 1.0));
        let contrast = [2.0, 10.0, 40.0][contrast - 1];
        let (prev, next) = (plane(&prev, contrast), plane(&next, contrast));
        let (u, v) = (noise(width, height, seed ^ 1, 1.5), noise(width, height, seed ^ 2, 1.5));
        let views = Views { prev: &prev, next: &next, u: &u, v: &v, halved: None, weight: None };
        let options = StepOptions { radius, centred: true, damping: 1.0, max_step: 1.0, measures: false };
        let round = round_options(radius, 3, 0.0);
        for level in SimdLevel::available() {
            let execution = Execution::default().threads(threads).level(level);
            let [mut to_u, mut to_v, mut energy] = <[PaddedPlane; 3]>::default();
            let [mut of_step, mut of_round] = <[Judged; 2]>::default();
            let to = (&mut to_u, &mut to_v, &mut energy);
            step::sparse_step(views, &options, to, Some(&mut of_step), &execution).unwrap();
            let steps = |y: usize, x: usize| {
                [(&to_u, &u), (&to_v, &v)].map(|(to, from)| f64::from(to.row(y)[x]) - f64::from(from.row(2 * y)[2 * x]))
            };
            let (mut round_u, mut round_v) = (PaddedPlane::default(), PaddedPlane::default());
            let to = (&mut round_u, &mut round_v);
            refine::round(views, &round, to, Some(&mut of_round), &execution).unwrap();
            for y in 0..height.div_ceil(2) {
                for x in 0..width.div_ceil(2) {
                    let judgements = [
                        (&of_step, options.windows(), steps(y, x)),
                        (&of_round, round.windows(), [0.0; 2]),
                    ];
                    for (judged, made, step) in judgements {
                        let [told, fit, energy] = reference_judgement(views, made, (2 * y, 2 * x), step);
                        let (got, misfit) = (judged.fit.row(y)[x], f64::from(judged.misfit.row(y)[x]));
                        prop_assert!(judged_so(got, [told, fit], 2e-3), "{x} {y}: {got} {told} {fit}");
                        prop_assert!((misfit * misfit - energy).abs() < 2e-3 * (1.0 + energy), "{x} {y}: {misfit} {energy}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_round_relaxes_what_its_definition_says(
        width in 2usize..70, height in 2usize..40, seed in any::<u32>(), radius in 1usize..4, sweeps in 1usize..5,
        centred in any::<bool>(), sloping in any::<bool>(), threads in 1usize..4
    ) {
        let (prev, next) = (noise(width, height, seed, 1.0), noise(width, height, seed ^ 0x5555, 1.0));
        let (prev, next) = (plane(&prev, 40.0), plane(&next, 40.0));
        let (u, v) = (noise(width, height, seed ^ 1, 1.5), noise(width, height, seed ^ 2, 1.5));
        let views = Views { prev: &prev, next: &next, u: &u, v: &v, halved: None, weight: None };
        let slope = if sloping { 0.1 } else { 0.0 };
        let options = RoundOptions { centred, ..round_options(radius, sweeps, slope) };
        let want = reference_round(views, [&u, &v], &options, (1, 1.0));
        for level in SimdLevel::available() {
            let (mut to_u, mut to_v) = (PaddedPlane::default(), PaddedPlane::default());
            let execution = Execution::default().threads(threads).level(level);
            refine::round(views, &options, (&mut to_u, &mut to_v), None, &execution).unwrap();
            for y in 0..height {
                for x in 0..width {
                    let want = want[y * width + x];
                    prop_assert!((f64::from(to_u.row(y)[x]) - want[0]).abs() < 5e-3, "{} {}", to_u.row(y)[x], want[0]);
                    prop_assert!((f64::from(to_v.row(y)[x]) - want[1]).abs() < 5e-3);
                }
            }
        }
    }

    #[test]
    fn a_half_round_relaxes_what_its_definition_says(
        width in 3usize..150, height in 3usize..40, seed in any::<u32>(), radius in 1usize..4, sweeps in 1usize..5,
        sloping in any::<bool>(), threads in 1usize..4
    ) {
        let (prev, next) = (noise(width, height, seed, 1.0), noise(width, height, seed ^ 0x5555, 1.0));
        let (prev, next) = (plane(&prev, 40.0), plane(&next, 40.0));
        let size = (width.div_ceil(2), height.div_ceil(2));
        let (u, v) = (noise(size.0, size.1, seed ^ 1, 0.7), noise(size.0, size.1, seed ^ 2, 0.7));
        let execution = Execution::default();
        let [mut whole_u, mut whole_v] = <[PaddedPlane; 2]>::default();
        upsample::upsample(&u, (width, height), 2.0, &mut whole_u, &execution).unwrap();
        upsample::upsample(&v, (width, height), 2.0, &mut whole_v, &execution).unwrap();
        let whole = Views { prev: &prev, next: &next, u: &whole_u, v: &whole_v, halved: None, weight: None };
        let halved = Views { u: &u, v: &v, halved: Some(2.0), ..whole };
        let options = round_options(radius, sweeps, if sloping { 0.1 } else { 0.0 });
        let want = reference_round(whole, [&u, &v], &options, (2, 2.0));
        for level in SimdLevel::available() {
            let (mut to_u, mut to_v, mut judged) = (PaddedPlane::default(), PaddedPlane::default(), Judged::default());
            let execution = Execution::default().threads(threads).level(level);
            half_round::half_round(halved, &options, (&mut to_u, &mut to_v), Some(&mut judged), &execution).unwrap();
            for y in 0..size.1 {
                for x in 0..size.0 {
                    let want = want[y * size.0 + x];
                    prop_assert!((f64::from(to_u.row(y)[x]) - want[0]).abs() < 5e-3, "{} {}", to_u.row(y)[x], want[0]);
                    prop_assert!((f64::from(to_v.row(y)[x]) - want[1]).abs() < 5e-3);
                    let [told, fit, energy] = reference_judgement(whole, options.windows(), (2 * y, 2 * x), [0.0; 2]);
                    prop_assert!(judged_so(judged.fit.row(y)[x], [told, fit], 2e-2));
                    prop_assert!((f64::from(judged.misfit.row(y)[x]) - energy.sqrt()).abs() < 2e-2);
                }
            }
        }
    }

    #[test]
    fn a_sparse_step_is_the_step_at_even_pixels(
        width in 2usize..70, height in 2usize..30, seed in any::<u32>(), radius in 1usize..4, halved in any::<bool>()
    ) {
        let (prev, next) = (noise(width, height, seed, 1.0), noise(width, height, seed ^ 0x5555, 1.0));
        let (prev, next) = (plane(&prev, 40.0), plane(&next, 40.0));
        let size = if halved { (width.div_ceil(2), height.div_ceil(2)) } else { (width, height) };
        let (u, v) = (noise(size.0, size.1, seed ^ 1, 1.5), noise(size.0, size.1, seed ^ 2, 1.5));
        let (mut whole_u, mut whole_v) = (PaddedPlane::default(), PaddedPlane::default());
        if halved {
            let execution = Execution::default();
            upsample::upsample(&u, (width, height), 2.0, &mut whole_u, &execution).unwrap();
            upsample::upsample(&v, (width, height), 2.0, &mut whole_v, &execution).unwrap();
        }
        let options = StepOptions { radius, centred: true, damping: 1.0, max_step: 1.0, measures: false };
        let plain = Views { prev: &prev, next: &next, u: &u, v: &v, halved: None, weight: None };
        let (whole, sparse) = if halved {
            (Views { u: &whole_u, v: &whole_v, ..plain }, Views { halved: Some(2.0), ..plain })
        } else {
            (plain, plain)
        };
        for level in SimdLevel::available() {
            let execution = Execution::default().threads(2).level(level);
            let [mut a, mut b, mut c, mut d, mut e, mut f] = <[PaddedPlane; 6]>::default();
            step::step(whole, &options, (&mut a, &mut b, &mut c), &execution).unwrap();
            step::sparse_step(sparse, &options, (&mut d, &mut e, &mut f), None, &execution).unwrap();
            prop_assert_eq!((d.width(), d.height()), (width.div_ceil(2), height.div_ceil(2)));
            for y in 0..d.height() {
                for x in 0..d.width() {
                    for (whole, sparse) in [(&a, &d), (&b, &e), (&c, &f)] {
                        let (want, got) = (whole.row(2 * y)[2 * x], sparse.row(y)[x]);
                        prop_assert!(want.to_bits() == got.to_bits(), "{x} {y}: {want} {got}");
                    }
                }
            }
        }
    }

    #[test]
    fn every_way_of_sampling_gives_the_least_squares(
        width in 20usize..90, height in 4usize..20, seed in any::<u32>(), slope in 0usize..3, rough in 0usize..3
    ) {
        let (prev, next) = (noise(width, height, seed, 1.0), noise(width, height, seed ^ 0x5555, 1.0));
        let (prev, next) = (plane(&prev, 40.0), plane(&next, 40.0));
        let (slope, rough) = ([0.0, 0.01, 0.06][slope], [0.0, 0.05, 0.6][rough]);
        let u = gentle(width, height, seed ^ 1, slope, rough);
        let v = gentle(width, height, seed ^ 2, -slope, rough);
        let options = StepOptions { radius: 2, centred: true, damping: 1.0, max_step: 1.0, measures: false };
        let views = Views { prev: &prev, next: &next, u: &u, v: &v, halved: None, weight: None };
        for level in SimdLevel::available() {
            let execution = Execution::default().threads(1).level(level);
            let [mut to_u, mut to_v, mut energy] = <[PaddedPlane; 3]>::default();
            step::step(views, &options, (&mut to_u, &mut to_v, &mut energy), &execution).unwrap();
            for y in 0..height {
                for x in 0..width {
                    let want = reference_step(views, &options, (y, x));
                    prop_assert!((f64::from(to_u.row(y)[x]) - want.0).abs() < 2e-2, "{} {}", to_u.row(y)[x], want.0);
                    prop_assert!((f64::from(to_v.row(y)[x]) - want.1).abs() < 2e-2);
                }
            }
        }
    }
}
