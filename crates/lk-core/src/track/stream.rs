//! Points through a sequence: persistent ids, ages, and new points where the frame has none.

use ndarray::ArrayView2;

use crate::corners::{Corner, CornerDetector, CornerOptions};
use crate::error::{Error, Result};
use crate::frame::{Frame, Pixel, expect_size, pixels_of};
use crate::memory::{reserve, resize};
use crate::parallel::within_pool;
use crate::pyramid::Pyramid;
use crate::support::Masks;
use crate::track::options::POINTS;
use crate::track::options::{PointStatus, TrackOptions, TrackedPoint};
use crate::track::retry;
use crate::track::{Guesses, track_keeping};

/// Share of the points that must be lost at once for a scene cut: a point that seems to survive one is chance.
const CUT_SHARE: f32 = 0.8;

/// Fewer points than this say nothing about a cut.
const CUT_POINTS: usize = 8;

/// Share of the wanted points below which new ones are sought.
const REFILL_SHARE: f32 = 0.9;

/// There are hardly more local maxima of the response than one in so many pixels.
const PIXELS_A_CORNER: usize = 8;

/// Room for more points is made when they are there, not before.
const MOST_RESERVED: usize = 1 << 16;

/// One row of what [`PointTracker::update`] gives.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct StreamPoint {
    /// The same in every frame, never used again.
    pub id: u64,
    /// Frames since the point was found, 0 for [`PointStatus::New`].
    pub age: u32,
    /// Position in the frame before; NaN for a new point.
    pub origin: [f32; 2],
    /// Position in this frame, or why there is none.
    pub track: TrackedPoint,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Alive {
    pub(super) id: u64,
    pub(super) age: u32,
}

/// Tracks points from frame to frame. Each pyramid is built once, and after the second frame of a size nothing is
/// allocated on one thread, but where a tenth of the points is lost at once and the frames are correlated.
///
/// ```
/// use lk_core::{CornerOptions, PointTracker, TrackOptions};
/// use ndarray::Array2;
///
/// let frame = Array2::from_shape_fn((96, 128), |(y, x)| ((x * x + 3 * x * y + 7 * y * y) % 251) as u8);
/// let mut tracker = PointTracker::new(TrackOptions::default(), CornerOptions::default())?;
/// assert!(tracker.update(frame.view(), None)?.iter().all(|point| point.age == 0));
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug)]
pub struct PointTracker {
    pub(super) options: TrackOptions,
    corner_options: CornerOptions,
    detector: CornerDetector,
    corners: Vec<Corner>,
    pub(super) prev: Pyramid,
    next: Pyramid,
    pub(super) size: Option<(usize, usize)>,
    pub(super) alive: Vec<Alive>,
    pub(super) points: Vec<[f32; 2]>,
    tracks: Vec<TrackedPoint>,
    retry: retry::Workspace,
    rows: Vec<StreamPoint>,
    occupied: Vec<bool>,
    pub(super) next_id: u64,
    pub(super) scene_cut: bool,
}

impl PointTracker {
    /// A tracker that has not seen a frame.
    ///
    /// # Errors
    ///
    /// Those of [`TrackOptions::validate`] and [`CornerOptions::validate`].
    pub fn new(options: TrackOptions, corner_options: CornerOptions) -> Result<Self> {
        options.validate()?;
        corner_options.validate()?;
        Ok(Self {
            options,
            corner_options,
            detector: CornerDetector::default(),
            corners: Vec::new(),
            prev: Pyramid::default(),
            next: Pyramid::default(),
            size: None,
            alive: Vec::new(),
            points: Vec::new(),
            tracks: Vec::new(),
            retry: retry::Workspace::default(),
            rows: Vec::new(),
            occupied: Vec::new(),
            next_id: 0,
            scene_cut: false,
        })
    }

    /// Forget the frame before and its points; ids go on.
    pub fn reset(&mut self) {
        self.size = None;
        self.alive.clear();
        self.points.clear();
        self.rows.clear();
        self.scene_cut = false;
    }

    /// Whether the last frame was taken for the first of another scene: all its points were declared lost.
    #[must_use]
    pub fn scene_cut(&self) -> bool {
        self.scene_cut
    }

