//! Frames made smaller by the means of their blocks; blocks at the right and at the bottom are of what the frame has.

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, read_row};
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};

use super::morphology::Size;

/// How many times smaller along both axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reduction {
    /// Blocks of 2 x 2.
    Half,
    /// Blocks of 4 x 4.
    Quarter,
}

impl Reduction {
    /// Pixels of a block along each axis.
    pub(crate) const fn factor(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Quarter => 4,
        }
    }

    /// Columns and rows of what is left of a frame.
    pub(crate) const fn of(self, (width, height): Size) -> Size {
        (
            width.div_ceil(self.factor()),
            height.div_ceil(self.factor()),
        )
    }
}

/// Write the mean of each block of `frame` into `to`, of [`Reduction::of`] its size.
///
/// # Errors
///
/// Those of the execution; [`Error::Memory`](crate::Error::Memory).
pub(crate) fn reduce<T: Pixel>(
    frame: Frame<'_, T>,
    by: Reduction,
    to: &mut [f32],
    execution: &Execution,
) -> Result<()> {
    let (height, width) = frame.dim();
    let (columns, rows) = by.of((width, height));
    if columns == 0 || rows == 0 {
        return Ok(());
    }
    let level = execution.simd_level();
    for_each_band(
        execution,
        rows,
        even_bands(execution, rows, [16_384 / columns, 8_192 / columns]),
        RowsMut::new(to, columns),
        |band, mut part| {
            with_scratch(2 * width, |scratch| {
                for (local, y) in band.enumerate() {
                    reduce_row(level, frame, by, y, scratch, part.row_mut(local));
                }
            })
        },
    )
}

/// Row `y` of [`reduce`]; `scratch` has twice the frame's columns.
pub(crate) fn reduce_row<T: Pixel>(
    level: SimdLevel,
    frame: Frame<'_, T>,
    by: Reduction,
    y: usize,
    scratch: &mut [f32],
    to: &mut [f32],
) {
    let (height, width) = frame.dim();
    let (sums, row) = scratch.split_at_mut(width);
    let rows: Range<usize> = y * by.factor()..((y + 1) * by.factor()).min(height);
    let first = rows.start;
    let count = rows.len();
    for at in rows {
        let line = frame.row(at);
        let is_first = at == first;
        if let Some(line) = line.as_slice() {
            dispatch(
                level,
                AddRow {
                    line,
                    is_first,
                    sums,
                },
            );
        } else {
            read_row(frame, at, &mut row[..width]);
            dispatch(
                level,
                AddRow {
                    line: &row[..width],
                    is_first,
                    sums,
                },
            );
        }
    }
    match by {
        Reduction::Half => dispatch(level, Fold::<2> { sums, count, to }),
        Reduction::Quarter => dispatch(level, Fold::<4> { sums, count, to }),
    }
}

/// Add a row, or take it as the first one.
struct AddRow<'a, T> {
    line: &'a [T],
    is_first: bool,
    sums: &'a mut [f32],
}

impl<T: Pixel> Kernel for AddRow<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        if self.is_first {
            for (sum, value) in self.sums.iter_mut().zip(self.line) {
                *sum = value.to_f32();
            }
        } else {
            for (sum, value) in self.sums.iter_mut().zip(self.line) {
                *sum += value.to_f32();
            }
        }
    }
}

/// The means of `N` sums side by side, each of `count` pixels.
struct Fold<'a, const N: usize> {
    sums: &'a [f32],
    count: usize,
    to: &'a mut [f32],
}

impl<const N: usize> Kernel for Fold<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let share = ((N * self.count) as f32).recip();
        let (blocks, rest) = self.sums.as_chunks::<N>();
        for (to, block) in self.to.iter_mut().zip(blocks) {
            let mut sum = block[0] + block[1];
            let mut at = 2;
            while at < N {
                sum += block[at] + block[at + 1];
                at += 2;
            }
            *to = sum * share;
        }
        if let (false, Some(to)) = (rest.is_empty(), self.to.last_mut()) {
            let mut sum = 0.0;
            for value in rest {
                sum += value;
            }
            *to = sum / (rest.len() * self.count) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, s};
    use proptest::prelude::*;

    use super::*;
    use crate::segment::made::{bits, every_way, greys, time};

    fn reference<T: Pixel>(frame: Frame<'_, T>, by: usize) -> Vec<f32> {
        let (h, w) = frame.dim();
        let mut means = Vec::new();
        for y in (0..h).step_by(by) {
            for x in (0..w).step_by(by) {
                let block = frame.slice(s![y..(y + by).min(h), x..(x + by).min(w)]);
                let sum: f64 = block.iter().map(|value| f64::from(value.to_f32())).sum();
                means.push((sum / block.len() as f64) as f32);
            }
        }
        means
    }

    fn check<T: Pixel>(frame: Frame<'_, T>) -> core::result::Result<(), TestCaseError> {
        let (h, w) = frame.dim();
        for by in [Reduction::Half, Reduction::Quarter] {
            let want = reference(frame, by.factor());
            let size = by.of((w, h));
            prop_assert_eq!(size.0 * size.1, want.len());
            let mut first = None;
            for execution in every_way() {
                let mut to = vec![f32::NAN; want.len()];
                reduce(frame, by, &mut to, &execution).unwrap();
                for (got, want) in to.iter().zip(&want) {
                    prop_assert!((got - want).abs() <= 1e-6 * want.abs());
                }
                let found = bits(&to);
                prop_assert_eq!(first.get_or_insert(found.clone()), &found);
            }
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn blocks_are_averaged(w in 1usize..80, h in 1usize..30, seed in any::<u64>()) {
            let frame = Array2::from_shape_vec((h, w), greys((w, h), seed)).unwrap();
            check(frame.view())?;
            check(frame.mapv(|value| value as u8).view())?;
            check(frame.mapv(|value| (200.0 * value) as u16).slice(s![..;-1, ..;2]))?;
        }
    }

    #[test]
    #[ignore = "figures for those who change the kernels"]
    fn time_of_reductions() {
        let size = (640, 480);
        let frame = Array2::from_shape_vec((480, 640), greys(size, 1)).unwrap();
        let bytes = frame.mapv(|value| value as u8);
        let mut to = vec![0.0; 320 * 240];
        let one = Execution::default().threads(1);
        for by in [Reduction::Half, Reduction::Quarter] {
            time(&format!("{by:?} of f32"), size, &mut || {
                reduce(frame.view(), by, &mut to, &one).unwrap()
            });
            time(&format!("{by:?} of u8"), size, &mut || {
                reduce(bytes.view(), by, &mut to, &one).unwrap()
            });
        }
    }
}
