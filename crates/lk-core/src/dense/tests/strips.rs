//! Wide pictures are measured in strips: a strip's sides must not show.

use super::super::confidence::Judged;
use super::super::padded_plane::{self, PAD, PaddedPlane};
use super::super::recipe::REFINE;
use super::super::refine::RoundOptions;
use super::super::step::StepOptions;
use super::super::windows::Views;
use super::super::{half_round, refine, step};
use super::parts::{noise, plane};
use crate::execution::Execution;

/// The first `width` columns.
fn left(grid: &PaddedPlane, width: usize) -> PaddedPlane {
    let mut part = PaddedPlane::default();
    part.resize(width, grid.height()).unwrap();
    for y in 0..grid.height() {
        let row = part.padded_mut(y);
        row[PAD..PAD + width].copy_from_slice(&grid.row(y)[..width]);
        padded_plane::extend(row, width);
    }
    part
}

/// Steps, whole and sparse, and a round, with what they say of their windows.
fn measured(
    frames: [&PaddedPlane; 2],
    flow: [&PaddedPlane; 2],
    half_flow: [&PaddedPlane; 2],
) -> Vec<(PaddedPlane, usize)> {
    let [prev, next] = frames.map(|frame| plane(frame, 40.0));
    let whole = Views {
        prev: &prev,
        next: &next,
        u: flow[0],
        v: flow[1],
        halved: None,
        weight: None,
    };
    let halved = Views {
        u: half_flow[0],
        v: half_flow[1],
        halved: Some(2.0),
        ..whole
    };
    let options = StepOptions {
        radius: 3,
        centred: true,
        damping: 1.0,
        max_step: 1.0,
        measures: false,
    };
    let execution = Execution::default().threads(2);
    let mut results = Vec::new();
    let [mut u, mut v, mut energy] = <[PaddedPlane; 3]>::default();
    let to = (&mut u, &mut v, &mut energy);
    step::step(whole, &options, to, &execution).unwrap();
    results.extend([(u, 1), (v, 1), (energy, 1)]);
    for views in [whole, halved] {
        let [mut u, mut v, mut energy] = <[PaddedPlane; 3]>::default();
        let mut judged = Judged::default();
        let to = (&mut u, &mut v, &mut energy);
        step::sparse_step(views, &options, to, Some(&mut judged), &execution).unwrap();
        results.extend([u, v, energy, judged.fit, judged.misfit].map(|grid| (grid, 2)));
    }
    let [mut u, mut v] = <[PaddedPlane; 2]>::default();
    let mut judged = Judged::default();
    let options = RoundOptions {
        recipe: REFINE,
        sweeps: 3,
        centred: true,
        slopes: [[0.02, 0.01], [-0.03, 0.0]],
    };
    let to = (&mut u, &mut v);
    refine::round(whole, &options, to, Some(&mut judged), &execution).unwrap();
    results.extend([(u, 1), (v, 1), (judged.fit, 2), (judged.misfit, 2)]);
    let [mut u, mut v] = <[PaddedPlane; 2]>::default();
    let mut judged = Judged::default();
    let to = (&mut u, &mut v);
    half_round::half_round(halved, &options, to, Some(&mut judged), &execution).unwrap();
    results.extend([u, v, judged.fit, judged.misfit].map(|grid| (grid, 2)));
    results
}

#[test]
fn a_strip_gives_the_bits_of_a_narrower_picture() {
    // Cut so that the narrower picture is divided elsewhere, or not at all.
    for (width, cut) in [(1300, 900), (2000, 1210), (801, 720)] {
        let height = 24;
        let (prev, next) = (noise(width, height, 1, 1.0), noise(width, height, 2, 1.0));
        let (u, v) = (noise(width, height, 3, 1.5), noise(width, height, 4, 1.5));
        let (half_width, half_height) = (width.div_ceil(2), height / 2);
        let (half_u, half_v) = (
            noise(half_width, half_height, 5, 0.7),
            noise(half_width, half_height, 6, 0.7),
        );
        let wide = measured([&prev, &next], [&u, &v], [&half_u, &half_v]);
        let half = cut / 2;
        let narrow = measured(
            [&left(&prev, cut), &left(&next, cut)],
            [&left(&u, cut), &left(&v, cut)],
            [&left(&half_u, half), &left(&half_v, half)],
        );
        for (place, ((wide, halving), (narrow, _))) in wide.iter().zip(&narrow).enumerate() {
            for y in 0..narrow.height() {
                for x in 0..(cut - 20) / halving {
                    let (want, got) = (narrow.row(y)[x], wide.row(y)[x]);
                    assert!(
                        want.to_bits() == got.to_bits(),
                        "{width} {place}: {x} {y}: {want} {got}"
                    );
                }
            }
        }
    }
}
