//! What moves and what stands still in frames of any size: large ones are judged on reduced ones.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, frame_from_slice};
use crate::memory::resize;

use super::enlarge::enlarge;
use super::finer::Reduced;
use super::moving_motion::Shown;
use super::reduction::{Reduction, reduce};
use super::segmenter::{GivenFlow, Segmented, Segmenter, SegmenterOptions};
use super::snapshot::SegmenterSnapshot;
use super::transform::enlarged;

/// Frames of more pixels are judged at half the resolution, or less: noise is less there, and what a thing is like and how far
/// it goes is seen over fewer pixels.
const MOST_JUDGED: usize = 300_000;

/// Tells what moves from what stands still. The first frame has nothing to be compared with.
///
/// # Examples
///
/// ```
/// use lk_core::{Execution, GivenFlow, MotionSegmenter, SegmenterOptions};
/// use ndarray::Array2;
///
/// let mut segmenter = MotionSegmenter::new(SegmenterOptions::new(false, 12, 1.0, 0.29), (64, 48))?;
/// let frame = Array2::from_shape_fn((48, 64), |(y, x)| ((7 * x + 11 * y) % 50) as u8);
/// let one = Execution::default();
/// segmenter.update(frame.view(), None, None, &one)?;
/// let flow = GivenFlow { uv: &[0.0; 2 * 64 * 48], valid: &[true; 64 * 48], size: (64, 48) };
/// let seen = segmenter.update(frame.view(), Some(flow), None, &one)?;
/// assert!(!seen.parallax && !segmenter.moving().contains(&1));
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug)]
pub struct MotionSegmenter {
    inner: Segmenter,
    /// Columns and rows of a frame, and how many times it is reduced.
    frame: (usize, usize),
    by: usize,
    scale: f32,
    /// What moves in the last frame.
    moving: Vec<u8>,
    work: Work,
}

/// Memory that is kept.
#[derive(Debug, Default)]
struct Work {
    /// A frame, reduced, and one that is being reduced.
    levels: [Vec<f32>; 2],
    /// The still scene of the reduced frame, where it was asked for.
    scene: Vec<f32>,
    counts: Vec<bool>,
    uv: Vec<f32>,
    valid: Vec<bool>,
    inside: Vec<u8>,
}

/// How many times a frame is reduced.
fn reduced_by((width, height): (usize, usize)) -> usize {
    let mut by = 1;
    while width * height > MOST_JUDGED * by * by {
        by *= 2;
    }
    by
}

impl MotionSegmenter {
    /// For frames of `size`, columns and rows.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] for a frame without pixels; [`Error::Memory`].
    pub fn new(options: SegmenterOptions, size: (usize, usize)) -> Result<Self> {
        let by = reduced_by(size);
        let judged = SegmenterOptions::new(
            options.camera_moves,
            options.min_area.div_ceil(by * by),
            options.scale,
            options.rounding / by as f32,
        );
        let inner = Segmenter::new(judged, (size.0.div_ceil(by), size.1.div_ceil(by)))?;
        let mut segmenter = Self {
            inner,
            frame: size,
            by,
            scale: options.scale,
            moving: Vec::new(),
            work: Work::default(),
        };
        segmenter.see_nothing()?;
        Ok(segmenter)
    }

    /// Nothing moves yet in the frame itself, and its still scene is not found.
    fn see_nothing(&mut self) -> Result<()> {
        if self.by > 1 {
            resize("masks", &mut self.moving, self.frame.0 * self.frame.1, 0)?;
            self.moving.fill(0);
            self.work.scene.clear();
        }
        Ok(())
    }

    /// Forget all frames.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`].
    pub fn reset(&mut self) -> Result<()> {
        self.see_nothing()?;
        self.inner.reset()
    }

    /// [`Self::reset`] after a panic: where there is no memory for it, what is there stays.
    pub fn reset_or_keep(&mut self) {
        let _ = self.reset();
    }

    /// Columns and rows of a frame.
    #[must_use]
    pub fn frame_size(&self) -> (usize, usize) {
        self.frame
    }

    /// Columns and rows of what flow is judged on.
    #[must_use]
    pub fn reduced_size(&self) -> (usize, usize) {
        self.inner.reduced_size()
    }

