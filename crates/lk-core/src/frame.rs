//! Frames: pixel types, views that borrow the caller's memory, and planes of `f32` rows.

use ndarray::{ArrayView2, ShapeBuilder};

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory::{resize, zeros};
use crate::parallel::{RowsMut, even_bands, for_each_band};

mod sealed {
    pub trait Sealed {}
    impl Sealed for u8 {}
    impl Sealed for u16 {}
    impl Sealed for f32 {}
}

/// A grey level: `u8`, `u16` or `f32`, never rescaled.
pub trait Pixel: Copy + PartialOrd + Send + Sync + sealed::Sealed + 'static {
    /// Variance of what rounding to this type adds, in square grey levels; 0 for floating point.
    const ROUNDING: f64;

    /// The grey level as `f32`; exact for every supported type.
    fn to_f32(self) -> f32;

    /// Bits of a grey level; `None` for floats.
    #[doc(hidden)]
    const DEPTH: Option<u32>;
}

impl Pixel for u8 {
    const ROUNDING: f64 = 1.0 / 12.0;
    const DEPTH: Option<u32> = Some(8);

    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }
}

impl Pixel for u16 {
    const ROUNDING: f64 = 1.0 / 12.0;
    const DEPTH: Option<u32> = Some(16);

    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }
}

impl Pixel for f32 {
    const ROUNDING: f64 = 0.0;
    const DEPTH: Option<u32> = None;

    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
}

/// A borrowed frame, `(height, width)`, with any strides.
pub type Frame<'a, T> = ArrayView2<'a, T>;

/// A frame of `width` by `height` pixels in memory that is not of ndarray: its rows begin `stride` elements apart.
///
/// # Errors
///
/// [`Error::Shape`] if the stride is less than the width, or `data` ends before the last row does.
///
/// ```
/// use lk_core::frame_from_slice;
///
/// // Rows of 3 pixels, each with a byte of padding.
/// let data = [1u8, 2, 3, 0, 4, 5, 6, 0];
/// let frame = frame_from_slice(&data, 3, 2, 4)?;
/// assert_eq!((frame.dim(), frame[(1, 2)]), ((2, 3), 6));
/// assert!(frame_from_slice(&data, 3, 3, 4).is_err());
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn frame_from_slice<T: Pixel>(
    data: &[T],
    width: usize,
    height: usize,
    stride: usize,
) -> Result<Frame<'_, T>> {
    if stride < width {
        return Err(Error::shape(
            "stride",
            stride.to_string(),
            format!("at least the width, {width}"),
        ));
    }
    ArrayView2::from_shape((height, width).strides((stride, 1)), data).map_err(|_| {
        Error::shape(
            "data",
            format!("{} elements", data.len()),
            format!("those of {height} rows of {width}, {stride} apart"),
        )
    })
}

/// Grey levels as `f32`, in rows without gaps.
#[derive(Debug, Default, PartialEq)]
pub struct Plane {
    width: usize,
    height: usize,
    data: Vec<f32>,
}

impl Clone for Plane {
    fn clone(&self) -> Self {
        Self {
            data: self.data.clone(),
            ..*self
        }
    }

    /// Keeps the memory.
    fn clone_from(&mut self, source: &Self) {
        (self.width, self.height) = (source.width, source.height);
        self.data.clone_from(&source.data);
    }
}

impl Plane {
    /// A plane of zeros.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] for more than 2^31 - 1 pixels, [`Error::Memory`].
    ///
    /// ```
    /// use lk_core::{Error, Plane};
    ///
    /// assert_eq!(Plane::new(3, 2)?.data(), [0.0; 6]);
    /// assert!(matches!(Plane::new(usize::MAX, 2), Err(Error::Shape { .. })));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn new(width: usize, height: usize) -> Result<Self> {
        let pixels = pixels_of("a plane", (height, width))?;
        Ok(Self {
            width,
            height,
            data: zeros(GREYS, pixels)?,
        })
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All rows, one after the other.
    #[must_use]
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// All rows, to write.
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// Row `y`.
    ///
    /// # Panics
    ///
    /// Panics if `y` is not below the height.
    #[must_use]
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// Row `y`, to write.
    ///
    /// # Panics
    ///
    /// Panics if `y` is not below the height.
    #[inline(always)]
    pub fn row_mut(&mut self, y: usize) -> &mut [f32] {
        &mut self.data[y * self.width..(y + 1) * self.width]
    }

    /// Take a new size and keep the memory; the content is unspecified afterwards.
    ///
    /// # Errors
    ///
    /// Those of [`Plane::new`]; the plane is then as it was.
    pub fn resize(&mut self, width: usize, height: usize) -> Result<()> {
        let pixels = pixels_of("a plane", (height, width))?;
        if self.data.capacity() == 0 {
            self.data = zeros(GREYS, pixels)?;
        } else {
            resize(GREYS, &mut self.data, pixels, 0.0)?;
        }
        (self.width, self.height) = (width, height);
        Ok(())
    }