    /// Take the next frame: a row for each point of the frame before, tracked or lost, then the new points.
    /// `mask` is true where to measure.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if the frame is not of the size of those before, or the mask not of the frame's;
    /// [`Error::Memory`]; those of the execution. The tracker then stands where it stood before.
    pub fn update<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
    ) -> Result<&[StreamPoint]> {
        let (height, width) = frame.dim();
        if let Some(size) = self.size
            && size != (height, width)
        {
            return Err(Error::shape(
                "frame",
                format!("({height}, {width})"),
                format!(
                    "the shape of the frames before, {size:?}; reset() starts another sequence"
                ),
            ));
        }
        if let Some(mask) = mask {
            expect_size("mask", mask.dim(), "the frame", (height, width))?;
        }
        let pixels = pixels_of("frame", (height, width))?;
        if self.size.is_none() {
            self.reserve(pixels)?;
        }
        let levels = self.options.levels_for(width, height);
        // The same setting as in `self`, which the work below has for itself.
        let execution = self.options.execution.clone();
        let followed = within_pool(&execution, || self.follow(frame, mask, levels));
        if followed.as_ref().is_err_and(Error::is_memory) {
            // Others may need it, and what is tracked next may be smaller.
            (self.next, self.retry) = (Pyramid::default(), retry::Workspace::default());
            self.detector = CornerDetector::default();
        }
        followed?;
        self.size = Some((height, width));
        std::mem::swap(&mut self.prev, &mut self.next);
        Ok(&self.rows)
    }

    /// Track the points into `frame` and find new ones.
    fn follow<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        levels: usize,
    ) -> Result<()> {
        self.next
            .rebuild_masked(frame, mask, levels, &self.options.execution)?;
        if self.size.is_some() {
            track_keeping(
                &self.prev,
                &self.next,
                &self.points,
                Guesses {
                    initial: None,
                    masks: Masks::default().next(mask),
                },
                &self.options,
                &mut self.retry,
                &mut self.tracks,
            )?;
        } else {
            self.tracks.clear();
        }
        let (living, cut) = self.judge();
        let cells = self.seek(living, mask)?;
        // From here on nothing fails, so that an error leaves the points as they were.
        self.scene_cut = cut;
        self.keep();
        if let Some(cells) = &cells {
            self.take_new(cells);
        }
        Ok(())
    }

    /// Make room for all points of frames of so many pixels, so that later frames allocate nothing.
    pub(super) fn reserve(&mut self, pixels: usize) -> Result<()> {
        let maxima = pixels / PIXELS_A_CORNER;
        let points = self.wanted(pixels).min(maxima).min(MOST_RESERVED);
        reserve(POINTS, &mut self.corners, points)?;
        reserve(POINTS, &mut self.alive, points)?;
        reserve(POINTS, &mut self.points, points)?;
        reserve(POINTS, &mut self.tracks, points)?;
        // Those that were lost and those that replace them.
        reserve(POINTS, &mut self.rows, 2 * points)?;
        self.retry.reserve(points)?;
        self.detector.reserve(maxima)
    }

    /// How many points there are to be in a frame of so many pixels, which holds no more than one in each.
    fn wanted(&self, pixels: usize) -> usize {
        match self.corner_options.max_corners {
            0 => pixels,
            corners => corners.min(pixels),
        }
    }

    /// Declare lost what a cut of the scene excludes; how many points live on, and whether there is a cut.
    fn judge(&mut self) -> (usize, bool) {
        // A point that left the frame or met the mask says nothing about the scene.
        let judged = |status| {
            !matches!(
                status,
                PointStatus::OutOfFrame
                    | PointStatus::Masked
                    | PointStatus::LowSupport
                    | PointStatus::Ambiguous
            )
        };
        let (mut total, mut lost) = (0usize, 0usize);
        for track in &self.tracks {
            total += usize::from(judged(track.status));
            lost += usize::from(judged(track.status) && !track.is_valid());
        }
        let cut = total >= CUT_POINTS && lost as f32 >= CUT_SHARE * total as f32;
        if cut {
            for track in self.tracks.iter_mut().filter(|track| track.is_valid()) {
                *track = TrackedPoint::lost(PointStatus::HighResidual);
            }
        }
        let living = self.tracks.iter().filter(|track| track.is_valid());
        (living.count(), cut)
    }

    /// Look for corners if too few points live, and make room for what comes of them; the cells of a grid, if so.
    fn seek(&mut self, living: usize, mask: Option<ArrayView2<'_, bool>>) -> Result<Option<Cells>> {
        self.corners.clear();
        let mut cells = None;
        if let Some(plane) = self.next.levels().first() {
            let size = (plane.width(), plane.height());
            let wanted = self.wanted(size.0 * size.1);
            if wanted > 0 && (living as f32) < REFILL_SHARE * wanted as f32 {
                // Cells that hold one point each if the wanted ones were spread evenly.
                let even = ((size.0 * size.1) as f32 / wanted as f32).sqrt();
                let found = Cells::new(size, even.max(self.corner_options.min_distance).max(1.0));
                self.occupied.clear();
                resize(POINTS, &mut self.occupied, found.count(), false)?;
                for track in self.tracks.iter().filter(|track| track.is_valid()) {
                    self.occupied[found.of(track.position)] = true;
                }
                self.detector.detect_where(
                    plane,
                    self.next.support().first(),
                    mask,
                    &self.corner_options,
                    &mut self.corners,
                )?;
                let all = (living + self.corners.len()).min(wanted.max(living));
                reserve(POINTS, &mut self.alive, all)?;
                reserve(POINTS, &mut self.points, all)?;
                cells = Some(found);
            }
        }
        let rows = self.tracks.len() + self.corners.len();
        reserve(POINTS, &mut self.rows, rows)?;
        Ok(cells)
    }

    /// Write a row for each old point, and keep those that live.
    fn keep(&mut self) {
        self.rows.clear();
        let mut living = 0;
        for (index, track) in self.tracks.iter().enumerate() {
            let Alive { id, age } = self.alive[index];
            let age = age.saturating_add(1);
            self.rows.push(StreamPoint {
                id,
                age,
                origin: self.points[index],
                track: *track,
            });
            if track.is_valid() {
                self.alive[living] = Alive { id, age };
                self.points[living] = track.position;
                living += 1;
            }
        }
        self.alive.truncate(living);
        self.points.truncate(living);
    }

    /// Take the corners that stand in cells without a point, and not too near to one.
    fn take_new(&mut self, cells: &Cells) {
        let wanted = self.wanted(cells.pixels());
        let old = self.points.len();
        let limit = self.corner_options.min_distance * self.corner_options.min_distance;
        for corner in &self.corners {
            if self.points.len() >= wanted {
                break;
            }
            let position = corner.position;
            let near = |point: &[f32; 2]| {
                let (dx, dy) = (point[0] - position[0], point[1] - position[1]);
                dx * dx + dy * dy < limit
            };
            if self.occupied[cells.of(position)] || self.points[..old].iter().any(near) {
                continue;
            }
            let id = self.next_id;
            self.next_id += 1;
            self.alive.push(Alive { id, age: 0 });
            self.points.push(position);
            self.rows.push(StreamPoint {
                id,
                age: 0,
                origin: [f32::NAN; 2],
                track: TrackedPoint {
                    position,
                    ..TrackedPoint::lost(PointStatus::New)
                },
            });
        }
    }
}

/// Square cells over a frame.
struct Cells {
    /// Columns and rows of the frame.
    size: (usize, usize),
    side: f32,
    columns: usize,
    rows: usize,
}

impl Cells {
    fn new(size: (usize, usize), side: f32) -> Self {
        let [columns, rows] = [size.0, size.1].map(|length| (length as f32 / side).ceil() as usize);
        Self {
            size,
            side,
            columns,
            rows,
        }
    }

    fn pixels(&self) -> usize {
        self.size.0 * self.size.1
    }

    fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// The cell of a place within the frame.
    fn of(&self, [x, y]: [f32; 2]) -> usize {
        let column = ((x / self.side) as usize).min(self.columns - 1);
        let row = ((y / self.side) as usize).min(self.rows - 1);
        row * self.columns + column
    }
}
