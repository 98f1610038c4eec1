//! The Gaussian pyramid: each level is the one before, smoothed by the 5-tap binomial filter and halved.
//!
//! Borders are mirrored without repeating the edge, and a level has half the size of the one before, rounded up, as
//! `cv2.pyrDown` does. Pixel (x, y) of level `k` sits over pixel (2^k x, 2^k y) of level 0.
//!
//! `docs/explanation/algorithms.md`, section "Pyramid".

use ndarray::ArrayView2;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane, expect_size};
use crate::parallel::{even_bands, for_each_band};
use crate::presmooth::copy_smoothed;
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};
use crate::support::Support;

/// The levels of one frame, the finest first. Memory is kept from frame to frame.
///
/// ```
/// use lk_core::ndarray::Array2;
/// use lk_core::{Execution, Pyramid};
///
/// let frame = Array2::from_shape_fn((61, 80), |(y, x)| (3 * x + y) as f32);
/// let mut pyramid = Pyramid::new(frame.view(), 3, &Execution::default())?;
/// let sizes: Vec<_> = pyramid.levels().iter().map(|level| (level.height(), level.width())).collect();
/// assert_eq!(sizes, [(61, 80), (31, 40), (16, 20)]);
/// // The next frame takes the memory of this one.
/// pyramid.rebuild(frame.view(), 3, &Execution::default())?;
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Pyramid {
    levels: Vec<Plane>,
    /// Which pixels of each level count.
    support: Vec<Support>,
}

impl Pyramid {
    /// The pyramid of `frame` with at most `levels` levels; a level of one row or column is the last.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] if `levels` is 0; those of [`Plane::new`] and of the execution.
    pub fn new<T: Pixel>(
        frame: Frame<'_, T>,
        levels: usize,
        execution: &Execution,
    ) -> Result<Self> {
        let mut pyramid = Self::default();
        pyramid.rebuild(frame, levels, execution)?;
        Ok(pyramid)
    }

    /// The same, of the pixels that count: those for which `mask` is true, and that are finite. What is estimated from it
    /// looks at no other.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if the mask is not of the frame's size; those of [`Pyramid::new`].
    pub fn masked<T: Pixel>(
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        levels: usize,
        execution: &Execution,
    ) -> Result<Self> {
        let mut pyramid = Self::default();
        pyramid.rebuild_masked(frame, mask, levels, execution)?;
        Ok(pyramid)
    }

