//! Dense flow for Python.

use std::sync::{Mutex, PoisonError};

use lk_core::{DenseHints, DenseOptions, FlowField, Frame, Pixel};
use ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::errors::{raise, to_python};
use crate::frames::{AnyFrame, described, mask, pair};
use crate::interrupt::run;
use crate::with_pair;

/// uv, valid, residual, gain and offset on a coarse grid, and how many times that grid is halved.
type Parts<'py> = (
    Bound<'py, PyArray3<f32>>,
    Bound<'py, PyArray2<bool>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    usize,
);

/// Dense flow of pairs, or from frame to frame.
#[pyclass(frozen, module = "rsflow._core")]
pub(crate) struct DenseFlow(Mutex<lk_core::DenseFlow>);

#[pymethods]
impl DenseFlow {
    #[new]
    #[pyo3(signature = (preset, illumination, max_displacement))]
    fn new(preset: &str, illumination: &str, max_displacement: Option<f32>) -> PyResult<Self> {
        let options = || -> lk_core::Result<DenseOptions> {
            Ok(DenseOptions::default()
                .preset(preset.parse()?)
                .illumination(illumination.parse()?)
                .max_displacement(max_displacement))
        };
        let flow = options().and_then(lk_core::DenseFlow::new);
        Ok(Self(Mutex::new(flow.map_err(|error| to_python(&error))?)))
    }

    /// The flow from `prev` to `next`.
    #[pyo3(signature = (prev, next, initial, region))]
    fn pair<'py>(
        &self,
        py: Python<'py>,
        prev: &Bound<'py, PyAny>,
        next: &Bound<'py, PyAny>,
        initial: Option<&Bound<'py, PyAny>>,
        region: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Parts<'py>> {
        let (prev, next) = (AnyFrame::new("prev", prev)?, AnyFrame::new("next", next)?);
        let (initial, region) = (initial_flow(initial)?, mask(region, prev.dim())?);
        let hints = DenseHints {
            initial: initial.as_ref().map(PyReadonlyArray3::as_array),
            mask: region.as_ref().map(PyReadonlyArray2::as_array),
        };
        let pixels = prev.dim().0 * prev.dim().1;
        let field = with_pair!(pair(&prev, &next)?, |prev, next| run(
            py,
            pixels,
            |execution| {
                let mut flow = self.0.lock().unwrap_or_else(PoisonError::into_inner);
                flow.set_execution(execution.clone());
                let mut field = FlowField::default();
                flow.pair(prev, next, hints, &mut field)?;
                Ok(field)
            }
        ))?;
        parts(py, field)
    }

    /// The flow from the frame before to `frame`; None for the first one.
    #[pyo3(signature = (frame, initial, region))]
    fn update<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        initial: Option<&Bound<'py, PyAny>>,
        region: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Option<Parts<'py>>> {
        let frame = AnyFrame::new("frame", frame)?;
        let (initial, region) = (initial_flow(initial)?, mask(region, frame.dim())?);
        let hints = DenseHints {
            initial: initial.as_ref().map(PyReadonlyArray3::as_array),
            mask: region.as_ref().map(PyReadonlyArray2::as_array),
        };
        let field = match &frame {
            AnyFrame::U8(frame) => self.advance(py, frame.as_array(), hints)?,
            AnyFrame::U16(frame) => self.advance(py, frame.as_array(), hints)?,
            AnyFrame::F32(frame) => self.advance(py, frame.as_array(), hints)?,
        };
        field.map(|field| parts(py, field)).transpose()
    }

    /// Forget the frame before.
    fn reset(&self) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .reset();
    }
}

impl DenseFlow {
    fn advance<T: Pixel>(
        &self,
        py: Python<'_>,
        frame: Frame<'_, T>,
        hints: DenseHints<'_>,
    ) -> PyResult<Option<FlowField>> {
        run(py, frame.len(), |execution| {
            let mut flow = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            flow.set_execution(execution.clone());
            let mut field = FlowField::default();
            Ok(flow.update(frame, hints, &mut field)?.then_some(field))
        })
    }
}

/// Borrow the argument `initial`; its size is checked by lk-core.
fn initial_flow<'py>(
    value: Option<&Bound<'py, PyAny>>,
) -> PyResult<Option<PyReadonlyArray3<'py, f32>>> {
    let Some(value) = value else { return Ok(None) };
    let array = value.extract::<PyReadonlyArray3<'py, f32>>().map_err(|_| {
        let got = described(value);
        raise(
            "DTypeError",
            format!("initial: got {got}, expected a float32 array (height, width, 2)"),
        )
    })?;
    Ok(Some(array))
}

fn parts(py: Python<'_>, field: FlowField) -> PyResult<Parts<'_>> {
    let (height, width) = (field.height(), field.width());
    let (gain, offset, halvings) = field.light();
    let light = |plane: &lk_core::Plane| {
        Array2::from_shape_vec((plane.height(), plane.width()), plane.data().to_vec())
    };
    let (gain, offset) = (light(gain), light(offset));
    let (uv, valid, residual) = field.into_vectors();
    let broken =
        |error: ndarray::ShapeError| pyo3::exceptions::PyRuntimeError::new_err(error.to_string());
    Ok((
        Array3::from_shape_vec((height, width, 2), uv)
            .map_err(broken)?
            .into_pyarray(py),
        Array2::from_shape_vec((height, width), valid)
            .map_err(broken)?
            .into_pyarray(py),
        Array2::from_shape_vec((height, width), residual)
            .map_err(broken)?
            .into_pyarray(py),
        gain.map_err(broken)?.into_pyarray(py),
        offset.map_err(broken)?.into_pyarray(py),
        halvings,
    ))
}
