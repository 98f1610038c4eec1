//! Many points: pyramidal Lucas-Kanade with the lighting in the least squares, and a judgement of every answer.
//!
//! B. Lucas and T. Kanade, "An iterative image registration technique with an application to stereo vision",
//! IJCAI 1981; J.-Y. Bouguet, "Pyramidal implementation of the affine Lucas Kanade feature tracker", 2001; the lighting
//! is taken out of the template's gradients once, after G. Hager and P. Belhumeur, "Efficient region tracking with
//! parametric models of geometry and illumination", PAMI 1998.
//!
//! `docs/explanation/algorithms.md`, section "Points: track_points".

mod affine;
mod consensus;
mod neighbours;
mod noise;
mod normal;
mod opencv_compat;
mod options;
mod patch;
mod problem;
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
use problem::Problem;

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
///
/// ```
/// use lk_core::ndarray::Array2;
/// use lk_core::{CornerOptions, Masks, PointStatus, TrackOptions, detect_corners, track_points};
///
/// let scene = |x: f32, y: f32| {
///     (0.4 * x + 0.1 * y).sin() * (0.3 * y).cos() + (0.0016 * x * y + 0.2 * y).sin()
/// };
/// let prev = Array2::from_shape_fn((120, 160), |(y, x)| scene(x as f32, y as f32));
/// let next = Array2::from_shape_fn((120, 160), |(y, x)| scene(x as f32 - 2.25, y as f32 + 1.5));
/// let corners = detect_corners(prev.view(), None, &CornerOptions::default().max_corners(50))?;
/// let mut points: Vec<_> = corners.iter().map(|corner| corner.position).collect();
/// points.push([-50.0, 60.0]);
///
/// let options = TrackOptions::default();
/// let tracks = track_points(prev.view(), next.view(), &points, None, Masks::default(), &options)?;
/// let valid = tracks.iter().filter(|track| track.is_valid()).count();
/// assert!(2 * valid > points.len());
/// for (track, [x, y]) in tracks.iter().zip(&points).filter(|(track, _)| track.is_valid()) {
///     assert!((track.position[0] - x - 2.25).abs() < 0.1 && (track.position[1] - y + 1.5).abs() < 0.1);
/// }
/// // What cannot be measured says why.
/// assert_eq!(tracks[points.len() - 1].status, PointStatus::OutOfFrame);
/// # Ok::<(), lk_core::Error>(())
/// ```
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
    let (levels, workspace) = (options.levels_for(width, height), &mut kept);
    within_pool(&options.execution, || {
        let Workspace {
            prev: before,
            next: after,
            retry,
        } = workspace;
        let (first, second) = both(
            &options.execution,
            || before.rebuild_masked(prev, masks.of_prev(), levels, &options.execution),
            || after.rebuild_masked(next, masks.of_next(), levels, &options.execution),
        )?;
        first.and(second)?;
        track_keeping(before, after, points, guesses, options, retry, &mut tracks)
    })?;
    if width * height <= LARGEST_KEPT {
        KEPT.set(kept);
    }
    Ok(tracks)
}

impl Pyramid {
    /// The pyramid of `frame` for [`track_pyramids`], with as many levels as `options` ask for
    /// ([`TrackOptions::levels_for`]); `mask` is true where a pixel counts.
    ///
    /// # Errors
    ///
    /// Those of [`Pyramid::masked`] and of [`TrackOptions::validate`].
    ///
    /// ```
    /// use lk_core::{Pyramid, TrackOptions, track_pyramids};
    /// use lk_core::ndarray::Array2;
    ///
    /// let scene = |x: f32, y: f32| 100.0 + 40.0 * (0.3 * x).sin() * (0.2 * y).cos() + 20.0 * (0.05 * x + 0.3 * y).sin();
    /// let frame = |dx: f32| Array2::from_shape_fn((96, 128), |(y, x)| scene(x as f32 - dx, y as f32));
    /// let options = TrackOptions::default();
    /// let prev = Pyramid::for_tracking(frame(0.0).view(), None, &options)?;
    /// let next = Pyramid::for_tracking(frame(1.5).view(), None, &options)?;
    /// let mut tracks = Vec::new();
    /// track_pyramids(&prev, &next, &[[60.0, 50.0]], None, &options, &mut tracks)?;
    /// assert!((tracks[0].position[0] - 61.5).abs() < 0.05);
    /// # Ok::<(), lk_core::Error>(())
    /// ```
    pub fn for_tracking<T: Pixel>(
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        options: &TrackOptions,
    ) -> Result<Self> {
        options.validate()?;
        let (height, width) = frame.dim();
        let levels = options.levels_for(width, height);
        Self::masked(frame, mask, levels, &options.execution)
    }
}

/// Frames of more pixels than this do not leave their memory with the thread: the pyramids of one this size take
/// 22 megabytes.
const LARGEST_KEPT: usize = 1 << 21;

/// What a thread keeps from call to call: fresh memory for two pyramids costs as much as building them.
#[derive(Debug, Default)]
struct Workspace {
    prev: Pyramid,
    next: Pyramid,
    retry: retry::Workspace,
}

thread_local! {
    static KEPT: Cell<Workspace> = Cell::default();
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
        &mut retry::Workspace::default(),
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
    retry: &mut retry::Workspace,
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
            problem::Workspace::with(|workspace| {
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
    retry.retry(&problem, points, tracks)?;
    retry.deformed.find(&problem, points, tracks)?;
    if let Some(mask) = masks.of_next() {
        for track in tracks.iter_mut() {
            if track.is_valid() && masked(mask, track.position) {
                *track = TrackedPoint::lost(PointStatus::Masked);
            }
        }
    }
    retry
        .repetition
        .reject_ambiguous(&problem, points, tracks, &mut retry.grid)?;
    reject_isolated(&problem, points, tracks, &mut retry.grid)
}

/// Whether the pixel that `point` is in is excluded.
fn masked(mask: ArrayView2<'_, bool>, point: [f32; 2]) -> bool {
    let [x, y] = point.map(f32::round);
    x >= 0.0 && y >= 0.0 && mask.get((y as usize, x as usize)) == Some(&false)
}
