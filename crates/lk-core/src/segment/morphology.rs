//! Masks grown, shrunk, closed and opened.
//!
//! A mask is a byte a pixel, 0 or 1, in rows without gaps. Work goes down the columns by counts that a band keeps from row
//! to row, whole numbers all, and along the row by runs of doubled length: neither depends on where a band begins.

use std::ops::Range;

use zerocopy::IntoBytes;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, dispatch};

use super::runs::next;

/// Columns and rows.
pub(crate) type Size = (usize, usize);

/// What is put around each pixel of a mask, of an odd size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Element {
    /// A square of so many pixels a side.
    Square(usize),
    /// A disc of so many pixels across: a row that is d from the middle reaches sqrt(r^2 - d^2), rounded, to either side.
    Disc(usize),
}

/// Largest element: counts down a column are bytes.
const MOST_ELEMENT: usize = 255;
/// The masks between two steps, kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Morphology {
    spread: Vec<u8>,
}

/// Write the pixels that have one of `mask` within `element` around them. Beyond the frame nothing is set.
///
/// # Errors
///
/// [`Error::Option`] for an element that is even, 0 or above 255; those of the execution; [`Error::Memory`].
pub(crate) fn dilate(
    mask: &[u8],
    size: Size,
    element: Element,
    to: &mut [u8],
    execution: &Execution,
) -> Result<()> {
    spread(mask, size, element, (0, 0), to, execution)
}

/// Write the pixels that have only pixels of `mask` within `element` around them. Beyond the frame everything is set.
///
/// # Errors
///
/// Those of [`dilate`].
pub(crate) fn erode(
    mask: &[u8],
    size: Size,
    element: Element,
    to: &mut [u8],
    execution: &Execution,
) -> Result<()> {
    spread(mask, size, element, (0, 1), to, execution)
}

impl Morphology {
    /// Fill, in place, what `element` does not fit into beside the mask: gaps and narrow bays. Beyond the frame nothing
    /// is set, so that nothing grows towards the border.
    ///
    /// # Errors
    ///
    /// Those of [`dilate`].
    pub(crate) fn close(
        &mut self,
        mask: &mut [u8],
        size: Size,
        element: Element,
        execution: &Execution,
    ) -> Result<()> {
        self.there_and_back(mask, size, element, 0, execution)
    }

    /// Take away, in place, what `element` does not fit into within the mask: specks and thin lines. Beyond the frame
    /// everything is set, so that what the border cuts is not taken for thin.
    ///
    /// # Errors
    ///
    /// Those of [`dilate`].
    pub(crate) fn open(
        &mut self,
        mask: &mut [u8],
        size: Size,
        element: Element,
        execution: &Execution,
    ) -> Result<()> {
        self.there_and_back(mask, size, element, 1, execution)
    }

    /// Spread what is not `invert` into the surroundings of the frame too, and the opposite back from there.
    fn there_and_back(
        &mut self,
        mask: &mut [u8],
        size: Size,
        element: Element,
        invert: u8,
        execution: &Execution,
    ) -> Result<()> {
        let reach = element.reach()?;
        let wide = (size.0 + 2 * reach, size.1 + 2 * reach);
        resize("a mask", &mut self.spread, wide.0 * wide.1, 0)?;
        let shift = reach as isize;
        spread(
            mask,
            size,
            element,
            (shift, invert),
            &mut self.spread,
            execution,
        )?;
        spread(
            &self.spread,
            wide,
            element,
            (-shift, 1 - invert),
            mask,
            execution,
        )
    }
}

impl Element {
    /// Pixels from its middle to its end.
    fn reach(self) -> Result<usize> {
        let (Self::Square(size) | Self::Disc(size)) = self;
        odd("element", size, MOST_ELEMENT)
    }
}

/// Half of an odd size, without its middle.
pub(super) fn odd(what: &'static str, size: usize, most: usize) -> Result<usize> {
    if size % 2 == 1 && size <= most {
        return Ok(size / 2);
    }
    Err(Error::option(
        what,
        size,
        format!("an odd number of at most {most}"),
    ))
}

/// Spread what is set over `element`, or what is not set where `invert` is 1, into a mask whose pixel (x, y) lies over
/// pixel (x - shift, y - shift), and that is larger by twice the shift.
fn spread(
    mask: &[u8],
    (width, height): Size,
    element: Element,
    (shift, invert): (isize, u8),
    to: &mut [u8],
    execution: &Execution,
) -> Result<()> {
    let reach = element.reach()?;
    let columns = width.saturating_add_signed(2 * shift);
    let rows = height.saturating_add_signed(2 * shift);
    if width == 0 || height == 0 || columns == 0 || rows == 0 {
        to.fill(0);
        return Ok(());
    }
    let padded = columns + 2 * reach;
    let level = execution.simd_level();
    for_each_band(
        execution,
        rows,
        even_bands(execution, rows, [131_072 / columns, 65_536 / columns]),
        RowsMut::new(to, columns),
        |band, part| {
            with_scratch((3 * padded).div_ceil(4), |memory| {
                let memory = memory.as_mut_bytes();
                let (counts, rest) = memory.split_at_mut(padded);
                let (first, second) = rest.split_at_mut(padded);
                dispatch(
                    level,
                    Spread {
                        source: Source {
                            mask,
                            width,
                            height,
                            left: reach.saturating_add_signed(shift),
                            invert,
                        },
                        shift,
                        reach,
                        square: matches!(element, Element::Square(_)),
                        band,
                        to: part.data,
                        buffers: [counts, first, &mut second[..padded]],
                    },
                );
            })
        },
    )
}

