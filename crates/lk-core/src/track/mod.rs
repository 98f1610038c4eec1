//! Many points: pyramidal Lucas-Kanade with the lighting in the least squares, and a judgement of every answer.
//!
//! B. Lucas and T. Kanade, "An iterative image registration technique with an application to stereo vision",
//! IJCAI 1981; J.-Y. Bouguet, "Pyramidal implementation of the affine Lucas Kanade feature tracker", 2001; the lighting
//! is taken out of the template's gradients once, after G. Hager and P. Belhumeur, "Efficient region tracking with
//! parametric models of geometry and illumination", PAMI 1998.
//!
//! `docs/algorithms.md`, section "Points: track_points".

mod affine;
mod consensus;
mod neighbours;
mod noise;
mod normal;
mod opencv_compat;
mod options;
mod patch;
mod repetition;
mod retry;
mod snapshot;
mod solve;
mod stream;
#[cfg(test)]
mod tests;
mod verify;

use std::cell::Cell;

use ndarray::ArrayView2;

pub use opencv_compat::{PyrLkOptions, PyrLkPoint, track_pyr_lk};
pub use options::{Deformation, PointStatus, TrackOptions, TrackedPoint};
pub use snapshot::TrackerSnapshot;
pub use stream::{PointTracker, StreamPoint};

use crate::error::{Error, Result};
use crate::frame::{Frame, Pixel, expect_size};
use crate::memory::resize;
use crate::parallel::{RowsMut, both, for_each_band, within_pool};
use crate::pyramid::Pyramid;
use crate::support::Masks;
use consensus::reject_isolated;
use options::POINTS;
use retry::Memory;
use solve::{Problem, Workspace};

/// Points that one thread takes at least: some 50 us of work.
const MIN_POINTS: usize = 16;

/// Where each of `points`, (x, y) in `prev`, is in `next`.
///
/// `initial` holds a first guess of each position in `next`. A pixel is used where it and its target count: inside of the
/// frame, kept by its mask, finite, and not clipped.
///
/// # Errors
///
/// [`Error::Shape`] if the frames, `initial` or `masks` do not fit together; those of [`TrackOptions::validate`] and
/// of the execution.
pub fn track_points<T: Pixel>(
    prev: Frame<'_, T>,
    next: Frame<'_, T>,
    points: &[[f32; 2]],
    initial: Option<&[[f32; 2]]>,
    masks: Masks<'_>,
    options: &TrackOptions,
) -> Result<Vec<TrackedPoint>> {
    options.validate()?;
    let (height, width) = prev.dim();
    expect_size("next", next.dim(), "prev", prev.dim())?;
    masks.expect_size(prev.dim())?;
    let mut kept = KEPT.take();
    let mut tracks = Vec::new();
    let guesses = Guesses { initial, masks };
    let (levels, memory) = (options.levels_for(width, height), &mut kept);
    within_pool(&options.execution, || {
        let Kept {
            prev: before,
            next: after,
            memory,
        } = memory;
        let (first, second) = both(
            &options.execution,
            || before.rebuild_masked(prev, masks.of_prev(), levels, &options.execution),
            || after.rebuild_masked(next, masks.of_next(), levels, &options.execution),
        )?;
        first.and(second)?;
        track_keeping(before, after, points, guesses, options, memory, &mut tracks)
    })?;
    if width * height <= LARGEST_KEPT {
        KEPT.set(kept);
    }
    Ok(tracks)
}

/// Frames of more pixels than this do not leave their memory with the thread: the pyramids of one this size take
/// 22 megabytes.
const LARGEST_KEPT: usize = 1 << 21;

/// What a thread keeps from call to call: fresh memory for two pyramids costs as much as building them.
#[derive(Debug, Default)]
struct Kept {
    prev: Pyramid,
    next: Pyramid,
    memory: Memory,
}

thread_local! {
    static KEPT: Cell<Kept> = Cell::default();
}

