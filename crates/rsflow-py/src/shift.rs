//! `estimate_shift` for Python.

use lk_core::{Illumination, Masks, Roi, ShiftDeformation, ShiftOptions};
use ndarray::aview2;
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::errors::to_python;
use crate::frames::{AnyFrame, mask as borrow_mask, pair, with_pair};
use crate::interrupt;

/// A matrix for Python.
type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// dx, dy, the covariance, gain, offset, residual, status; the direction and its variance; the gradient and the joint
/// covariance.
type Fields<'py> = (
    (f64, f64, Matrix<'py>, f64, f64, f64, u8),
    ((f64, f64), f64),
    (Matrix<'py>, Matrix<'py>),
);

/// The displacement of a window; see `rsflow.estimate_shift`.
#[pyfunction]
#[allow(
    clippy::too_many_arguments,
    reason = "the arguments of the Python function"
)]
#[pyo3(signature = (prev, next, roi, mask, next_mask, illumination, deformation, max_displacement))]
pub(crate) fn estimate_shift<'py>(
    py: Python<'py>,
    prev: &Bound<'_, PyAny>,
    next: &Bound<'_, PyAny>,
    roi: Option<(usize, usize, usize, usize)>,
    mask: Option<&Bound<'_, PyAny>>,
    next_mask: Option<&Bound<'_, PyAny>>,
    illumination: &str,
    deformation: &str,
    max_displacement: Option<f64>,
) -> PyResult<Fields<'py>> {
    let prev = AnyFrame::new("prev", prev)?;
    let next = AnyFrame::new("next", next)?;
    let views = pair(&prev, &next)?;
    let mask = borrow_mask("mask", mask, prev.dim())?;
    let mask = mask.as_ref().map(PyReadonlyArray2::as_array);
    let next_mask = borrow_mask("next_mask", next_mask, prev.dim())?;
    let next_mask = next_mask.as_ref().map(PyReadonlyArray2::as_array);
    let mut options = ShiftOptions::default()
        .illumination(
            illumination
                .parse::<Illumination>()
                .map_err(|error| to_python(&error))?,
        )
        .deformation(
            deformation
                .parse::<ShiftDeformation>()
                .map_err(|error| to_python(&error))?,
        )
        .max_displacement(max_displacement);
    let (height, width) = prev.dim();
    let mut pixels = height * width;
    if let Some((x, y, width, height)) = roi {
        options = options.roi(Roi {
            x,
            y,
            width,
            height,
        });
        pixels = pixels.min(width.saturating_mul(height).saturating_mul(9));
    }
    let shift = with_pair!(views, |prev, next| interrupt::run(
        py,
        pixels,
        move |execution| lk_core::estimate_shift(
            prev,
            next,
            Masks::default().prev(mask).next(next_mask),
            &options.execution(execution.clone())
        )
    ))?;
    let [x, y] = shift.direction;
    Ok((
        (
            shift.dx,
            shift.dy,
            PyArray2::from_array(py, &aview2(&shift.covariance)),
            shift.gain,
            shift.offset,
            shift.residual,
            shift.status as u8,
        ),
        ((x, y), shift.direction_variance),
        (
            PyArray2::from_array(py, &aview2(&shift.gradient)),
            PyArray2::from_array(py, &aview2(&shift.joint_covariance)),
        ),
    ))
}

/// Every status: its name and value.
#[pyfunction]
pub(crate) fn shift_statuses() -> Vec<(&'static str, u8)> {
    lk_core::ShiftStatus::ALL
        .iter()
        .map(|status| (status.name(), *status as u8))
        .collect()
}
