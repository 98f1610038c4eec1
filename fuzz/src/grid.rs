//! `displacement_grid`.

use arbitrary::Arbitrary;
use lk_core::{Execution, Grid, GridNode, GridOptions, GridShape, Masks, displacement_grid};

use crate::frames::{Frames, Grey, covered, mask};
use crate::shift::light;
use crate::{by_depth, others, plain};

/// Frames and options.
#[derive(Debug, Arbitrary)]
pub struct Case {
    frames: Frames,
    masks: [Option<u16>; 2],
    window: u8,
    step: u8,
    shape: u8,
    robust: bool,
    guessed: Option<(i8, i8)>,
    illumination: u8,
    max_displacement: Option<f32>,
}

/// A node further from the truth than this is a lie if it is called measured.
const FARTHEST_PX: f64 = 1.0;

/// Panic if something is wrong with this case.
pub fn check(case: &Case) {
    by_depth!(case.frames.depth, check_as(case));
}

fn check_as<T: Grey>(case: &Case) {
    let (prev, next) = case.frames.pair::<T>();
    let (height, width) = case.frames.size();
    let [mask, next_mask] = case.masks.map(|seed| mask((height, width), seed));
    let masks = Masks::default()
        .prev(mask.as_ref().map(|mask| mask.view()))
        .next(next_mask.as_ref().map(|mask| mask.view()));
    let shapes = [
        GridShape::Affine,
        GridShape::Quadratic,
        GridShape::Translation,
    ];
    let options = |execution: Execution| {
        GridOptions::default()
            .window_size(usize::from(case.window % 60))
            .step(usize::from(case.step % 40))
            .shape(shapes[usize::from(case.shape) % 3])
            .robust(case.robust)
            .illumination(light(case.illumination))
            .max_displacement(case.max_displacement)
            .execution(execution)
    };
    let (columns, rows) = options(plain()).nodes(width, height);
    let initial = case
        .guessed
        .map(|(u, v)| vec![[f32::from(u) / 16.0, f32::from(v) / 16.0]; columns * rows]);
    let run = |execution| {
        let (prev, next) = (prev.view(), next.view());
        displacement_grid(prev, next, initial.as_deref(), masks, &options(execution))
    };
    let allowed = options(plain()).validate().is_ok();
    let grid = run(plain());
    assert_eq!(grid.is_ok(), allowed, "{grid:?}");
    let Ok(grid) = grid else { return };
    assert_eq!((grid.columns, grid.rows), (columns, rows));
    assert_eq!(grid.nodes.len(), columns * rows);
    grid.nodes.iter().for_each(meaning);
    for execution in others() {
        assert_eq!(bits(&run(execution).unwrap()), bits(&grid));
    }
    let (rows_prev, rows_next) = (prev.rows(), next.rows());
    let over = |prev: &ndarray::Array2<T>, next: &ndarray::Array2<T>| {
        let options = options(plain());
        let found = displacement_grid(
            prev.view(),
            next.view(),
            initial.as_deref(),
            masks,
            &options,
        );
        bits(&found.unwrap())
    };
    assert_eq!(over(&rows_prev, &rows_next), bits(&grid));
    for seed in [1, 2] {
        let prev = covered(&rows_prev, mask.as_ref(), seed);
        let next = covered(&rows_next, next_mask.as_ref(), seed + 7);
        assert_eq!(over(&prev, &next), bits(&grid), "masked pixels count");
    }
    let valid = || grid.nodes.iter().filter(|node| node.is_valid());
    if let Some(limit) = case.max_displacement {
        for node in valid() {
            let longest = node
                .displacement
                .map(f32::abs)
                .into_iter()
                .fold(0.0, f32::max);
            assert!(longest <= limit * (1.0 + 1e-6), "{node:?}");
        }
    }
    if let Some([u, v]) = case.frames.truth()
        && light(case.illumination) == lk_core::Illumination::GainOffset
    {
        for node in valid() {
            let [found_u, found_v] = node.displacement.map(f64::from);
            assert!(
                (found_u - u).hypot(found_v - v) < FARTHEST_PX,
                "{node:?}, true ({u}, {v})"
            );
        }
    }
}

/// A node is whole, or its variances are infinite.
fn meaning(node: &GridNode) {
    let variances = [node.covariance[0][0], node.covariance[1][1]];
    if node.is_valid() {
        let numbers = [node.residual, node.correlation, node.gain, node.offset];
        let all = node.displacement.iter().chain(&numbers).chain(&variances);
        assert!(all.copied().all(f32::is_finite), "{node:?}");
        let [[xx, xy, ..], [yx, yy, ..], ..] = node.covariance;
        assert!(xy == yx && xx >= 0.0 && yy >= 0.0, "{node:?}");
        assert!(xx * yy >= xy * xy * (1.0 - 1e-4), "{node:?}");
    } else {
        assert_eq!(variances, [f32::INFINITY; 2], "{node:?}");
    }
}

fn bits(grid: &Grid) -> Vec<u32> {
    let of = |node: &GridNode| {
        let numbers = [node.residual, node.correlation, node.gain, node.offset];
        let all = node.displacement.into_iter().chain(numbers);
        let all = all.chain(node.gradient.into_iter().flatten());
        let all = all.chain(node.covariance.into_iter().flatten());
        all.map(f32::to_bits)
            .chain([u32::from(node.status as u8)])
            .collect::<Vec<_>>()
    };
    grid.nodes.iter().flat_map(of).collect()
}
