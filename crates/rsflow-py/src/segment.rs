//! The motion of the camera in the picture, and parallax, for Python.

use lk_core::{CameraModel, CameraMotion, MotionVector, Parallax, find_parallax, fit_camera};
use numpy::ndarray::Array3;
use numpy::{PyArray3, PyReadonlyArray2, PyReadonlyArray3, ToPyArray};
use pyo3::prelude::*;

use crate::errors::raise;

/// Add this file's names to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(py_fit_camera, module)?)?;
    module.add_function(wrap_pyfunction!(py_find_parallax, module)?)?;
    module.add_function(wrap_pyfunction!(unexplained_motion, module)?)
}

type Homography = [[f64; 3]; 3];

/// A `Parallax`: epipole, sign, belief, depth, believed, seen, turned, travel.
type Belief = (
    [f64; 3],
    Option<f64>,
    f64,
    bool,
    bool,
    [f64; 2],
    [f64; 2],
    [f64; 3],
);

fn belief_of(parallax: &Parallax) -> Belief {
    let p = parallax;
    (
        p.epipole, p.sign, p.belief, p.depth, p.believed, p.seen, p.turned, p.travel,
    )
}

fn parallax_of(belief: Belief) -> Parallax {
    let (epipole, sign, belief, depth, believed, seen, turned, travel) = belief;
    Parallax {
        epipole,
        sign,
        belief,
        depth,
        believed,
        seen,
        turned,
        travel,
    }
}

/// Rows of x, y, u, v, covariance xx, xy, yy.
fn vectors_of(rows: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<MotionVector>> {
    let rows = rows.as_array();
    if rows.ncols() != 7 {
        let got = format!("vectors: got {} columns", rows.ncols());
        return Err(raise("ShapeError", format!("{got}, expected 7")));
    }
    let vector = |row: numpy::ndarray::ArrayView1<'_, f64>| MotionVector {
        x: row[0],
        y: row[1],
        u: row[2],
        v: row[3],
        covariance: [row[4], row[5], row[6]],
    };
    Ok(rows.rows().into_iter().map(vector).collect())
}

/// Homography, model, standard deviation and explained share of motion vectors; see `lk_core::fit_camera`.
#[pyfunction]
#[pyo3(name = "fit_camera")]
fn py_fit_camera(
    py: Python<'_>,
    vectors: PyReadonlyArray2<'_, f64>,
    before: Option<Homography>,
) -> PyResult<(Homography, &'static str, f64, f64)> {
    let vectors = vectors_of(&vectors)?;
    let fit = py.detach(|| fit_camera(&vectors, before.as_ref()));
    Ok((
        fit.homography,
        fit.model.name(),
        fit.sigma_px,
        fit.explained,
    ))
}

/// What is believed of parallax after another frame; see `lk_core::find_parallax`.
#[pyfunction]
#[pyo3(name = "find_parallax")]
fn py_find_parallax(
    py: Python<'_>,
    vectors: PyReadonlyArray2<'_, f64>,
    homography: Homography,
    sigma_px: f64,
    before: Option<Belief>,
) -> PyResult<Option<Belief>> {
    let vectors = vectors_of(&vectors)?;
    let camera = CameraMotion {
        homography,
        model: CameraModel::Homography,
        sigma_px,
        explained: 1.0,
    };
    let before = before.map(parallax_of);
    let found = py.detach(|| find_parallax(&vectors, &camera, before.as_ref()));
    Ok(found.as_ref().map(belief_of))
}

/// The part of a residual motion, (H, W, 2), that depth cannot explain.
#[pyfunction]
fn unexplained_motion<'py>(
    py: Python<'py>,
    residual: PyReadonlyArray3<'py, f32>,
    parallax: Belief,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let residual = residual.as_array();
    let (height, width, parts) = residual.dim();
    if parts != 2 {
        let got = format!("residual: got shape ({height}, {width}, {parts})");
        return Err(raise("ShapeError", format!("{got}, expected (H, W, 2)")));
    }
    let parallax = parallax_of(parallax);
    let out = py.detach(|| {
        let mut out = Array3::zeros((height, width, 2));
        for (y, (from, mut to)) in residual.outer_iter().zip(out.outer_iter_mut()).enumerate() {
            for (x, (from, mut to)) in from.outer_iter().zip(to.outer_iter_mut()).enumerate() {
                let motion = [f64::from(from[0]), f64::from(from[1])];
                let left = parallax.unexplained([x as f64, y as f64], motion);
                (to[0], to[1]) = (left[0] as f32, left[1] as f32);
            }
        }
        out
    });
    Ok(out.to_pyarray(py))
}
