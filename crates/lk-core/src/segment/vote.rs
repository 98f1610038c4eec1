//! Masks voted on in windows: the binary median.

use std::ops::Range;

use zerocopy::IntoBytes;

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, dispatch};

use super::morphology::{Size, Source, odd};

/// Largest window of a vote: the count of all of its pixels is a byte.
const MOST_VOTERS: usize = 15;

/// Write where more than half of the pixels are set within a square window of `window` pixels a side, as far as it lies
/// in the frame: the binary median.
///
/// # Errors
///
/// [`Error::Option`] for a window that is even, 0 or above 15; those of the execution; [`Error::Memory`].
pub(crate) fn majority(
    mask: &[u8],
    (width, height): Size,
    window: usize,
    to: &mut [u8],
    execution: &Execution,
) -> Result<()> {
    let reach = odd("window", window, MOST_VOTERS)?;
    if width == 0 || height == 0 {
        return Ok(());
    }
    let padded = width + 2 * reach;
    let level = execution.simd_level();
    for_each_band(
        execution,
        height,
        even_bands(execution, height, [131_072 / width, 65_536 / width]),
        RowsMut::new(to, width),
        |band, part| {
            with_scratch((padded + 2 * width).div_ceil(4), |memory| {
                let (counts, rest) = memory.as_mut_bytes().split_at_mut(padded);
                let (most, sums) = rest.split_at_mut(width);
                let source = Source {
                    mask,
                    width,
                    height,
                    left: reach,
                    invert: 0,
                };
                let kernel = Vote {
                    source,
                    window,
                    band,
                    counts,
                    most,
                    sums: &mut sums[..width],
                    to: part.data,
                };
                dispatch(level, kernel);
            })
        },
    )
}

/// The rows of one band of a vote.
struct Vote<'a> {
    source: Source<'a>,
    window: usize,
    band: Range<usize>,
    counts: &'a mut [u8],
    /// Half of the pixels of the window at each column.
    most: &'a mut [u8],
    sums: &'a mut [u8],
    to: &'a mut [u8],
}

impl Kernel for Vote<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let (width, reach) = (self.source.width, self.window / 2);
        let (far, height) = (reach as isize, self.source.height);
        let (mut known, mut last) = (0, None);
        self.counts.fill(0);
        for y in self.band.start as isize - far..self.band.start as isize + far {
            self.source.count(y, 1, self.counts);
            last = if self.source.has(y) { Some(y) } else { last };
        }
        for (out, y) in self.to.chunks_exact_mut(width).zip(self.band) {
            let next = y as isize + far;
            last = if self.source.has(next) {
                Some(next)
            } else {
                last
            };
            if last.is_none_or(|last| last < y as isize - far) {
                out.fill(0);
                continue;
            }
            self.source.count(next, 1, self.counts);
            let rows = (y + reach + 1).min(height) - y.saturating_sub(reach);
            if rows != known {
                known = rows;
                for (x, most) in self.most.iter_mut().enumerate() {
                    let columns = (x + reach + 1).min(width) - x.saturating_sub(reach);
                    *most = (rows * columns / 2) as u8;
                }
            }
            self.sums.copy_from_slice(&self.counts[..width]);
            for step in 1..self.window {
                for (sum, count) in self.sums.iter_mut().zip(&self.counts[step..]) {
                    *sum = sum.wrapping_add(*count);
                }
            }
            for ((out, sum), most) in out.iter_mut().zip(self.sums.iter()).zip(self.most.iter()) {
                *out = u8::from(sum > most);
            }
            self.source.count(y as isize - far, u8::MAX, self.counts);
        }
    }
}
