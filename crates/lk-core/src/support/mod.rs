//! Which pixels of a frame count: inside of it, not masked, finite, and not clipped at either end.
//!
//! `docs/explanation/algorithms.md`, section "Masks and support".

mod clipping;
mod masks;
mod window;

use ndarray::ArrayView2;

pub use masks::Masks;

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane};
use crate::grey::GreyRange;
use crate::memory::{replace, resize, zeros};
use crate::parallel::{RowsMut, for_each_band};
use clipping::limits;

/// A pixel that is masked, not finite, or outside of the frame.
pub(crate) const ABSENT: u8 = 0;
/// A pixel at an end of the range, where grey levels pile up: it was brighter or darker than it says.
pub(crate) const CLIPPED: u8 = 1;
/// A pixel that counts.
pub(crate) const COUNTS: u8 = 2;

/// What a grey level is where they pile up at `low` and `high`.
#[inline(always)]
fn judged(value: f32, low: f32, high: f32) -> u8 {
    let clipped = u8::from(value <= low) | u8::from(value >= high);
    u8::from(value.is_finite()) * (COUNTS - clipped)
}

/// What memory for pixels holds.
const FRAME: &str = "which pixels count";

/// Pixels along a side of the tiles that are known to count as a whole.
const TILE: usize = 16;

/// Weight out of 256 that must count below a pixel of the next level.
const LEAST_WEIGHT: u16 = 192;

/// For each pixel of a frame, or of one level of its pyramid, whether it counts: [`ABSENT`], [`CLIPPED`] or [`COUNTS`].
/// The worse is the smaller, so that a filter's support is the least of its pixels'.
#[derive(Debug, Clone, Default)]
pub(crate) struct Support {
    width: usize,
    height: usize,
    /// First and last but one column, and row, that are made of pixels of the frame alone.
    inner: [(usize, usize); 2],
    /// All rows; empty where every pixel of `inner` counts.
    bytes: Vec<u8>,
    /// Whether one of them is [`ABSENT`].
    absent: bool,
    /// Tiles that hold a pixel that does not count.
    broken: Vec<bool>,
}

impl Support {
    /// All pixels of a frame of this size.
    pub(crate) fn whole(width: usize, height: usize) -> Self {
        let mut support = Self::default();
        support.fill_whole(width, height);
        support
    }

    fn fill_whole(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.inner = [(0, width), (0, height)];
        self.bytes.clear();
        self.broken.clear();
        self.absent = false;
    }

    /// Put into each pixel of `plane` that is absent the last one of its row that is not, or else the first one, or else
    /// what the row beside it has: filters then meet no edge there and no NaN.
    pub(crate) fn fill(&self, plane: &mut Plane) {
        if !self.absent {
            return;
        }
        let there = |y: usize| self.row(y).iter().position(|byte| *byte != ABSENT);
        let Some(top) = (0..self.height).find(|y| there(*y).is_some()) else {
            plane.data_mut().fill(0.0);
            return;
        };
        let mut source = top;
        for y in (top..self.height).chain((0..top).rev()) {
            if let Some(first) = there(y) {
                let row = plane.row_mut(y);
                let mut last = row[first];
                for (value, byte) in row.iter_mut().zip(self.row(y)) {
                    if *byte == ABSENT {
                        *value = last;
                    } else {
                        last = *value;
                    }
                }
                source = y;
            } else {
                let from = if y < top { y + 1 } else { source };
                let start = from * plane.width();
                let row = start..start + plane.width();
                let to = y * plane.width();
                plane.data_mut().copy_within(row, to);
                source = y;
            }
        }
    }

