//! What a point tracker knows, to go on with it elsewhere or later.

use ndarray::ArrayView2;

use crate::error::{Error, Result};
use crate::frame::Plane;
use crate::memory::{replace, reserve};
use crate::track::options::POINTS;
use crate::track::stream::Alive;
use crate::track::stream::PointTracker;

/// What a [`PointTracker`] knows, to the bit: one of the same options that is given it goes on as the first would have.
/// To make one from what was written somewhere, fill in the fields of a default one.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct TrackerSnapshot {
    /// The frame before; `None` before the first one.
    pub frame: Option<Plane>,
    /// What each of its pixels is: 0 if it does not count, 1 if it is clipped, 2 if it counts; empty where all do.
    pub support: Vec<u8>,
    /// Its points.
    pub points: Vec<[f32; 2]>,
    /// The id of each.
    pub ids: Vec<u64>,
    /// The age of each, in frames.
    pub ages: Vec<u32>,
    /// The id of the next new point.
    pub next_id: u64,
    /// See [`PointTracker::scene_cut`].
    pub scene_cut: bool,
}

impl TrackerSnapshot {
    fn validate(&self) -> Result<()> {
        let count = self.points.len();
        for (what, length) in [("ids", self.ids.len()), ("ages", self.ages.len())] {
            if length != count {
                let expected = format!("one for each of the {count} points");
                return Err(Error::shape(what, length.to_string(), expected));
            }
        }
        if let Some(id) = self.ids.iter().find(|id| **id >= self.next_id) {
            let expected = format!("less than the next one, {}", self.next_id);
            return Err(Error::option("ids", id, expected));
        }
        let pixels = self.frame.as_ref().map_or(0, |frame| frame.data().len());
        if !self.support.is_empty() && self.support.len() != pixels {
            let expected = format!("none, or one for each of the {pixels} pixels");
            return Err(Error::shape(
                "support",
                self.support.len().to_string(),
                expected,
            ));
        }
        if self.frame.is_none() && count > 0 {
            return Err(Error::shape(
                "points",
                count.to_string(),
                "none without a frame",
            ));
        }
        Ok(())
    }
}

impl PointTracker {
    /// What is known of the frame before, its points, and the ids.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`].
    ///
    /// ```
    /// use lk_core::{CornerOptions, PointTracker, TrackOptions};
    /// use ndarray::Array2;
    ///
    /// let frame = Array2::from_shape_fn((96, 128), |(y, x)| ((x * x + 3 * x * y + 7 * y * y) % 251) as u8);
    /// let mut tracker = PointTracker::new(TrackOptions::default(), CornerOptions::default())?;
    /// tracker.update(frame.view(), None)?;
    /// let mut other = PointTracker::new(TrackOptions::default(), CornerOptions::default())?;
    /// other.restore(&tracker.snapshot()?)?;
    /// assert_eq!(other.update(frame.view(), None)?, tracker.update(frame.view(), None)?);
    /// # Ok::<(), lk_core::Error>(())
    /// ```
    pub fn snapshot(&self) -> Result<TrackerSnapshot> {
        let mut frame = None;
        if let Some(finest) = self.prev.levels().first().filter(|_| self.size.is_some()) {
            frame.insert(Plane::default()).copy_of(finest)?;
        }
        let mut support = Vec::new();
        if let Some(finest) = self.prev.support().first().filter(|_| frame.is_some()) {
            replace(POINTS, &mut support, finest.bytes().iter().copied())?;
        }
        let (mut points, mut ids, mut ages) = (Vec::new(), Vec::new(), Vec::new());
        replace(POINTS, &mut points, self.points.iter().copied())?;
        replace(POINTS, &mut ids, self.alive.iter().map(|alive| alive.id))?;
        replace(POINTS, &mut ages, self.alive.iter().map(|alive| alive.age))?;
        Ok(TrackerSnapshot {
            frame,
            support,
            points,
            ids,
            ages,
            next_id: self.next_id,
            scene_cut: self.scene_cut,
        })
    }

    /// Take over what another knew.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] or [`Error::Option`] if the snapshot contradicts itself, [`Error::Memory`], those of the execution.
    /// After an error the next frame is a first one.
    pub fn restore(&mut self, snapshot: &TrackerSnapshot) -> Result<()> {
        self.reset();
        snapshot.validate()?;
        let count = snapshot.points.len();
        self.next_id = snapshot.next_id;
        self.scene_cut = snapshot.scene_cut;
        let Some(frame) = &snapshot.frame else {
            return Ok(());
        };
        let size = (frame.height(), frame.width());
        self.reserve(size.0 * size.1)?;
        reserve(POINTS, &mut self.alive, count)?;
        reserve(POINTS, &mut self.points, count)?;
        let view = ArrayView2::from_shape(size, frame.data())
            .map_err(|error| Error::shape("frame", error.to_string(), "a whole plane"))?;
        let levels = self.options.levels_for(size.1, size.0);
        self.prev
            .rebuild_with(view, &snapshot.support, levels, &self.options.execution)?;
        self.points.extend(&snapshot.points);
        let alive = snapshot.ids.iter().zip(&snapshot.ages);
        self.alive
            .extend(alive.map(|(id, age)| Alive { id: *id, age: *age }));
        self.size = Some(size);
        Ok(())
    }
}
