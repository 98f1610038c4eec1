//! Points through a sequence: persistent ids, ages, and new points where the frame has none.

use ndarray::ArrayView2;

use crate::corners::{Corner, CornerDetector, CornerOptions};
use crate::error::{Error, Result};
use crate::frame::{Frame, Pixel, expect_size};
use crate::parallel::within_pool;
use crate::pyramid::Pyramid;
use crate::track::grid::reserve;
use crate::track::options::{PointStatus, TrackOptions, TrackedPoint};
use crate::track::retry::Memory;
use crate::track::{Guesses, masked, track_keeping};

/// Share of the points that must be lost at once for a scene cut: a point that seems to survive one is chance.
const CUT_SHARE: f32 = 0.8;

/// Fewer points than this say nothing about a cut.
const CUT_POINTS: usize = 8;

/// Share of the wanted points below which new ones are sought.
const REFILL_SHARE: f32 = 0.9;

/// There are hardly more local maxima of the response than one in so many pixels.
const PIXELS_A_CORNER: usize = 8;

/// One row of what [`PointTracker::update`] gives.
#[derive(Debug, Clone, Copy, PartialEq)]
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
struct Alive {
    id: u64,
    age: u32,
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
    options: TrackOptions,
    corner_options: CornerOptions,
    detector: CornerDetector,
    corners: Vec<Corner>,
    prev: Pyramid,
    next: Pyramid,
    size: Option<(usize, usize)>,
    alive: Vec<Alive>,
    points: Vec<[f32; 2]>,
    tracks: Vec<TrackedPoint>,
    memory: Memory,
    rows: Vec<StreamPoint>,
    occupied: Vec<bool>,
    next_id: u64,
    scene_cut: bool,
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
            memory: Memory::default(),
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
    /// [`Error::Shape`] if the frame is not of the size of those before, or the mask not of the frame's; those of the
    /// execution. The tracker then stands where it stood before.
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
        if self.size.is_none() {
            self.reserve(width * height);
        }
        let levels = self.options.levels_for(width, height);
        // The same setting as in `self`, which the work below has for itself.
        let execution = self.options.execution.clone();
        within_pool(&execution, || self.follow(frame, mask, levels))?;
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
        self.next.rebuild(frame, levels, &self.options.execution)?;
        if self.size.is_some() {
            track_keeping(
                &self.prev,
                &self.next,
                &self.points,
                Guesses {
                    initial: None,
                    mask,
                },
                &self.options,
                &mut self.memory,
                &mut self.tracks,
            )?;
        } else {
            self.tracks.clear();
        }
        self.keep(mask);
        self.replenish(mask)
    }

    /// Make room for all points of frames of so many pixels, so that later frames allocate nothing.
    fn reserve(&mut self, pixels: usize) {
        let points = match self.corner_options.max_corners {
            0 => pixels / PIXELS_A_CORNER,
            corners => corners,
        };
        reserve(&mut self.corners, points);
        reserve(&mut self.alive, points);
        reserve(&mut self.points, points);
        reserve(&mut self.tracks, points);
        // Those that were lost and those that replace them.
        reserve(&mut self.rows, 2 * points);
        self.memory.reserve(points);
        self.detector.reserve(pixels / PIXELS_A_CORNER);
    }

    /// Write a row for each old point, and keep those that live.
    fn keep(&mut self, mask: Option<ArrayView2<'_, bool>>) {
        for track in &mut self.tracks {
            if track.is_valid() && mask.is_some_and(|mask| masked(mask, track.position)) {
                *track = TrackedPoint::lost(PointStatus::Masked);
            }
        }
        // A point that left the frame or met the mask says nothing about the scene.
        let judged = |status| !matches!(status, PointStatus::OutOfFrame | PointStatus::Masked);
        let (mut total, mut lost) = (0usize, 0usize);
        for track in &self.tracks {
            total += usize::from(judged(track.status));
            lost += usize::from(judged(track.status) && !track.is_valid());
        }
        self.scene_cut = total >= CUT_POINTS && lost as f32 >= CUT_SHARE * total as f32;
        self.rows.clear();
        let mut living = 0;
        for index in 0..self.tracks.len() {
            let mut track = self.tracks[index];
            if self.scene_cut && track.is_valid() {
                track = TrackedPoint::lost(PointStatus::HighResidual);
            }
            let Alive { id, age } = self.alive[index];
            let age = age.saturating_add(1);
            self.rows.push(StreamPoint {
                id,
                age,
                origin: self.points[index],
                track,
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

    /// Find new points in the cells of a grid that have none.
    fn replenish(&mut self, mask: Option<ArrayView2<'_, bool>>) -> Result<()> {
        let Some(plane) = self.next.levels().first() else {
            return Ok(());
        };
        let (width, height) = (plane.width(), plane.height());
        let wanted = match self.corner_options.max_corners {
            0 => usize::MAX,
            corners => corners,
        };
        if width * height == 0 || self.points.len() as f32 >= REFILL_SHARE * wanted as f32 {
            return Ok(());
        }
        // Cells that hold one point each if the wanted ones were spread evenly.
        let even = ((width * height) as f32 / wanted as f32).sqrt();
        let cell = even.max(self.corner_options.min_distance).max(1.0);
        let columns = (width as f32 / cell).ceil() as usize;
        let rows = (height as f32 / cell).ceil() as usize;
        let cell_of = |[x, y]: [f32; 2]| {
            let column = ((x / cell) as usize).min(columns - 1);
            let row = ((y / cell) as usize).min(rows - 1);
            row * columns + column
        };
        self.occupied.clear();
        self.occupied.resize(columns * rows, false);
        for point in &self.points {
            self.occupied[cell_of(*point)] = true;
        }
        self.detector
            .detect_in(plane, mask, &self.corner_options, &mut self.corners)?;
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
            if self.occupied[cell_of(position)] || self.points[..old].iter().any(near) {
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
        Ok(())
    }
}