/// The same on pyramids, which a sequence builds once a frame; `tracks` is replaced. Which pixels count is what
/// [`Pyramid::masked`] found.
///
/// # Errors
///
/// Those of [`track_points`].
pub fn track_pyramids(
    prev: &Pyramid,
    next: &Pyramid,
    points: &[[f32; 2]],
    initial: Option<&[[f32; 2]]>,
    options: &TrackOptions,
    tracks: &mut Vec<TrackedPoint>,
) -> Result<()> {
    let masks = Masks::default();
    let guesses = Guesses { initial, masks };
    track_keeping(
        prev,
        next,
        points,
        guesses,
        options,
        &mut Memory::default(),
        tracks,
    )
}

/// What a caller may know of the points beforehand.
#[derive(Debug, Clone, Copy)]
struct Guesses<'a, 'm> {
    initial: Option<&'a [[f32; 2]]>,
    /// Where points may be, and go to.
    masks: Masks<'m>,
}

/// [`track_pyramids`] with memory that is kept.
fn track_keeping(
    prev: &Pyramid,
    next: &Pyramid,
    points: &[[f32; 2]],
    Guesses { initial, masks }: Guesses<'_, '_>,
    options: &TrackOptions,
    memory: &mut Memory,
    tracks: &mut Vec<TrackedPoint>,
) -> Result<()> {
    options.validate()?;
    let (prev_support, next_support) = (prev.support(), next.support());
    let (prev, next) = (prev.levels(), next.levels());
    let size = |levels: &[crate::frame::Plane]| {
        levels
            .first()
            .map_or((0, 0), |plane| (plane.height(), plane.width()))
    };
    let (height, width) = size(prev);
    expect_size("next", size(next), "prev", (height, width))?;
    if let Some(initial) = initial
        && initial.len() != points.len()
    {
        return Err(Error::shape(
            "initial",
            format!("{} points", initial.len()),
            format!("one for each of the {} points", points.len()),
        ));
    }
    masks.expect_size((height, width))?;
    tracks.clear();
    let lost = TrackedPoint::lost(PointStatus::OutOfFrame);
    resize(POINTS, tracks, points.len(), lost)?;
    if width == 0 || height == 0 {
        return Ok(());
    }
    let problem = Problem {
        prev,
        next,
        prev_support,
        next_support,
        masked: masks.of_next().is_some(),
        options,
        level: options.execution.simd_level(),
    };
    for_each_band(
        &options.execution,
        points.len(),
        MIN_POINTS,
        RowsMut::new(tracks, 1),
        |range, part| {
            Workspace::with(|workspace| {
                for (track, index) in part.data.iter_mut().zip(range) {
                    let point = points[index];
                    if masks.of_prev().is_some_and(|mask| masked(mask, point)) {
                        *track = TrackedPoint::lost(PointStatus::Masked);
                        continue;
                    }
                    let start = initial.map_or([0.0; 2], |initial| {
                        [initial[index][0] - point[0], initial[index][1] - point[1]]
                    });
                    *track = problem.track(point, start, workspace);
                }
            });
        },
    )?;
    memory.retry(&problem, points, tracks)?;
    memory.deformed.find(&problem, points, tracks)?;
    if let Some(mask) = masks.of_next() {
        for track in tracks.iter_mut() {
            if track.is_valid() && masked(mask, track.position) {
                *track = TrackedPoint::lost(PointStatus::Masked);
            }
        }
    }
    memory
        .repetition
        .reject_ambiguous(&problem, points, tracks, &mut memory.grid)?;
    reject_isolated(&problem, points, tracks, &mut memory.grid)
}

/// Whether the pixel that `point` is in is excluded.
fn masked(mask: ArrayView2<'_, bool>, point: [f32; 2]) -> bool {
    let [x, y] = point.map(f32::round);
    x >= 0.0 && y >= 0.0 && mask.get((y as usize, x as usize)) == Some(&false)
}
