//! Dense flow for Python.

use lk_core::{DenseHints, DenseOptions, DenseSnapshot, FlowField};
use ndarray::{Ix2, Ix3, Ix4};
use numpy::{PyArray2, PyArray3, PyArray4, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{raise, to_python};
use crate::frames::{
    AnyFrame, aligned, described, mask as borrow_mask, pair, with_pair, with_view,
};
use crate::interrupt::run;
use crate::outputs::owned;
use crate::shared::{Caller, Shared};
use crate::states::{array_plane, entry, item, plane_array};

/// uv, valid, residual, gain and offset on a coarse grid, how many times that grid is halved, and the covariance if it was
/// asked for.
type Parts<'py> = (
    Bound<'py, PyArray3<f32>>,
    Bound<'py, PyArray2<bool>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    usize,
    Option<Bound<'py, PyArray4<f32>>>,
);

/// Dense flow of pairs, or from frame to frame.
#[pyclass(frozen, module = "rsflow._core")]
pub(crate) struct DenseFlow(Shared<lk_core::DenseFlow>);

#[pymethods]
impl DenseFlow {
    #[new]
    #[pyo3(signature = (preset, illumination, max_displacement, covariance))]
    fn new(
        preset: &str,
        illumination: &str,
        max_displacement: Option<f32>,
        covariance: bool,
    ) -> PyResult<Self> {
        let options = || -> lk_core::Result<DenseOptions> {
            Ok(DenseOptions::default()
                .preset(preset.parse()?)
                .illumination(illumination.parse()?)
                .max_displacement(max_displacement)
                .covariance(covariance))
        };
        let options = options().map_err(|error| to_python(&error))?;
        let fresh =
            move || lk_core::DenseFlow::new(options.clone()).map_err(|error| to_python(&error));
        let mend = |flow: &mut lk_core::DenseFlow| flow.forget();
        Ok(Self(Shared::new(fresh, mend)?))
    }

    /// The flow from `prev` to `next`.
    #[pyo3(signature = (prev, next, initial, mask, next_mask))]
    fn pair<'py>(
        &self,
        py: Python<'py>,
        prev: &Bound<'py, PyAny>,
        next: &Bound<'py, PyAny>,
        initial: Option<&Bound<'py, PyAny>>,
        mask: Option<&Bound<'py, PyAny>>,
        next_mask: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Parts<'py>> {
        let (prev, next) = (AnyFrame::new("prev", prev)?, AnyFrame::new("next", next)?);
        let (initial, counted) = (
            initial_flow(initial)?,
            borrow_mask("mask", mask, prev.dim())?,
        );
        let counted_next = borrow_mask("next_mask", next_mask, prev.dim())?;
        let hints = DenseHints::default()
            .initial(initial.as_ref().map(PyReadonlyArray3::as_array))
            .mask(counted.as_ref().map(PyReadonlyArray2::as_array))
            .next_mask(counted_next.as_ref().map(PyReadonlyArray2::as_array));
        let pixels = prev.pixels();
        let field = with_pair!(pair(&prev, &next)?, |prev, next| self.call(
            py,
            pixels,
            |flow| {
                let mut field = FlowField::default();
                flow.pair(prev, next, hints, &mut field)?;
                Ok(field)
            }
        ))?;
        parts(py, field)
    }

    /// The flow from the frame before to `frame`; None for the first one.
    #[pyo3(signature = (frame, initial, mask, next_mask))]
    fn update<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        initial: Option<&Bound<'py, PyAny>>,
        mask: Option<&Bound<'py, PyAny>>,
        next_mask: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Option<Parts<'py>>> {
        let frame = AnyFrame::new("frame", frame)?;
        let (initial, counted) = (
            initial_flow(initial)?,
            borrow_mask("mask", mask, frame.dim())?,
        );
        let counted_next = borrow_mask("next_mask", next_mask, frame.dim())?;
        let hints = DenseHints::default()
            .initial(initial.as_ref().map(PyReadonlyArray3::as_array))
            .mask(counted.as_ref().map(PyReadonlyArray2::as_array))
            .next_mask(counted_next.as_ref().map(PyReadonlyArray2::as_array));
        let pixels = frame.pixels();
        let field = with_view!(frame.view(), |frame| self.call(py, pixels, |flow| {
            let mut field = FlowField::default();
            Ok(flow.update(frame, hints, &mut field)?.then_some(field))
        }))?;
        field.map(|field| parts(py, field)).transpose()
    }

    /// Forget the frame before.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        if self.0.renew_if_lost()? {
            return Ok(());
        }
        self.call(py, 0, |flow| {
            flow.reset();
            Ok(())
        })
    }

    /// What is known of the frame before, for `restore`; None before the first one.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(snapshot) = self.call(py, 0, |flow| flow.snapshot())? else {
            return Ok(None);
        };
        let state = PyDict::new(py);
        state.set_item("frame", plane_array(py, &snapshot.frame)?)?;
        state.set_item("counts", plane_array(py, &snapshot.counts)?)?;
        state.set_item("raw", plane_array(py, &snapshot.raw)?)?;
        state.set_item("scale", snapshot.scale)?;
        let extremes = snapshot.extremes.map(|[low, high]| (low, high));
        state.set_item("extremes", extremes)?;
        state.set_item("all_finite", snapshot.all_finite)?;
        Ok(Some(state))
    }

    /// Take over what `state` gave, perhaps elsewhere.
    fn restore(&self, py: Python<'_>, state: Option<&Bound<'_, PyDict>>) -> PyResult<()> {
        let snapshot = state.map(snapshot_of).transpose()?;
        self.call(py, 0, |flow| flow.restore(snapshot.as_ref()))
    }
}

