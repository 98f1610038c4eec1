//! What is left where nearly all points are lost: a window that finds its like between frames with nothing in common is
//! chance, and stands alone.
//!
//! `docs/explanation/algorithms.md`, section "Consensus, and sequences".

use crate::error::Result;
use crate::track::affine::Warp;
use crate::track::neighbours::Grid;
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::problem::Problem;

/// Of so many points at least, this share must be lost.
const LEAST_POINTS: usize = 64;
const LOST_SHARE: f32 = 0.9;

/// Of so many tracked points around, the point itself among them, so many must move alike, to so many pixels and so many
/// more for each pixel between them.
pub(super) const WITNESSES: usize = 6;
pub(super) const AGREEING: usize = 2;
const AGREEMENT: (f64, f64) = (1.0, 0.05);

/// Whether a point at `offset` that moves by `seen` confirms one that should take it along by `expected`.
pub(super) fn agrees(expected: [f64; 2], seen: [f64; 2], offset: [f64; 2]) -> bool {
    let limit = AGREEMENT.0 + AGREEMENT.1 * offset[0].hypot(offset[1]);
    (expected[0] - seen[0]).hypot(expected[1] - seen[1]) < limit
}

/// Take back what has no witness, where nearly all points are lost.
pub(super) fn reject_isolated(
    problem: &Problem<'_>,
    points: &[[f32; 2]],
    tracks: &mut [TrackedPoint],
    grid: &mut Grid,
) -> Result<()> {
    let (mut lost, mut tracked) = (0usize, 0usize);
    for (track, point) in tracks.iter().zip(points) {
        tracked += usize::from(track.is_valid());
        lost += usize::from(track.status.is_retryable() && problem.holds(*point));
    }
    let judged = lost + tracked;
    if tracked == 0 || judged < LEAST_POINTS || (lost as f32) < LOST_SHARE * judged as f32 {
        return Ok(());
    }
    grid.fill(problem.size(), points, |index| tracks[index].is_valid())?;
    for index in 0..points.len() {
        if !tracks[index].is_valid() {
            continue;
        }
        let (point, track) = (points[index], &tracks[index]);
        let warp = Warp {
            shift: track.displacement(point),
            matrix: track.deformation.map(|row| row.map(f64::from)),
        };
        let confirms = |near: usize| {
            let from = points[near];
            let offset = [from[0] - point[0], from[1] - point[1]].map(f64::from);
            let seen = tracks[near].displacement(from);
            near != index && agrees(warp.displacement(offset), seen, offset)
        };
        let near = grid.nearest::<WITNESSES>(points, point);
        if near.filter(|(_, near)| confirms(*near)).count() < AGREEING {
            // Still a witness to others: whether one is taken back does not hang on the order of the points.
            tracks[index].unexplained = f32::INFINITY;
        }
    }
    for track in tracks {
        if track.unexplained == f32::INFINITY {
            *track = TrackedPoint {
                residual: track.residual,
                forward_backward: track.forward_backward,
                ..TrackedPoint::lost(PointStatus::HighResidual)
            };
        }
    }
    Ok(())
}