    /// Take size and content of `source`, and keep the memory.
    pub(crate) fn copy_of(&mut self, source: &Self) -> Result<()> {
        self.resize(source.width, source.height)?;
        self.data.copy_from_slice(&source.data);
        Ok(())
    }

    /// All rows, to divide between threads.
    pub(crate) fn rows_mut(&mut self) -> RowsMut<'_, f32> {
        RowsMut::new(&mut self.data, self.width.max(1))
    }

    /// Take size and content of `frame`, and keep the memory.
    ///
    /// # Errors
    ///
    /// Those of [`Plane::new`] and of the execution: cancelled, no threads.
    pub fn copy_from<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        execution: &Execution,
    ) -> Result<()> {
        self.copy_scaled(frame, 1.0, execution)
    }

    /// [`Plane::copy_from`], with every grey level times `scale`.
    pub(crate) fn copy_scaled<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        scale: f32,
        execution: &Execution,
    ) -> Result<()> {
        let (height, width) = frame.dim();
        self.resize(width, height)?;
        if width == 0 || height == 0 {
            return Ok(());
        }
        let min_rows = even_bands(execution, height, [65_536 / width, 32_768 / width]);
        for_each_band(
            execution,
            height,
            min_rows,
            self.rows_mut(),
            |rows, mut part| {
                for (local, y) in rows.enumerate() {
                    let row = part.row_mut(local);
                    read_row(frame, y, row);
                    scale_by(row, scale);
                }
            },
        )
    }
}

/// What planes hold.
const GREYS: &str = "grey levels";

/// Pixels of one frame that places in it are counted by.
const MOST_PIXELS: usize = i32::MAX as usize;

/// The pixels of `what`, of these (rows, columns).
///
/// # Errors
///
/// [`Error::Shape`] for more than [`MOST_PIXELS`], along one side or in all.
pub(crate) fn pixels_of(what: &'static str, (rows, columns): (usize, usize)) -> Result<usize> {
    rows.checked_mul(columns)
        .filter(|pixels| (*pixels).max(rows).max(columns) <= MOST_PIXELS)
        .ok_or_else(|| {
            Error::shape(
                what,
                format!("({rows}, {columns})"),
                "at most 2147483647 pixels",
            )
        })
}

/// Hold the (rows, columns) of the argument `what` to those of what it goes with, which `of` names.
///
/// # Errors
///
/// [`Error::Shape`] if they differ.
pub(crate) fn expect_size(
    what: &'static str,
    got: (usize, usize),
    of: &str,
    expected: (usize, usize),
) -> Result<()> {
    if got == expected {
        return Ok(());
    }
    Err(Error::shape(
        what,
        format!("{got:?}"),
        format!("the shape of {of}, {expected:?}"),
    ))
}

/// Multiply by `scale`; 1 touches nothing.
pub(crate) fn scale_by(values: &mut [f32], scale: f32) {
    if scale != 1.0 {
        for value in values {
            *value *= scale;
        }
    }
}

/// Write row `y` of `frame` as `f32` into `row`, which has the frame's width.
pub(crate) fn read_row<T: Pixel>(frame: Frame<'_, T>, y: usize, row: &mut [f32]) {
    let source = frame.row(y);
    if let Some(slice) = source.as_slice() {
        for (to, from) in row.iter_mut().zip(slice) {
            *to = from.to_f32();
        }
    } else {
        for (to, from) in row.iter_mut().zip(source) {
            *to = from.to_f32();
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, s};

    use super::*;

    #[test]
    fn any_stride_is_read_alike() {
        let frame = Array2::from_shape_fn((9, 14), |(y, x)| u16::try_from(y * 100 + x).unwrap());
        let execution = Execution::default();
        for view in [
            frame.view(),
            frame.slice(s![1..8;2, 3..11]),
            frame.slice(s![..;-1, ..;-1]),
            frame.t(),
        ] {
            let mut plane = Plane::default();
            plane.copy_from(view, &execution).unwrap();
            assert_eq!((plane.height(), plane.width()), view.dim());
            for ((y, x), value) in view.indexed_iter() {
                assert_eq!(plane.row(y)[x], f32::from(*value));
            }
        }
    }

    #[test]
    fn an_empty_frame_is_an_empty_plane() {
        for shape in [(0, 0), (0, 5), (5, 0)] {
            let mut plane = Plane::new(3, 3).unwrap();
            plane
                .copy_from(Array2::<u8>::zeros(shape).view(), &Execution::default())
                .unwrap();
            assert!(plane.data().is_empty());
        }
    }
}