impl DenseFlow {
    /// Call `work` with the estimator, which runs as the call does.
    fn call<R: Send>(
        &self,
        py: Python<'_>,
        pixels: usize,
        work: impl FnOnce(&mut lk_core::DenseFlow) -> lk_core::Result<R> + Send,
    ) -> PyResult<R> {
        let caller = Caller::new();
        run(py, pixels, |execution| {
            self.0.with(caller, execution, |flow| {
                flow.set_execution(execution.clone());
                work(flow).map_err(|error| to_python(&error))
            })
        })
    }
}

/// What [`DenseFlow::state`] gave.
fn snapshot_of(state: &Bound<'_, PyDict>) -> PyResult<DenseSnapshot> {
    let mut snapshot = DenseSnapshot::default();
    snapshot.frame = array_plane("frame", &item(state, "frame")?)?;
    snapshot.counts = array_plane("counts", &item(state, "counts")?)?;
    snapshot.raw = array_plane("raw", &item(state, "raw")?)?;
    snapshot.scale = entry(state, "scale")?;
    let extremes: Option<(f32, f32)> = entry(state, "extremes")?;
    snapshot.extremes = extremes.map(|(low, high)| [low, high]);
    snapshot.all_finite = entry(state, "all_finite")?;
    Ok(snapshot)
}

/// Borrow the argument `initial`; its size is checked by lk-core.
fn initial_flow<'py>(
    value: Option<&Bound<'py, PyAny>>,
) -> PyResult<Option<PyReadonlyArray3<'py, f32>>> {
    let Some(value) = value else { return Ok(None) };
    let unfit = || {
        let got = described(value);
        raise(
            "DTypeError",
            format!("initial: got {got}, expected a float32 array (height, width, 2)"),
        )
    };
    value.cast::<PyUntypedArray>().map_err(|_| unfit())?;
    let array = aligned(value)?.extract::<PyReadonlyArray3<'py, f32>>();
    Ok(Some(array.map_err(|_| unfit())?))
}

fn parts(py: Python<'_>, mut field: FlowField) -> PyResult<Parts<'_>> {
    let size = (field.height(), field.width());
    let (gain, offset, halvings) = field.light();
    let (gain, offset) = (plane_array(py, gain)?, plane_array(py, offset)?);
    let covariance = match field.covariance() {
        Some(_) => {
            let covariance = field.take_covariance();
            Some(owned(py, Ix4(size.0, size.1, 2, 2), covariance)?)
        }
        None => None,
    };
    let (uv, valid, residual) = field.into_vectors();
    Ok((
        owned(py, Ix3(size.0, size.1, 2), uv)?,
        owned(py, Ix2(size.0, size.1), valid)?,
        owned(py, Ix2(size.0, size.1), residual)?,
        gain,
        offset,
        halvings,
        covariance,
    ))
}