    /// What moves in the last frame, 1 for each pixel that does.
    #[must_use]
    pub fn moving(&self) -> &[u8] {
        if self.by == 1 {
            self.inner.moving()
        } else {
            &self.moving
        }
    }

    /// Take the next frame, with the flow from the one before, which the first has not; `counts` is false where a pixel does
    /// not count. The flow is of the frame's size, or of [`Self::reduced_size`] in pixels of that.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if the sizes do not fit together; those of the execution; [`Error::Memory`].
    pub fn update<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        flow: Option<GivenFlow<'_>>,
        counts: Option<&[bool]>,
        execution: &Execution,
    ) -> Result<Segmented> {
        if self.by == 1 {
            return self.inner.update(frame, flow, counts, execution);
        }
        let size = (self.frame.1, self.frame.0);
        crate::frame::expect_size("image", frame.dim(), "the frames before", size)?;
        self.reduce(frame, execution)?;
        let small = self.inner.frame_size();
        let reduced_counts = counts
            .map(|counts| self.reduce_counts(counts))
            .transpose()?;
        let flow = flow.map(|flow| self.reduce_flow(flow)).transpose()?;
        let work = &self.work;
        let given = flow.map(|whole| {
            whole.unwrap_or(GivenFlow {
                uv: &work.uv,
                valid: &work.valid,
                size: small,
            })
        });
        let levels = frame_from_slice(&work.levels[0], small.0, small.1, small.0)?;
        let counted = reduced_counts.map(|()| &work.counts[..]);
        let mut seen = self.inner.update(levels, given, counted, execution)?;
        seen.camera.homography = enlarged(&seen.camera.homography, self.by);
        seen.camera.sigma_px *= self.by as f64;
        seen.noise *= self.by as f32;
        self.see(frame, counts, execution)?;
        Ok(seen)
    }

    /// What moves in the frame itself.
    fn see<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        counts: Option<&[bool]>,
        execution: &Execution,
    ) -> Result<()> {
        self.work.scene.clear();
        if !self.inner.moving().contains(&1) {
            self.moving.fill(0);
            return Ok(());
        }
        self.find_scene(execution)?;
        let work = &mut self.work;
        let reduced = Reduced {
            moving: self.inner.moving(),
            levels: &work.levels[0],
            scene: &work.scene,
            size: self.inner.frame_size(),
            by: self.by,
            scale: self.scale,
        };
        reduced.finer(frame, counts, &mut work.inside, &mut self.moving, execution)
    }

    /// The still scene of the reduced frame, unless it is there.
    fn find_scene(&mut self, execution: &Execution) -> Result<()> {
        let scene = &mut self.work.scene;
        if !scene.is_empty() {
            return Ok(());
        }
        let (columns, rows) = self.inner.frame_size();
        resize("a picture", scene, columns * rows, 0.0)?;
        let found = self.inner.scene(scene, execution);
        if found.is_err() {
            scene.clear();
        }
        found
    }

    fn reduce<T: Pixel>(&mut self, frame: Frame<'_, T>, execution: &Execution) -> Result<()> {
        let [here, to] = &mut self.work.levels;
        let mut size = Reduction::Half.of(self.frame);
        resize("a frame", here, size.0 * size.1, 0.0)?;
        reduce(frame, Reduction::Half, here, execution)?;
        let mut by = 2;
        while by < self.by {
            let next = Reduction::Half.of(size);
            resize("a frame", to, next.0 * next.1, 0.0)?;
            let from = frame_from_slice(here, size.0, size.1, size.0)?;
            reduce(from, Reduction::Half, to, execution)?;
            std::mem::swap(here, to);
            (size, by) = (next, 2 * by);
        }
        Ok(())
    }

    /// Blocks count where all their pixels do.
    fn reduce_counts(&mut self, counts: &[bool]) -> Result<()> {
        let (width, height) = self.frame;
        if counts.len() != width * height {
            let (got, wanted) = (counts.len().to_string(), (width * height).to_string());
            return Err(Error::shape("mask", got, wanted));
        }
        let (columns, rows) = self.inner.frame_size();
        let to = &mut self.work.counts;
        to.clear();
        resize("masks", to, columns * rows, true)?;
        for (y, line) in counts.chunks_exact(width).enumerate() {
            let to = &mut to[y / self.by * columns..][..columns];
            for (to, block) in to.iter_mut().zip(line.chunks(self.by)) {
                *to &= !block.contains(&false);
            }
        }
        Ok(())
    }

    /// A flow of the frame's size as the reduced frame has it, in memory that is kept; any other is given back.
    fn reduce_flow<'a>(&mut self, flow: GivenFlow<'a>) -> Result<Option<GivenFlow<'a>>> {
        if flow.size != self.frame {
            return Ok(Some(flow));
        }
        let ((width, height), by) = (self.frame, self.by);
        if flow.uv.len() != 2 * width * height || flow.valid.len() != width * height {
            let got = format!("{} and {} elements", flow.uv.len(), flow.valid.len());
            let wanted = format!("those of {:?}", self.frame);
            return Err(Error::shape("flow", got, wanted));
        }
        let (columns, rows) = self.inner.frame_size();
        let share = 1.0 / by as f32;
        resize("a flow", &mut self.work.uv, 2 * columns * rows, 0.0)?;
        resize("masks", &mut self.work.valid, columns * rows, false)?;
        for y in 0..rows {
            let row = (y * by + by / 2).min(height - 1) * width;
            let uv = flow.uv[2 * row..2 * (row + width)].chunks(2 * by);
            let to = &mut self.work.uv[2 * y * columns..2 * (y + 1) * columns];
            for (to, block) in to.as_chunks_mut::<2>().0.iter_mut().zip(uv) {
                let at = by.min(block.len() - 2);
                *to = [block[at] * share, block[at + 1] * share];
            }
            let valid = flow.valid[row..row + width].chunks(by);
            let to = &mut self.work.valid[y * columns..(y + 1) * columns];
            for (to, block) in to.iter_mut().zip(valid) {
                *to = block[(by / 2).min(block.len() - 1)];
            }
        }
        Ok(None)
    }

    /// Write, for each pixel of the last frame, the length of the motion that the camera's does not explain, and where
    /// something moves that motion itself, x and y; NaN where it is not known, the motion also where the flow is not trusted or
    /// it is shorter than `least_px`: flow within a thing is often that of the ground around it. Where nothing moves no motion
    /// is written.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if `length` has not as many elements as a frame has pixels and `motion` twice as many; those of the
    /// execution.
    pub fn motion(
        &self,
        least_px: f64,
        length: &mut [f32],
        motion: &mut [f32],
        execution: &Execution,
    ) -> Result<()> {
        let shown = Shown {
            size: self.frame,
            by: self.by,
            moving: self.moving(),
        };
        self.inner
            .motion(&shown, least_px, length, motion, execution)
    }

    /// Write the still scene at the pixels of the last frame, in its light; NaN where nothing is known. Of frames that are
    /// judged on reduced ones it has their resolution.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if `to` has not as many elements as a frame has pixels; those of the execution; [`Error::Memory`].
    pub fn scene(&mut self, to: &mut [f32], execution: &Execution) -> Result<()> {
        if self.by == 1 {
            return self.inner.scene(to, execution);
        }
        let (width, height) = self.frame;
        if to.len() != width * height {
            let expected = format!("{}, the pixels of a frame", width * height);
            return Err(Error::shape("scene", to.len().to_string(), expected));
        }
        self.find_scene(execution)?;
        let from = (&self.work.scene[..], self.inner.frame_size());
        enlarge(from, self.by, (to, self.frame), execution)
    }

    /// What is known, for [`Self::restore`].
    #[must_use]
    pub fn snapshot(&self) -> SegmenterSnapshot {
        self.inner.snapshot()
    }

    /// Take over what [`Self::snapshot`] gave, perhaps elsewhere, of a segmenter of the same options and size.
    /// What moves in frames that are judged on reduced ones is told with the next one.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] where it is of another size; [`Error::Memory`].
    pub fn restore(&mut self, snapshot: &SegmenterSnapshot) -> Result<()> {
        self.inner.restore(snapshot)?;
        self.see_nothing()
    }
}

#[cfg(test)]
mod tests;
