//! Which points a displacement alone does not explain: those that are lost, those whose window fits badly, and those
//! that move unlike their neighbours.

use crate::error::Result;
use crate::memory::reserve;
use crate::track::neighbours::Grid;
use crate::track::options::POINTS;
use crate::track::options::{Deformation, TrackedPoint};
use crate::track::problem::Problem;

/// Share of the points that must be open, and least number of them, for a closer look.
const OPEN_SHARE: f32 = 0.1;
const OPEN_POINTS: usize = 8;

/// Share of a window's variance left by a displacement from which the window may be deformed.
const UNEXPLAINED: f32 = 0.04;

/// Difference of displacements from which two points move apart: so many pixels for each between them, and so many
/// deviations of what was measured.
const SLOPE: f32 = 0.015;
const DEVIATIONS: f32 = 3.0;

/// Neighbours looked at, how far away at most, in windows, and how many must move apart.
const NEIGHBOURS: usize = 4;
const REACH: f32 = 3.0;
const MIN_APART: usize = 2;

/// One point of so many is asked first whether any move apart at all.
const SAMPLE: usize = 8;

/// List the open points in `open`; whether there are enough of them.
pub(in crate::track) fn candidates(
    problem: &Problem<'_>,
    points: &[[f32; 2]],
    tracks: &[TrackedPoint],
    grid: &mut Grid,
    open: &mut Vec<u32>,
) -> Result<bool> {
    open.clear();
    if problem.options.deformation == Deformation::None {
        return Ok(false);
    }
    let is_open = |index: usize| {
        let track = &tracks[index];
        if track.is_valid() {
            track.unexplained > UNEXPLAINED
        } else {
            track.status.is_retryable() && problem.holds(points[index])
        }
    };
    let count = |step: usize, is_open: &dyn Fn(usize) -> bool| {
        let (mut open, mut judged) = (0usize, 0usize);
        for index in (0..points.len()).step_by(step) {
            let is_open = is_open(index);
            open += usize::from(is_open);
            judged += usize::from(is_open || tracks[index].is_valid());
        }
        (open, judged)
    };
    let enough = |step: usize, (open, judged): (usize, usize)| {
        step * open >= OPEN_POINTS && open as f32 >= OPEN_SHARE * judged as f32
    };
    if problem.options.deformation == Deformation::Affine {
        grid.fill(problem.size(), points, |index| tracks[index].is_valid())?;
        reserve(POINTS, open, points.len())?;
        let there = |index: &usize| tracks[*index].is_valid() || is_open(*index);
        open.extend((0..points.len()).filter(there).map(|index| index as u32));
        return Ok(!open.is_empty());
    }
    if points.len() < OPEN_POINTS {
        return Ok(false);
    }
    let plain = enough(1, count(1, &is_open));
    grid.fill(problem.size(), points, |index| tracks[index].is_valid())?;
    let reach = REACH * problem.options.window_side() as f32;
    let apart = |index: usize| {
        is_open(index)
            || tracks[index].is_valid() && moves_apart(points, tracks, grid, reach, index)
    };
    if !plain && !enough(SAMPLE, count(SAMPLE, &apart)) {
        return Ok(false);
    }
    reserve(POINTS, open, points.len())?;
    open.extend(
        (0..points.len())
            .filter(|index| apart(*index))
            .map(|index| index as u32),
    );
    Ok(enough(1, (open.len(), count(1, &apart).1)))
}

/// Whether the neighbours of a tracked point move otherwise than it does.
fn moves_apart(
    points: &[[f32; 2]],
    tracks: &[TrackedPoint],
    grid: &Grid,
    reach: f32,
    index: usize,
) -> bool {
    let own = tracks[index].displacement(points[index]);
    let deviation = |track: &TrackedPoint| track.covariance[0] + track.covariance[2];
    let apart = grid
        .nearest::<NEIGHBOURS>(points, points[index])
        .filter(|(distance, near)| {
            let there = tracks[*near].displacement(points[*near]);
            let difference = (there[0] - own[0]).hypot(there[1] - own[1]) as f32;
            let doubt = (deviation(&tracks[index]) + deviation(&tracks[*near])).sqrt();
            let distance = distance.sqrt();
            *near != index
                && distance < reach
                && difference > (SLOPE * distance).max(DEVIATIONS * doubt)
        });
    apart.count() >= MIN_APART
}
