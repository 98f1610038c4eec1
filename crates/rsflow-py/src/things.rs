//! The regions of a mask and the things that are followed by their pictures, for Python.

use lk_core::{
    Error, Frame, Pixel, REGION_BINS, REGION_SAMPLES, RIDE_STARTS, Riders, SAMPLE_PARTS,
    SeenBeside, SeenRegions, see_regions,
};
use numpy::ndarray::{ArrayView2, Ix1, Ix2, Ix3};
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::frames::{AnyFrame, AnyView, with_view};
use crate::interrupt;
use crate::outputs::{filled, gathered, owned};

/// What memory for regions and things holds.
const THINGS: &str = "things";

/// Add this file's names to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(observe_regions, module)?)?;
    module.add_function(wrap_pyfunction!(ride, module)?)
}

/// Labels; box, area and centre of each region; motion and its variance; shares of grey levels; which samples are inside;
/// samples of the picture.
type Observed<'py> = (
    Bound<'py, PyArray2<i32>>,
    (
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray2<f64>>,
    ),
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>),
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f32>>,
);

/// The regions of a mask with at least `least` pixels.
#[pyfunction]
fn observe_regions<'py>(
    py: Python<'py>,
    mask: PyReadonlyArray2<'py, bool>,
    least: usize,
    motion: Option<PyReadonlyArray3<'py, f32>>,
    image: Option<&Bound<'py, PyAny>>,
    levels: Option<&Bound<'py, PyAny>>,
) -> PyResult<Observed<'py>> {
    let image = image
        .map(|image| AnyFrame::new("image", image))
        .transpose()?;
    let levels = levels
        .map(|levels| AnyFrame::new("levels", levels))
        .transpose()?;
    let owned_motion = match &motion {
        Some(motion) if motion.as_slice().is_err() => {
            Some(gathered(THINGS, motion.as_array().iter().copied())?)
        }
        _ => None,
    };
    let motion = match (&motion, &owned_motion) {
        (_, Some(motion)) => Some(&motion[..]),
        (Some(motion), None) => motion.as_slice().ok(),
        (None, None) => None,
    };
    let view = mask.as_array();
    let (height, width) = view.dim();
    let frame = image.as_ref().map(AnyFrame::view);
    let levels = levels.as_ref().map(AnyFrame::view);
    let seen = interrupt::run(py, 0, |_| match frame {
        Some(frame) => with_view!(frame, |frame| observed(
            view,
            least,
            motion,
            Some(frame),
            levels
        )),
        None => observed::<u8>(view, least, motion, None, levels),
    })?;
    told(py, Ix2(height, width), seen)
}

fn told(py: Python<'_>, shape: Ix2, seen: SeenRegions) -> PyResult<Observed<'_>> {
    let regions = seen.regions;
    let count = regions.len();
    let of_two = |pick: fn(&lk_core::SeenRegion) -> [f64; 2]| {
        filled(py, THINGS, Ix2(count, 2), regions.iter().flat_map(pick))
    };
    let boxes = regions
        .iter()
        .flat_map(|region| region.bounds)
        .map(|edge| edge as f64);
    let pictures = regions
        .iter()
        .flat_map(|region| region.picture.as_flattened())
        .copied();
    Ok((
        owned(py, shape, seen.labels)?,
        (
            filled(py, THINGS, Ix2(count, 4), boxes)?,
            filled(
                py,
                THINGS,
                Ix1(count),
                regions.iter().map(|region| region.area as f64),
            )?,
            of_two(|region| region.centre)?,
        ),
        (
            of_two(|region| region.motion)?,
            of_two(|region| region.variance)?,
        ),
        filled(
            py,
            THINGS,
            Ix2(count, REGION_BINS),
            regions.iter().flat_map(|region| region.shares),
        )?,
        filled(
            py,
            THINGS,
            Ix3(count, REGION_SAMPLES, SAMPLE_PARTS),
            pictures,
        )?,
    ))
}

fn observed<T: Pixel>(
    mask: ArrayView2<'_, bool>,
    least: usize,
    motion: Option<&[f32]>,
    image: Option<Frame<'_, T>>,
    levels: Option<AnyView<'_>>,
) -> Result<SeenRegions, Error> {
    let beside = SeenBeside { motion, image };
    match levels {
        Some(levels) => with_view!(levels, |levels| see_regions(
            mask,
            least,
            beside,
            Some(levels)
        )),
        None => see_regions::<T, u8>(mask, least, beside, None),
    }
}

/// Motion and its variance, and contrast, of each thing.
type Ridden<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// How far each thing went by its own picture.
#[pyfunction]
fn ride<'py>(
    py: Python<'py>,
    pictures: PyReadonlyArray3<'py, f32>,
    starts: PyReadonlyArray3<'py, f64>,
    sizes: PyReadonlyArray1<'py, f64>,
    levels: &Bound<'py, PyAny>,
    mask: PyReadonlyArray2<'py, bool>,
) -> PyResult<Ridden<'py>> {
    let levels = AnyFrame::new("levels", levels)?;
    let pictures = gathered(THINGS, pictures.as_array().iter().copied())?;
    let starts = gathered(THINGS, starts.as_array().iter().copied())?;
    let sizes = gathered(THINGS, sizes.as_array().iter().copied())?;
    let mask = mask.as_array();
    let view = levels.view();
    let ridden = interrupt::run(py, 0, |_| {
        let riders = Riders {
            pictures: &pictures,
            starts: starts.as_chunks::<2>().0.as_chunks::<RIDE_STARTS>().0,
            sizes: &sizes,
        };
        with_view!(view, |levels| lk_core::ride(riders, levels, mask))
    })?;
    let count = ridden.len();
    let motion = ridden.iter().flat_map(|thing| thing.motion);
    let variance = ridden.iter().flat_map(|thing| thing.variance);
    Ok((
        filled(py, THINGS, Ix2(count, 2), motion)?,
        filled(py, THINGS, Ix2(count, 2), variance)?,
        filled(
            py,
            THINGS,
            Ix1(count),
            ridden.iter().map(|thing| thing.contrast),
        )?,
    ))
}
