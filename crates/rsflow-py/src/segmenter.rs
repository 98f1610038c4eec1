//! What moves and what stands still, for Python.

use std::borrow::Cow;

use lk_core::{GivenFlow, MotionSegmenter, SegmenterOptions, SegmenterSnapshot};
use numpy::ndarray::{Ix1, Ix2, Ix3};
use numpy::{PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::to_python;
use crate::frames::{AnyFrame, mask as borrow_mask, with_view};
use crate::interrupt;
use crate::outputs::{filled, gathered, owned};
use crate::shared::{Caller, Shared};
use crate::states::elements;

/// Floats that cost nothing before they are touched.
fn zeros(what: &'static str, count: usize) -> PyResult<Vec<f32>> {
    lk_core::zero_floats(what, count).map_err(|error| to_python(&error))
}

/// What memory for masks holds.
const MASKS: &str = "masks";

/// What moves; homography, model, standard deviation and explained share of the camera's motion; parallax; gain, offset and
/// noise.
type Seen<'py> = (
    Bound<'py, PyArray2<bool>>,
    ([[f64; 3]; 3], &'static str, f64, f64),
    bool,
    (f32, f32, f32),
);

/// The length of a motion, and that motion.
type Motion<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray3<f32>>);

/// What moves and what stands still, frame after frame; see `rsflow.MotionSegmenter`.
#[pyclass(frozen, name = "Segmenter", module = "rsflow._core")]
pub(crate) struct PySegmenter(Shared<MotionSegmenter>);

#[pymethods]
impl PySegmenter {
    #[new]
    #[pyo3(signature = (camera_moves, min_area, scale, rounding, shape))]
    fn new(
        camera_moves: bool,
        min_area: usize,
        scale: f32,
        rounding: f32,
        shape: (usize, usize),
    ) -> PyResult<Self> {
        let fresh = move || {
            let options = SegmenterOptions::new(camera_moves, min_area, scale, rounding);
            MotionSegmenter::new(options, (shape.1, shape.0)).map_err(|error| to_python(&error))
        };
        Ok(Self(Shared::new(fresh, MotionSegmenter::reset_or_keep)?))
    }

    /// Rows and columns of what flow is judged on.
    fn reduced_shape(&self, py: Python<'_>) -> PyResult<(usize, usize)> {
        let (width, height) = self.call(py, |segmenter, _| Ok(segmenter.reduced_size()))?;
        Ok((height, width))
    }

    /// Take the next frame.
    fn update<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        uv: Option<PyReadonlyArray3<'py, f32>>,
        valid: Option<PyReadonlyArray2<'py, bool>>,
        mask: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Seen<'py>> {
        let frame = AnyFrame::new("image", frame)?;
        let (height, width) = frame.dim();
        let mask = borrow_mask("mask", mask, frame.dim())?;
        let counts = mask
            .map(|mask| gathered(MASKS, mask.as_array().iter().copied()))
            .transpose()?;
        let parts = match (&uv, &valid) {
            (Some(uv), Some(valid)) => {
                let uv = match uv.as_slice() {
                    Ok(uv) => Cow::Borrowed(uv),
                    Err(_) => Cow::Owned(gathered("a flow", uv.as_array().iter().copied())?),
                };
                let shape = valid.shape();
                let valid_here = match valid.as_slice() {
                    Ok(valid) => Cow::Borrowed(valid),
                    Err(_) => Cow::Owned(gathered(MASKS, valid.as_array().iter().copied())?),
                };
                Some((uv, valid_here, (shape[1], shape[0])))
            }
            _ => None,
        };
        let flow = parts.as_ref().map(|(uv, valid, size)| GivenFlow {
            uv,
            valid,
            size: *size,
        });
        let view = frame.view();
        let (seen, moving) = self.call(py, |segmenter, execution| {
            let seen = with_view!(view, |frame| segmenter.update(
                frame,
                flow,
                counts.as_deref(),
                execution
            ))
            .map_err(|error| to_python(&error))?;
            let moving = gathered(MASKS, segmenter.moving().iter().map(|moves| *moves == 1))?;
            Ok((seen, moving))
        })?;
        let camera = seen.camera;
        Ok((
            owned(py, Ix2(height, width), moving)?,
            (
                camera.homography,
                camera.model.name(),
                camera.sigma_px,
                camera.explained,
            ),
            seen.parallax,
            (seen.light[0], seen.light[1], seen.noise),
        ))
    }

    /// The length of the motion that the camera's does not explain, and that motion where something moves.
    fn motion<'py>(&self, py: Python<'py>, least_px: f64) -> PyResult<Motion<'py>> {
        let ((width, height), length, motion) = self.call(py, |segmenter, execution| {
            let (width, height) = segmenter.frame_size();
            let mut length = zeros("lengths", width * height)?;
            let mut motion = zeros("a motion", 2 * width * height)?;
            segmenter
                .motion(least_px, &mut length, &mut motion, execution)
                .map_err(|error| to_python(&error))?;
            Ok(((width, height), length, motion))
        })?;
        Ok((
            owned(py, Ix2(height, width), length)?,
            owned(py, Ix3(height, width, 2), motion)?,
        ))
    }

    /// The still scene at the pixels of the last frame.
    fn scene<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let ((width, height), scene) = self.call(py, |segmenter, execution| {
            let (width, height) = segmenter.frame_size();
            let mut scene = zeros("a picture", width * height)?;
            segmenter
                .scene(&mut scene, execution)
                .map_err(|error| to_python(&error))?;
            Ok(((width, height), scene))
        })?;
        owned(py, Ix2(height, width), scene)
    }

    /// Forget all frames.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        if self.0.renew_if_lost()? {
            return Ok(());
        }
        self.call(py, |segmenter, _| {
            segmenter.reset().map_err(|error| to_python(&error))
        })
    }

    /// What is known, for `restore`.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let snapshot = self.call(py, |segmenter, _| Ok(segmenter.snapshot()))?;
        let state = PyDict::new(py);
        let SegmenterSnapshot {
            bytes,
            samples,
            floats,
            numbers,
            ..
        } = snapshot;
        state.set_item("bytes", owned(py, Ix1(bytes.len()), bytes)?)?;
        state.set_item("samples", owned(py, Ix1(samples.len()), samples)?)?;
        state.set_item("floats", owned(py, Ix1(floats.len()), floats)?)?;
        let count = numbers.len();
        state.set_item(
            "numbers",
            filled(py, MASKS, Ix1(count), numbers.into_iter())?,
        )?;
        Ok(state)
    }

    /// Take over what `state` gave, perhaps elsewhere.
    fn restore(&self, py: Python<'_>, state: &Bound<'_, PyDict>) -> PyResult<()> {
        let mut snapshot = SegmenterSnapshot::default();
        snapshot.bytes = elements::<u8, Ix1>(state, "bytes")?;
        snapshot.samples = elements::<i16, Ix1>(state, "samples")?;
        snapshot.floats = elements::<f32, Ix1>(state, "floats")?;
        snapshot.numbers = elements::<f64, Ix1>(state, "numbers")?;
        self.call(py, |segmenter, _| {
            segmenter
                .restore(&snapshot)
                .map_err(|error| to_python(&error))
        })
    }
}

impl PySegmenter {
    fn call<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut MotionSegmenter, &lk_core::Execution) -> PyResult<R> + Send,
    ) -> PyResult<R> {
        let caller = Caller::new();
        interrupt::run(py, 0, |execution| {
            self.0
                .with(caller, execution, |segmenter| work(segmenter, execution))
        })
    }
}

/// Add this file's names to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PySegmenter>()
}