/// A mask whose rows are read to the right of `left` columns that are not set.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) mask: &'a [u8],
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) left: usize,
    pub(super) invert: u8,
}

impl<'a> Source<'a> {
    /// Row `y`, if there is one.
    #[inline(always)]
    fn row(&self, y: isize) -> Option<&'a [u8]> {
        let y = usize::try_from(y).ok().filter(|y| *y < self.height)?;
        Some(&self.mask[y * self.width..(y + 1) * self.width])
    }

    /// Whether row `y` has something set, whether what is set or what is not is read.
    #[inline(always)]
    pub(super) fn has(&self, y: isize) -> bool {
        self.row(y).is_some_and(|row| next(row, 0, 1) < row.len())
    }

    /// Add row `y` to counts, or take it off.
    #[inline(always)]
    pub(super) fn count(&self, y: isize, sign: u8, counts: &mut [u8]) {
        let Some(row) = self.row(y) else { return };
        for (count, value) in counts[self.left..][..row.len()].iter_mut().zip(row) {
            *count = count.wrapping_add((value ^ self.invert).wrapping_mul(sign));
        }
    }

    /// Add the part of row `y` that lies from column `from` of the padded row on.
    #[inline(always)]
    fn set(&self, y: isize, from: usize, to: &mut [u8]) {
        let Some(row) = self.row(y) else { return };
        let (skip, at) = (
            from.saturating_sub(self.left),
            self.left.saturating_sub(from),
        );
        let Some(row) = row.get(skip..) else { return };
        let Some(to) = to.get_mut(at..) else { return };
        for (to, value) in to.iter_mut().zip(row) {
            *to |= value ^ self.invert;
        }
    }
}

/// The rows of one band.
struct Spread<'a> {
    source: Source<'a>,
    shift: isize,
    reach: usize,
    square: bool,
    band: Range<usize>,
    to: &'a mut [u8],
    buffers: [&'a mut [u8]; 3],
}

impl Kernel for Spread<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [counts, mut from, mut to] = self.buffers;
        let (reach, padded) = (self.reach as isize, counts.len());
        let columns = padded - 2 * self.reach;
        let first = self.band.start as isize - self.shift;
        counts.fill(0);
        // What nothing is set around is not set; or is, where what is not set spreads, which lies within the mask then.
        let skips = self.source.invert == 0 || self.shift <= 0;
        let mut last = None;
        for y in first - reach..first + reach {
            self.source.count(y, 1, counts);
            last = if self.source.has(y) { Some(y) } else { last };
        }
        for (out, y) in self.to.chunks_exact_mut(columns).zip(first..) {
            let mut len = padded;
            last = if self.source.has(y + reach) {
                Some(y + reach)
            } else {
                last
            };
            if skips && last.is_none_or(|last| last < y - reach) {
                if self.square && self.source.invert == 1 {
                    self.source.count(y + reach, 1, counts);
                    self.source.count(y - reach, u8::MAX, counts);
                }
                out.fill(0);
                continue;
            }
            if self.square {
                self.source.count(y + reach, 1, counts);
                for (to, count) in from.iter_mut().zip(counts.iter()) {
                    *to = u8::from(*count > 0);
                }
                widen(&mut from, &mut to, &mut len, self.reach);
                self.source.count(y - reach, u8::MAX, counts);
            } else {
                from.fill(0);
                // From the widest rows, in the middle, to the narrowest: each is widened by what the rest are not.
                let mut half = self.reach;
                for distance in 0..=reach {
                    let wanted = half_width(self.reach, distance);
                    widen(&mut from, &mut to, &mut len, half - wanted);
                    half = wanted;
                    let column = (padded - len) / 2;
                    self.source.set(y - distance, column, &mut from[..len]);
                    self.source.set(y + distance, column, &mut from[..len]);
                }
                widen(&mut from, &mut to, &mut len, half);
            }
            for (out, value) in out.iter_mut().zip(from.iter()) {
                *out = value ^ self.source.invert;
            }
        }
    }
}

/// How far the row of a disc reaches that is `distance` from its middle.
#[inline(always)]
fn half_width(reach: usize, distance: isize) -> usize {
    let square = (reach * reach) as f64 - (distance * distance) as f64;
    square.max(0.0).sqrt().round_ties_even() as usize
}

/// Let each of the first `len` be what is set within `reach` of it, without the `reach` at either end.
#[inline(always)]
fn widen<'a>(from: &mut &'a mut [u8], to: &mut &'a mut [u8], len: &mut usize, reach: usize) {
    let (window, mut done) = (2 * reach + 1, 1);
    while done < window {
        let step = done.min(window - done);
        *len -= step;
        let (near, far) = (&from[..*len], &from[step..][..*len]);
        for ((to, a), b) in to[..*len].iter_mut().zip(near).zip(far) {
            *to = a | b;
        }
        std::mem::swap(from, to);
        done += step;
    }
}

#[cfg(test)]
mod tests;