    /// Replace the content by that of [`Pyramid::masked`]; keeps the memory.
    ///
    /// # Errors
    ///
    /// Those of [`Pyramid::masked`].
    pub fn rebuild_masked<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        levels: usize,
        execution: &Execution,
    ) -> Result<()> {
        if let Some(mask) = mask {
            expect_size("mask", mask.dim(), "the frame", frame.dim())?;
        }
        if levels == 0 {
            return Err(Error::option("levels", 0, "1 or more"));
        }
        let (height, width) = frame.dim();
        self.resize([width, height], levels)?;
        self.levels[0].copy_scaled(frame, 1.0, execution)?;
        self.support[0].take(frame, mask, execution)?;
        self.support[0].fill(&mut self.levels[0]);
        self.reduce_support()?;
        self.reduce_again(execution)
    }

    /// [`Pyramid::rebuild`] of a frame whose pixels are what `bytes` says, see [`Support::take_bytes`].
    pub(crate) fn rebuild_with<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        bytes: &[u8],
        levels: usize,
        execution: &Execution,
    ) -> Result<()> {
        self.rebuild(frame, levels, execution)?;
        let (height, width) = frame.dim();
        if !bytes.is_empty() {
            self.support[0].take_bytes((width, height), bytes)?;
            self.reduce_support()?;
        }
        Ok(())
    }

    /// Which pixels of each level count, the finest first.
    pub(crate) fn support(&self) -> &[Support] {
        &self.support
    }

    /// Make the support of all levels but the finest again, from the finest.
    fn reduce_support(&mut self) -> Result<()> {
        for level in 1..self.support.len() {
            let (finer, coarser) = self.support.split_at_mut(level);
            coarser[0].reduce(&finer[level - 1])?;
        }
        Ok(())
    }

    /// Replace the content by the pyramid of `frame`; allocates nothing if the sizes are those of the frame before.
    ///
    /// # Errors
    ///
    /// Those of [`Pyramid::new`].
    pub fn rebuild<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        levels: usize,
        execution: &Execution,
    ) -> Result<()> {
        self.rebuild_smoothed(frame, levels, (1.0, 0.0), execution)
    }

    /// [`Pyramid::rebuild`], with every grey level times a scale, and smoothed by a filter of three taps, `side` the outer
    /// ones.
    pub(crate) fn rebuild_smoothed<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        levels: usize,
        (scale, side): (f32, f32),
        execution: &Execution,
    ) -> Result<()> {
        if levels == 0 {
            return Err(Error::option("levels", 0, "1 or more"));
        }
        let (height, width) = frame.dim();
        self.resize([width, height], levels)?;
        copy_smoothed(&mut self.levels[0], frame, (scale, side), execution)?;
        self.support[0] = Support::whole(width, height);
        self.reduce_support()?;
        self.reduce_again(execution)
    }

    /// Make room for a frame of `size` (columns, rows) with at most `levels` levels; what they hold is unspecified.
    pub(crate) fn resize(&mut self, size: [usize; 2], levels: usize) -> Result<()> {
        let [mut width, mut height] = size;
        let mut count = 1;
        while count < levels && height > 1 && width > 1 {
            (height, width) = (height.div_ceil(2), width.div_ceil(2));
            count += 1;
        }
        self.levels.resize_with(count, Plane::default);
        self.support.resize_with(count, Support::default);
        self.levels[0].resize(size[0], size[1])
    }

    /// Make all levels but the finest again, from the finest.
    pub(crate) fn reduce_again(&mut self, execution: &Execution) -> Result<()> {
        for level in 1..self.levels.len() {
            let (finer, coarser) = self.levels.split_at_mut(level);
            reduce(&finer[level - 1], &mut coarser[0], execution)?;
        }
        Ok(())
    }

    /// The levels, to write.
    pub(crate) fn levels_mut(&mut self) -> &mut [Plane] {
        &mut self.levels
    }

    /// The levels, the finest first.
    #[must_use]
    pub fn levels(&self) -> &[Plane] {
        &self.levels
    }
}

/// Write `source`, smoothed and halved, into `target`.
fn reduce(source: &Plane, target: &mut Plane, execution: &Execution) -> Result<()> {
    let (width, height) = (source.width().div_ceil(2), source.height().div_ceil(2));
    target.resize(width, height)?;
    if width == 0 || height == 0 {
        return Ok(());
    }
    let level = execution.simd_level();
    let min_rows = even_bands(execution, height, [16_384 / width, 4_096 / width]);
    for_each_band(
        execution,
        height,
        min_rows,
        target.rows_mut(),
        |rows, mut part| {
            // Two columns on either side, and one that fills the last pair.
            with_scratch(source.width() + 5, |smoothed| {
                for (local, y) in rows.enumerate() {
                    reduce_row(level, source, y, smoothed, part.row_mut(local));
                }
            })
        },
    )
}

/// The index that a mirrored border gives for `index`, which may lie outside of `0..size`.
pub(crate) fn mirror(index: isize, size: usize) -> usize {
    if size == 1 {
        return 0;
    }
    let period = 2 * (size as isize - 1);
    let folded = index.rem_euclid(period);
    (if folded < size as isize {
        folded
    } else {
        period - folded
    }) as usize
}

