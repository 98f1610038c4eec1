//! The motion over a plane through a sequence of frames.

use super::fit::Known;
use super::follow::Task;
use super::followed::Followed;
use super::lens::Lens;
use super::motion::{PlaneInterval, PlaneMotion, View, norm, rotate, rotation};
use super::seen::Seen;
use super::{
    PlaneFit, PlaneNumber, PlaneOptions, PlaneResponse, PlaneTile, PlaneTileStatus, expect_motion,
};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, expect_size};
use crate::parallel::within_pool;
use crate::pyramid::Pyramid;
use ndarray::ArrayView2;

/// Levels that are kept of each frame: the coarsest has 20 pixels or more along its shorter side.
const MOST_LEVELS: usize = 5;
const LEAST_SIDE: usize = 20;
/// Frames of fewer pixels are measured in less time than a second thread takes to wake up.
const ONE_THREAD_PIXELS: usize = 1 << 14;
/// Steps for the effect of numbers, so small that it is linear: in pixels and radians, and for coefficients.
const VARIED: [f64; 2] = [1e-5, 1e-7];

/// The motion of a camera over a plane, frame by frame.
///
/// ```
/// use lk_core::ndarray::Array2;
/// use lk_core::{Distortion, Execution, Lens, PlaneInterval, PlaneOptions, PlaneTracker};
///
/// let scene = |x: f32, y: f32| {
///     120.0 + 40.0 * (0.4 * x + 0.1 * y).sin() * (0.3 * y).cos() + 30.0 * (0.0016 * x * y + 0.2 * y).sin()
/// };
/// let frame = |dx: f32| Array2::from_shape_fn((120, 160), |(y, x)| scene(x as f32 - dx, y as f32));
/// let lens = Lens::new([200.0; 2], [79.5, 59.5], Distortion::Brown([0.0; 12]))?;
/// let mut tracker = PlaneTracker::new(lens);
/// tracker.push(frame(0.0).view(), None, &Execution::default())?;
/// tracker.push(frame(-1.5).view(), None, &Execution::default())?;
/// let options = PlaneOptions::default().rotation_std([1e-6; 3]);
/// let fit = tracker.motion(&PlaneInterval::default(), &[0.0; 6], &options)?.unwrap();
/// // The picture went 1.5 px to the left: the camera 1.5 / 200 of its height to the right.
/// assert!((fit.motion[0] - 0.0075).abs() < 2e-5 && fit.motion[1].abs() < 2e-5);
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct PlaneTracker {
    lens: Lens,
    prev: Pyramid,
    next: Pyramid,
    frames: usize,
}

impl PlaneTracker {
    /// For frames of this camera.
    #[must_use]
    pub fn new(lens: Lens) -> Self {
        Self {
            lens,
            prev: Pyramid::default(),
            next: Pyramid::default(),
            frames: 0,
        }
    }

    /// Take the next frame; `mask` is true where a pixel counts.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if it has another size than the frame before, or the mask another than the frame; those of
    /// [`Pyramid::masked`].
    pub fn push<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        execution: &Execution,
    ) -> Result<()> {
        if self.frames > 0 {
            let plane = &self.next.levels()[0];
            expect_size(
                "frame",
                frame.dim(),
                "the frame before",
                (plane.height(), plane.width()),
            )?;
        }
        let (height, width) = frame.dim();
        let mut levels = 1;
        while levels < MOST_LEVELS && height.min(width) >> levels >= LEAST_SIDE {
            levels += 1;
        }
        std::mem::swap(&mut self.prev, &mut self.next);
        let next = &mut self.next;
        let execution = shared(execution, height * width);
        let built = within_pool(&execution, || {
            next.rebuild_masked(frame, mask, levels, &execution)
        });
        if let Err(error) = built {
            std::mem::swap(&mut self.prev, &mut self.next);
            return Err(error);
        }
        self.frames = (self.frames + 1).min(2);
        Ok(())
    }

    /// Take the last frame back: the one before it is the last again, and there is none before that.
    pub fn take_back(&mut self) {
        std::mem::swap(&mut self.prev, &mut self.next);
        self.frames = self.frames.saturating_sub(1);
    }

    /// Forget all frames.
    pub fn reset(&mut self) {
        self.frames = 0;
    }

    /// The motion between the last two frames, near `start`; none where the frames do not determine one.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] before there are two frames; those of [`PlaneInterval::validate`] and
    /// [`PlaneOptions::validate`], and of the execution.
    pub fn motion(
        &self,
        interval: &PlaneInterval,
        start: &PlaneMotion,
        options: &PlaneOptions,
    ) -> Result<Option<PlaneFit>> {
        interval.validate()?;
        options.validate()?;
        expect_motion(start)?;
        if self.frames < 2 {
            return Err(Error::option("frames", self.frames, "two"));
        }
        let plane = &self.next.levels()[0];
        let execution = shared(&options.execution, plane.height() * plane.width());
        let task = Task {
            frames: [&self.prev, &self.next],
            lens: &self.lens,
            interval,
            execution: &execution,
        };
        let known: Known = options.known();
        within_pool(&execution, || {
            let followed = task.follow(start, &known, options.levels - 1)?;
            Ok(followed.map(|mut followed| {
                followed.widen();
                result(&task, &followed, &options.responses)
            }))
        })
    }
}

