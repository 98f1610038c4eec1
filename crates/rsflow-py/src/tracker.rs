//! Points through a sequence.

use lk_core::{PointTracker, TrackerSnapshot};
use numpy::PyReadonlyArray2;
use numpy::ndarray::{Ix1, Ix2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::to_python;
use crate::frames::{AnyFrame, mask as borrow_mask, with_view};
use crate::interrupt;
use crate::outputs::{filled, gathered};
use crate::points::{POINTS, corner_options, to_dict, track_options};
use crate::shared::{Caller, Shared};
use crate::states::{array_plane, elements, entry, item, plane_array};

/// Points through a sequence; see `rsflow.PointTracker`.
#[pyclass(frozen, name = "PointTracker", module = "rsflow._core")]
pub(crate) struct PyPointTracker(Shared<PointTracker>);

#[pymethods]
impl PyPointTracker {
    #[new]
    #[pyo3(signature = (options, max_corners, quality, min_distance))]
    fn new(
        options: &Bound<'_, PyDict>,
        max_corners: isize,
        quality: f32,
        min_distance: f32,
    ) -> PyResult<Self> {
        let corners = corner_options(max_corners, quality, min_distance, 3, None)?;
        let options = track_options(options)?;
        let fresh = move || {
            PointTracker::new(options.clone(), corners.clone()).map_err(|error| to_python(&error))
        };
        Ok(Self(Shared::new(fresh, PointTracker::reset)?))
    }

    /// Take a frame; the arrays of the result by name.
    fn update<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        mask: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let frame = AnyFrame::new("frame", frame)?;
        let mask = borrow_mask("mask", mask, frame.dim())?;
        let mask = mask.as_ref().map(PyReadonlyArray2::as_array);
        let view = frame.view();
        let rows = self.call(py, |tracker| {
            with_view!(view, |frame| tracker.update(frame, mask))
                .map_err(|error| to_python(&error))
                .and_then(|rows| gathered(POINTS, rows.iter().copied()))
        })?;
        let dict = to_dict(py, rows.iter().map(|row| row.track))?;
        let ids = rows
            .iter()
            .map(|row| i64::try_from(row.id).unwrap_or(i64::MAX));
        let ages = rows.iter().map(|row| row.age);
        let origins = rows.iter().flat_map(|row| row.origin);
        let count = rows.len();
        dict.set_item("ids", filled(py, POINTS, Ix1(count), ids)?)?;
        dict.set_item("ages", filled(py, POINTS, Ix1(count), ages)?)?;
        dict.set_item("origins", filled(py, POINTS, Ix2(count, 2), origins)?)?;
        Ok(dict)
    }

    /// Forget the frame before and its points.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        if self.0.renew_if_lost()? {
            return Ok(());
        }
        self.call(py, |tracker| {
            tracker.reset();
            Ok(())
        })
    }

    /// Whether the last frame began another scene.
    #[getter]
    fn scene_cut(&self, py: Python<'_>) -> PyResult<bool> {
        self.call(py, |tracker| Ok(tracker.scene_cut()))
    }

    /// What is known so far, for `restore`.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let snapshot = self.call(py, |tracker| {
            tracker.snapshot().map_err(|error| to_python(&error))
        })?;
        let count = snapshot.points.len();
        let points = snapshot.points.iter().flatten().copied();
        let (ids, ages) = (snapshot.ids.iter().copied(), snapshot.ages.iter().copied());
        let frame = snapshot.frame.as_ref();
        let state = PyDict::new(py);
        state.set_item(
            "frame",
            frame.map(|frame| plane_array(py, frame)).transpose()?,
        )?;
        let support = snapshot.support.iter().copied();
        let pixels = support.len();
        state.set_item("support", filled(py, POINTS, Ix1(pixels), support)?)?;
        state.set_item("points", filled(py, POINTS, Ix2(count, 2), points)?)?;
        state.set_item("ids", filled(py, POINTS, Ix1(count), ids)?)?;
        state.set_item("ages", filled(py, POINTS, Ix1(count), ages)?)?;
        state.set_item("next_id", snapshot.next_id)?;
        state.set_item("scene_cut", snapshot.scene_cut)?;
        Ok(state)
    }

    /// Take over what `state` gave, perhaps elsewhere.
    fn restore(&self, py: Python<'_>, state: &Bound<'_, PyDict>) -> PyResult<()> {
        let frame = item(state, "frame")?;
        let frame = Some(frame).filter(|frame| !frame.is_none());
        let points: Vec<f32> = elements::<f32, Ix2>(state, "points")?;
        let pairs = points.as_chunks::<2>().0.iter().copied();
        let mut snapshot = TrackerSnapshot::default();
        snapshot.frame = frame
            .map(|frame| array_plane("frame", &frame))
            .transpose()?;
        snapshot.support = elements::<u8, Ix1>(state, "support")?;
        snapshot.points = gathered(POINTS, pairs)?;
        snapshot.ids = elements::<u64, Ix1>(state, "ids")?;
        snapshot.ages = elements::<u32, Ix1>(state, "ages")?;
        snapshot.next_id = entry(state, "next_id")?;
        snapshot.scene_cut = entry(state, "scene_cut")?;
        self.call(py, |tracker| {
            tracker
                .restore(&snapshot)
                .map_err(|error| to_python(&error))
        })
    }
}

impl PyPointTracker {
    /// Call `work` with the tracker, on this thread: the few milliseconds that a frame takes end well before anyone
    /// waits.
    fn call<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut PointTracker) -> PyResult<R> + Send,
    ) -> PyResult<R> {
        let caller = Caller::new();
        interrupt::run(py, 0, |execution| self.0.with(caller, execution, work))
    }
}