fn reduce_row(level: SimdLevel, source: &Plane, y: usize, smoothed: &mut [f32], row: &mut [f32]) {
    let (width, height) = (source.width(), source.height());
    let rows =
        [-2isize, -1, 0, 1, 2].map(|offset| source.row(mirror(2 * y as isize + offset, height)));
    dispatch(
        level,
        SmoothDown {
            rows,
            smoothed: &mut smoothed[2..width + 2],
        },
    );
    for (at, x) in [
        (0, -2),
        (1, -1),
        (width + 2, width as isize),
        (width + 3, width as isize + 1),
    ] {
        smoothed[at] = smoothed[mirror(x, width) + 2];
    }
    dispatch(level, SmoothAcross { smoothed, row });
}

/// The binomial filter down the columns.
struct SmoothDown<'a> {
    rows: [&'a [f32]; 5],
    smoothed: &'a mut [f32],
}

impl Kernel for SmoothDown<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let width = self.smoothed.len();
        let [a, b, c, d, e] = self.rows.map(|row| &row[..width]);
        for x in 0..width {
            self.smoothed[x] = (a[x] + e[x]) + 4.0 * (b[x] + d[x]) + 6.0 * c[x];
        }
    }
}

/// The binomial filter along the row, at every second pixel; the sum of both filters is taken out here.
struct SmoothAcross<'a> {
    smoothed: &'a [f32],
    row: &'a mut [f32],
}

impl Kernel for SmoothAcross<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let count = self.row.len();
        let (pairs, _) = self.smoothed.as_chunks::<2>();
        let (a, b, c) = (&pairs[..count], &pairs[1..=count], &pairs[2..count + 2]);
        for x in 0..count {
            let ([s0, s1], [s2, s3], [s4, _]) = (a[x], b[x], c[x]);
            self.row[x] = ((s0 + s4) + 4.0 * (s1 + s3) + 6.0 * s2) * (1.0 / 256.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;
    use proptest::prelude::*;

    use super::*;

    /// The definition, pixel by pixel, in f64.
    fn reference(frame: &Array2<f64>) -> Array2<f64> {
        let (height, width) = frame.dim();
        let weights = [1.0, 4.0, 6.0, 4.0, 1.0];
        Array2::from_shape_fn((height.div_ceil(2), width.div_ceil(2)), |(y, x)| {
            let mut sum = 0.0;
            for (j, wy) in weights.iter().enumerate() {
                for (i, wx) in weights.iter().enumerate() {
                    let row = mirror(2 * y as isize + j as isize - 2, height);
                    let column = mirror(2 * x as isize + i as isize - 2, width);
                    sum += wy * wx * frame[(row, column)];
                }
            }
            sum / 256.0
        })
    }

    proptest! {
        #[test]
        fn every_level_is_the_filtered_one_before(
            height in 1usize..40, width in 1usize..40, seed in any::<u32>(), threads in 1usize..4
        ) {
            let frame = Array2::from_shape_fn((height, width), |(y, x)| {
                ((y * 57 + x * 131 + seed as usize % 1009) * 7919 % 256) as u8
            });
            for level in SimdLevel::available() {
                let execution = Execution::default().threads(threads).level(level);
                let pyramid = Pyramid::new(frame.view(), 4, &execution).unwrap();
                let mut want = frame.mapv(f64::from);
                for plane in pyramid.levels() {
                    prop_assert_eq!((plane.height(), plane.width()), want.dim());
                    for ((y, x), value) in want.indexed_iter() {
                        prop_assert!((f64::from(plane.row(y)[x]) - value).abs() < 1e-3);
                    }
                    want = reference(&want);
                }
            }
        }
    }

    #[test]
    fn no_level_is_an_error() {
        let frame = Array2::<u8>::zeros((4, 4));
        let error = Pyramid::new(frame.view(), 0, &Execution::default()).unwrap_err();
        assert_eq!(error.to_string(), "levels: got 0, expected 1 or more");
    }
}