/// How a call for frames of this many pixels runs.
fn shared(execution: &Execution, pixels: usize) -> Execution {
    let execution = execution.clone();
    if pixels < ONE_THREAD_PIXELS {
        execution.threads(1)
    } else {
        execution
    }
}

fn result(task: &Task<'_>, followed: &Followed, numbers: &[PlaneNumber]) -> PlaneFit {
    let mut tiles: Vec<PlaneTile> = followed.tiles.iter().map(unweighed).collect();
    let step = &followed.step;
    for ((equation, index), weight) in
        (followed.equations.iter().zip(&followed.places)).zip(&step.weights)
    {
        let (tile, seen) = (&mut tiles[*index], &followed.tiles[*index]);
        tile.residual = equation.left(&step.step);
        tile.information = equation.information;
        tile.weight = *weight;
        tile.status = if !seen.is_matched(followed.noise) {
            PlaneTileStatus::Unmatched
        } else if *weight > 0.0 {
            PlaneTileStatus::Plane
        } else {
            PlaneTileStatus::Outlier
        };
        let odd = tile.status != PlaneTileStatus::Plane;
        if odd && task.is_fixed(seen) {
            tile.status = PlaneTileStatus::Fixed;
        }
    }
    PlaneFit {
        motion: followed.motion,
        normal: followed.normal(),
        pull: followed.pull(),
        responses: responses(task, followed, numbers),
        scale: step.scale,
        widened: followed.widened,
        residual: followed.noise.max(0.0).sqrt(),
        correlation: followed.correlation(),
        settled: followed.settled,
        tiles,
    }
}

/// A tile that has no equation.
fn unweighed(seen: &Seen) -> PlaneTile {
    PlaneTile {
        middle: seen.middle,
        displacement: seen.measured().unwrap_or([f64::NAN; 2]),
        residual: [f64::NAN; 2],
        weight: 0.0,
        information: [0.0; 3],
        correlation: seen.correlation,
        status: if seen.inside {
            PlaneTileStatus::LowTexture
        } else {
            PlaneTileStatus::Outside
        },
    }
}

/// The camera and what is known of it with one number changed, and by how much; none for a number that is none.
fn varied(task: &Task<'_>, number: PlaneNumber) -> Option<(Lens, PlaneInterval, f64)> {
    let mut lens = *task.lens;
    let mut interval = *task.interval;
    let by = match number {
        PlaneNumber::Lens(which) => {
            if which >= lens.numbers() {
                return None;
            }
            let by = VARIED[usize::from(which >= 4)];
            lens = lens.varied(which, by);
            by
        }
        PlaneNumber::Down(axis) => {
            let mut turn = [0.0; 3];
            turn[axis.min(1)] = VARIED[0];
            let turned = rotate(&rotation(turn), interval.down);
            let length = norm(turned);
            interval.down = turned.map(|value| value / length);
            VARIED[0]
        }
        PlaneNumber::Readout => {
            interval.readout += VARIED[0];
            VARIED[0]
        }
    };
    Some((lens, interval, by))
}

/// What each number does to the displacements.
fn responses(task: &Task<'_>, followed: &Followed, numbers: &[PlaneNumber]) -> Vec<PlaneResponse> {
    let rows = task.frames[0].levels()[0].height();
    let base = View::new(task.lens, task.interval, rows, &followed.motion);
    let changed: Vec<_> = numbers.iter().map(|number| varied(task, *number)).collect();
    let views: Vec<_> = changed
        .iter()
        .map(|changed| {
            changed
                .as_ref()
                .map(|(lens, interval, by)| (View::new(lens, interval, rows, &followed.motion), by))
        })
        .collect();
    followed.responses(numbers.len(), |number, seen| {
        let (view, by) = views[number].as_ref()?;
        let [[p, q], [r, s]] = [base.places(seen.middle)?, view.places(seen.middle)?];
        Some(std::array::from_fn(|k| {
            ((s[k] - r[k]) - (q[k] - p[k])) / **by
        }))
    })
}
