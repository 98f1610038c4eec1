//! Frames and masks from numpy: borrowed where the layout allows, with errors that tell the fix.

use lk_core::Frame;
use numpy::{PyArrayDescrMethods, PyReadonlyArray2, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::raise;

/// A frame of one of the supported pixel types, borrowed from numpy.
pub(crate) enum AnyFrame<'py> {
    U8(PyReadonlyArray2<'py, u8>),
    U16(PyReadonlyArray2<'py, u16>),
    F32(PyReadonlyArray2<'py, f32>),
}

/// The view of one frame.
pub(crate) enum AnyView<'a> {
    U8(Frame<'a, u8>),
    U16(Frame<'a, u16>),
    F32(Frame<'a, f32>),
}

/// Call `$body` with `$frame` bound to the view, whatever its pixel type.
macro_rules! with_view {
    ($view:expr, |$frame:ident| $body:expr) => {
        match $view {
            $crate::frames::AnyView::U8($frame) => $body,
            $crate::frames::AnyView::U16($frame) => $body,
            $crate::frames::AnyView::F32($frame) => $body,
        }
    };
}
pub(crate) use with_view;

/// The views of two frames of the same pixel type.
pub(crate) enum PairViews<'a> {
    U8(Frame<'a, u8>, Frame<'a, u8>),
    U16(Frame<'a, u16>, Frame<'a, u16>),
    F32(Frame<'a, f32>, Frame<'a, f32>),
}

/// Call `$body` with `$prev` and `$next` bound to the views, whatever their pixel type.
macro_rules! with_pair {
    ($views:expr, |$prev:ident, $next:ident| $body:expr) => {
        match $views {
            $crate::frames::PairViews::U8($prev, $next) => $body,
            $crate::frames::PairViews::U16($prev, $next) => $body,
            $crate::frames::PairViews::F32($prev, $next) => $body,
        }
    };
}
pub(crate) use with_pair;

impl<'py> AnyFrame<'py> {
    /// Borrow the argument `name`.
    pub(crate) fn new(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Self> {
        let array = value.cast::<PyUntypedArray>().map_err(|_| {
            raise(
                "DTypeError",
                format!(
                    "{name}: got {}, expected a numpy array (height, width) of uint8, uint16 or float32",
                    value.get_type().name().map_or_else(|_| "an object".into(), |name| name.to_string())
                ),
            )
        })?;
        let shape = array.shape();
        if shape.len() == 3 && (shape[2] == 3 || shape[2] == 4) {
            return Err(raise(
                "ShapeError",
                format!(
                    "{name}: got colour, shape {}, expected grey (height, width): \
                     convert it with cv2.cvtColor({name}, cv2.COLOR_BGR2GRAY), or read it with rsflow.frames",
                    shape_text(shape)
                ),
            ));
        }
        if shape.len() != 2 {
            return Err(raise(
                "ShapeError",
                format!(
                    "{name}: got {} dimensions, shape {}, expected 2: (height, width)",
                    shape.len(),
                    shape_text(shape)
                ),
            ));
        }
        let value = &aligned(value)?;
        if let Ok(frame) = value.extract::<PyReadonlyArray2<'py, u8>>() {
            return Ok(Self::U8(frame));
        }
        if let Ok(frame) = value.extract::<PyReadonlyArray2<'py, u16>>() {
            return Ok(Self::U16(frame));
        }
        if let Ok(frame) = value.extract::<PyReadonlyArray2<'py, f32>>() {
            return Ok(Self::F32(frame));
        }
        let dtype = array.dtype();
        let fix = match dtype.kind() {
            b'f' | b'i' | b'u' | b'b' => format!("convert it with {name}.astype(numpy.float32)"),
            _ => "rsflow never rescales or converts silently".to_owned(),
        };
        Err(raise(
            "DTypeError",
            format!("{name}: got dtype {dtype}, expected uint8, uint16 or float32: {fix}"),
        ))
    }

    fn dtype_name(&self) -> &'static str {
        match self {
            Self::U8(_) => "uint8",
            Self::U16(_) => "uint16",
            Self::F32(_) => "float32",
        }
    }

    /// The view, which can leave the GIL.
    pub(crate) fn view(&self) -> AnyView<'_> {
        match self {
            Self::U8(frame) => AnyView::U8(frame.as_array()),
            Self::U16(frame) => AnyView::U16(frame.as_array()),
            Self::F32(frame) => AnyView::F32(frame.as_array()),
        }
    }

    /// How many pixels; numpy's arrays of repeated elements may have more than memory holds.
    pub(crate) fn pixels(&self) -> usize {
        let (height, width) = self.dim();
        height.saturating_mul(width)
    }

    /// Height and width.
    pub(crate) fn dim(&self) -> (usize, usize) {
        match self {
            Self::U8(frame) => frame.as_array().dim(),
            Self::U16(frame) => frame.as_array().dim(),
            Self::F32(frame) => frame.as_array().dim(),
        }
    }
}