    /// Take those of `frame` that `mask` keeps, that are finite, and that are not clipped; memory is kept.
    ///
    /// # Errors
    ///
    /// Those of the execution.
    pub(crate) fn take<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        execution: &Execution,
    ) -> Result<()> {
        let greys = GreyRange::among(frame, mask);
        let limits = limits(frame, mask, &greys);
        self.take_within(frame, mask, &greys, limits, execution)
    }

    /// The same, clipped pixels among them.
    ///
    /// # Errors
    ///
    /// Those of the execution.
    pub(crate) fn take_present<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        execution: &Execution,
    ) -> Result<()> {
        self.take_within(frame, mask, &GreyRange::of(frame), [None; 2], execution)
    }

    fn take_within<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        greys: &GreyRange,
        limits: [Option<f32>; 2],
        execution: &Execution,
    ) -> Result<()> {
        let (height, width) = frame.dim();
        self.fill_whole(width, height);
        if mask.is_none() && greys.is_finite() && limits == [None; 2] || width * height == 0 {
            return Ok(());
        }
        let low = limits[0].unwrap_or(f32::NEG_INFINITY);
        let high = limits[1].unwrap_or(f32::INFINITY);
        resize(FRAME, &mut self.bytes, width * height, COUNTS)?;
        for_each_band(
            execution,
            height,
            (65_536 / width).max(1),
            RowsMut::new(&mut self.bytes, width),
            |rows, mut part| {
                for (local, y) in rows.enumerate() {
                    let row = part.row_mut(local);
                    let values = frame.row(y);
                    // One after the other, which is fastest where they stand side by side.
                    if let Some(values) = values.as_slice() {
                        for (to, value) in row.iter_mut().zip(values) {
                            *to = judged(value.to_f32(), low, high);
                        }
                    } else {
                        for (to, value) in row.iter_mut().zip(values) {
                            *to = judged(value.to_f32(), low, high);
                        }
                    }
                    if let Some(mask) = mask {
                        for (to, keep) in row.iter_mut().zip(mask.row(y)) {
                            if !keep {
                                *to = ABSENT;
                            }
                        }
                    }
                }
            },
        )?;
        self.find_tiles()
    }

    /// Find the tiles that are not whole; without one, all pixels count.
    fn find_tiles(&mut self) -> Result<()> {
        let (columns, rows) = (self.width.div_ceil(TILE), self.height.div_ceil(TILE));
        self.broken.clear();
        resize(FRAME, &mut self.broken, columns * rows, false)?;
        let mut whole = true;
        for (y, row) in self.bytes.chunks_exact(self.width.max(1)).enumerate() {
            for (tile, pixels) in row.chunks(TILE).enumerate() {
                let least = pixels.iter().fold(COUNTS, |least, byte| least.min(*byte));
                if least != COUNTS {
                    self.broken[y / TILE * columns + tile] = true;
                    whole = false;
                }
                self.absent |= least == ABSENT;
            }
        }
        if whole {
            self.bytes.clear();
            self.broken.clear();
        }
        Ok(())
    }

    /// Take the support of the next coarser level of a pyramid, see [`crate::Pyramid`]: a pixel counts there if at least
    /// three quarters of what it is made of is there. Clipping is told on the finest level alone.
    ///
    /// # Errors
    ///
    /// [`crate::Error::Memory`].
    pub(crate) fn reduce(&mut self, finer: &Self) -> Result<()> {
        let size = [finer.width.div_ceil(2), finer.height.div_ceil(2)];
        self.fill_whole(size[0], size[1]);
        // A tap at the far end has a sixteenth of the weight, the one before it a quarter.
        self.inner = finer.inner.map(|(first, end)| {
            let first = first.div_ceil(2) + usize::from(first % 2 == 0);
            (first, (end / 2).max(first))
        });
        if !finer.absent {
            return Ok(());
        }
        let (width, height) = (self.width, self.height);
        resize(FRAME, &mut self.bytes, width * height, COUNTS)?;
        let mut down = zeros::<u16>(FRAME, finer.width)?;
        for y in 0..height {
            down.fill(0);
            for (tap, weight) in [1u16, 4, 6, 4, 1].into_iter().enumerate() {
                let Some(row) = (2 * y + tap).checked_sub(2).filter(|y| *y < finer.height) else {
                    continue;
                };
                for (sum, byte) in down.iter_mut().zip(finer.row(row)) {
                    *sum += weight * u16::from((*byte).min(1));
                }
            }
            for x in 0..width {
                let mut sum = 0;
                for (tap, weight) in [1u16, 4, 6, 4, 1].into_iter().enumerate() {
                    let at = (2 * x + tap).checked_sub(2);
                    sum += weight * at.and_then(|at| down.get(at)).copied().unwrap_or(0);
                }
                if sum < LEAST_WEIGHT {
                    self.bytes[y * width + x] = ABSENT;
                }
            }
        }
        self.find_tiles()
    }

    /// Whether every pixel of the frame counts.
    #[cfg(test)]
    fn is_whole(&self) -> bool {
        self.bytes.is_empty()
    }

    /// What each pixel is, row by row; empty where all count.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Take what each pixel of a frame of this size is, as [`Support::bytes`] gives it.
    ///
    /// # Errors
    ///
    /// [`crate::Error::Memory`].
    pub(crate) fn take_bytes(
        &mut self,
        (width, height): (usize, usize),
        bytes: &[u8],
    ) -> Result<()> {
        self.fill_whole(width, height);
        replace(
            FRAME,
            &mut self.bytes,
            bytes.iter().map(|byte| (*byte).min(COUNTS)),
        )?;
        self.find_tiles()
    }

    /// Whether some pixels are [`ABSENT`].
    pub(crate) fn has_absent(&self) -> bool {
        self.absent
    }

    /// First and last but one column, and row, that are made of pixels of the frame alone.
    pub(crate) fn inner(&self) -> [(usize, usize); 2] {
        self.inner
    }

    /// Row `y`: what each pixel is; empty where all count.
    pub(crate) fn row(&self, y: usize) -> &[u8] {
        if self.bytes.is_empty() {
            &[]
        } else {
            &self.bytes[y * self.width..][..self.width]
        }
    }

    /// What the pixel at (x, y) is.
    #[cfg(test)]
    fn at(&self, x: isize, y: isize) -> u8 {
        let within = [x, y].into_iter().zip(self.inner);
        let inside = within
            .map(|(at, (first, end))| at >= first as isize && at < end as isize)
            .fold(true, |all, inside| all & inside);
        if !inside {
            ABSENT
        } else if self.bytes.is_empty() {
            COUNTS
        } else {
            self.bytes[y as usize * self.width + x as usize]
        }
    }
}

#[cfg(test)]
mod tests;