/// The views of `prev` and `next`, which must agree in type; sizes are checked by lk-core.
pub(crate) fn pair<'a>(prev: &'a AnyFrame<'_>, next: &'a AnyFrame<'_>) -> PyResult<PairViews<'a>> {
    match (prev, next) {
        (AnyFrame::U8(prev), AnyFrame::U8(next)) => {
            Ok(PairViews::U8(prev.as_array(), next.as_array()))
        }
        (AnyFrame::U16(prev), AnyFrame::U16(next)) => {
            Ok(PairViews::U16(prev.as_array(), next.as_array()))
        }
        (AnyFrame::F32(prev), AnyFrame::F32(next)) => {
            Ok(PairViews::F32(prev.as_array(), next.as_array()))
        }
        _ => Err(raise(
            "DTypeError",
            format!(
                "next: got dtype {}, expected that of prev, {}",
                next.dtype_name(),
                prev.dtype_name()
            ),
        )),
    }
}

/// The array, or a copy of it where its elements do not stand at multiples of their size, as those of a field among
/// others of a structure: what is borrowed is read in whole elements.
pub(crate) fn aligned<'py>(array: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    if array.getattr("flags")?.getattr("aligned")?.is_truthy()? {
        return Ok(array.clone());
    }
    array.call_method0("copy")
}

/// What a message says of an object: the type and shape of an array, the type of anything else.
pub(crate) fn described(value: &Bound<'_, PyAny>) -> String {
    value.cast::<PyUntypedArray>().map_or_else(
        |_| {
            value
                .get_type()
                .name()
                .map_or_else(|_| "an object".to_owned(), |name| name.to_string())
        },
        |array| {
            format!(
                "dtype {}, shape {}",
                array.dtype(),
                shape_text(array.shape())
            )
        },
    )
}

/// Borrow the boolean mask `name` of the size `expected` (height, width).
pub(crate) fn mask<'py>(
    name: &str,
    value: Option<&Bound<'py, PyAny>>,
    expected: (usize, usize),
) -> PyResult<Option<PyReadonlyArray2<'py, bool>>> {
    let Some(value) = value.filter(|value| !value.is_none()) else {
        return Ok(None);
    };
    let array = value
        .extract::<PyReadonlyArray2<'py, bool>>()
        .map_err(|_| {
            let got = described(value);
            raise(
                "DTypeError",
                format!(
                    "{name}: got {got}, expected a bool array (height, width), True where to measure; of a picture \
                     of numbers {name} != 0"
                ),
            )
        })?;
    let found = array.as_array().dim();
    if found != expected {
        return Err(raise(
            "ShapeError",
            format!("{name}: got shape {found:?}, expected that of the frames, {expected:?}"),
        ));
    }
    Ok(Some(array))
}

fn shape_text(shape: &[usize]) -> String {
    let sizes: Vec<String> = shape.iter().map(ToString::to_string).collect();
    match sizes.len() {
        1 => format!("({},)", sizes[0]),
        _ => format!("({})", sizes.join(", ")),
    }
}
