//! Means over square windows, of as many channels at once as a caller makes of each row.
//!
//! A window's rows are added from the top down, then its columns from left to right: nothing is carried from window to
//! window, so that neither rounding nor where a band begins shows in a mean.

use crate::error::{Error, Result};
use crate::execution::Execution;
#[cfg(test)]
use crate::parallel::RowsMut;
use crate::parallel::{SplitRows, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Floats, Kernel, LANES, Simd, SimdLevel, blocks, blocks_mut, dispatch};

use super::morphology::Size;

/// Largest window.
const MOST: usize = 63;

/// A square window of an odd number of pixels a side. Beyond the frame stands its nearest pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    /// Pixels a side.
    pub(crate) size: usize,
}

/// Write the mean of `plane` over a window around each pixel.
///
/// # Errors
///
/// [`Error::Option`] for a window that is even, 0 or above 63; those of the execution; [`Error::Memory`].
#[cfg(test)]
pub(crate) fn box_mean(
    plane: &[f32],
    size: Size,
    window: Window,
    to: &mut [f32],
    execution: &Execution,
) -> Result<()> {
    let width = size.0;
    let fill = |y: usize, [row]: [&mut [f32]; 1]| row.copy_from_slice(&plane[y * width..][..width]);
    let emit = |local: usize, _, [means]: [&[f32]; 1], to: &mut RowsMut<'_, f32>| {
        to.row_mut(local).copy_from_slice(means);
    };
    window_means(
        size,
        window,
        RowsMut::new(to, width.max(1)),
        fill,
        emit,
        execution,
    )
}

/// Call `emit(local, y, means, outputs)` for each row `y`, the row `local` of the band's outputs, with the means of `N`
/// channels over the window around each pixel. `fill(y, channels)` makes a row of the channels; rows near the end of a
/// band are made twice.
///
/// # Errors
///
/// Those of [`box_mean`].
pub(crate) fn window_means<const N: usize, S: SplitRows>(
    (width, height): Size,
    window: Window,
    outputs: S,
    fill: impl Fn(usize, [&mut [f32]; N]) + Sync,
    emit: impl Fn(usize, usize, [&[f32]; N], &mut S) + Sync,
    execution: &Execution,
) -> Result<()> {
    let Window { size } = window;
    if size % 2 == 0 || size > MOST {
        return Err(Error::option(
            "window",
            size,
            format!("an odd number of at most {MOST}"),
        ));
    }
    if width == 0 || height == 0 {
        return Ok(());
    }
    let reach = size / 2;
    let level = execution.simd_level();
    let memory = Layout {
        width,
        stride: width.next_multiple_of(LANES),
        size,
        channels: N,
    };
    let min_rows = even_bands(execution, height, [16_384 / width, 8_192 / width]);
    for_each_band(execution, height, min_rows, outputs, |band, mut part| {
        with_scratch(memory.total(), |scratch| {
            let (ring, rest) = scratch.split_at_mut(memory.ring());
            let (down, rest) = rest.split_at_mut(memory.padded());
            let (shares, means) = rest.split_at_mut(memory.stride);
            let make = |ring: &mut [f32], y: usize| fill(y, memory.slots(ring, y % size));
            for y in band.start.saturating_sub(reach)..(band.start + reach).min(height) {
                make(ring, y);
            }
            shares[..width].fill(((size * size) as f32).recip());
            for (local, y) in band.enumerate() {
                if y + reach < height {
                    make(ring, y + reach);
                }
                for channel in 0..N {
                    let ring = &ring[channel * size * memory.stride..][..size * memory.stride];
                    let to = &mut means[channel * memory.stride..][..memory.stride];
                    Mean {
                        ring,
                        memory,
                        y,
                        height,
                        shares,
                        down,
                        to,
                    }
                    .run(level);
                }
                emit(local, y, memory.rows(means), &mut part);
            }
        })
    })
}

/// The rows that a band works on.
#[derive(Clone, Copy)]
struct Layout {
    width: usize,
    stride: usize,
    size: usize,
    channels: usize,
}

impl Layout {
    /// The last rows of each channel, as many as a window has.
    fn ring(&self) -> usize {
        self.channels * self.size * self.stride
    }

    /// A row with the window's reach on either side.
    fn padded(&self) -> usize {
        self.stride + self.size - 1
    }

    /// A row of each channel in the ring.
    fn slots<'a, const N: usize>(&self, ring: &'a mut [f32], slot: usize) -> [&'a mut [f32]; N] {
        let mut slots = ring
            .chunks_exact_mut(self.stride)
            .skip(slot)
            .step_by(self.size);
        std::array::from_fn(|_| match slots.next() {
            Some(slot) => &mut slot[..self.width],
            None => &mut [],
        })
    }

    /// The means of each channel.
    fn rows<'a, const N: usize>(&self, means: &'a [f32]) -> [&'a [f32]; N] {
        let mut rows = means.chunks_exact(self.stride);
        std::array::from_fn(|_| rows.next().map_or(&[][..], |row| &row[..self.width]))
    }

    fn total(&self) -> usize {
        self.ring() + self.padded() + (1 + self.channels) * self.stride
    }
}

/// A row of means of one channel.
struct Mean<'a> {
    ring: &'a [f32],
    memory: Layout,
    y: usize,
    height: usize,
    shares: &'a [f32],
    down: &'a mut [f32],
    to: &'a mut [f32],
}

impl Mean<'_> {
    fn run(self, level: SimdLevel) {
        let Layout { width, size, .. } = self.memory;
        let (reach, end) = (size / 2, size / 2 + width);
        let Self {
            ring,
            memory,
            y,
            height,
            shares,
            down,
            to,
        } = self;
        dispatch(
            level,
            Down {
                ring,
                memory,
                y,
                height,
                to: down,
            },
        );
        let [first, last] = [down[reach], down[end - 1]];
        down[..reach].fill(first);
        down[end..end + reach].fill(last);
        dispatch(
            level,
            Across {
                down,
                size,
                shares,
                to,
            },
        );
    }
}

/// The sum of a window's rows.
struct Down<'a> {
    ring: &'a [f32],
    memory: Layout,
    y: usize,
    height: usize,
    to: &'a mut [f32],
}

impl Kernel for Down<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Layout { stride, size, .. } = self.memory;
        let (count, reach) = (stride / LANES, size / 2);
        let mut rows: [&[[f32; LANES]]; MOST] = [&[]; MOST];
        for (step, row) in rows[..size].iter_mut().enumerate() {
            let y = (self.y + step).saturating_sub(reach).min(self.height - 1);
            *row = blocks(self.ring, y % size * stride, count);
        }
        add(s, &rows[..size], None, blocks_mut(self.to, reach, count));
    }
}

/// The sum of a window's columns, times a share.
struct Across<'a> {
    down: &'a [f32],
    size: usize,
    shares: &'a [f32],
    to: &'a mut [f32],
}

impl Kernel for Across<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.to.len() / LANES;
        let mut columns: [&[[f32; LANES]]; MOST] = [&[]; MOST];
        for (step, column) in columns[..self.size].iter_mut().enumerate() {
            *column = blocks(self.down, step, count);
        }
        let shares = blocks(self.shares, 0, count);
        add(
            s,
            &columns[..self.size],
            Some(shares),
            blocks_mut(self.to, 0, count),
        );
    }
}

type Blocks<'a> = &'a [[f32; LANES]];

/// Add rows in their order, times a share where there is one. The usual counts have a loop of their own.
#[inline(always)]
fn add<S: Simd>(s: S, rows: &[Blocks<'_>], shares: Option<Blocks<'_>>, to: &mut [[f32; LANES]]) {
    match rows.len() {
        3 => add_some::<S, 3>(s, rows, shares, to),
        5 => add_some::<S, 5>(s, rows, shares, to),
        7 => add_some::<S, 7>(s, rows, shares, to),
        _ => {
            let count = to.len();
            let (first, others) = rows.split_at(1);
            to.copy_from_slice(&first[0][..count]);
            // Four at a time, so that a sum is seldom written.
            let (fours, rest) = others.as_chunks::<4>();
            for [a, b, c, d] in fours {
                let [a, b, c, d] = [&a[..count], &b[..count], &c[..count], &d[..count]];
                for i in 0..count {
                    let sum = s.get(&to[i]) + s.get(&a[i]) + s.get(&b[i]) + s.get(&c[i]);
                    (sum + s.get(&d[i])).put(&mut to[i]);
                }
            }
            for row in rest {
                let row = &row[..count];
                for i in 0..count {
                    (s.get(&to[i]) + s.get(&row[i])).put(&mut to[i]);
                }
            }
            if let Some(shares) = shares {
                let shares = &shares[..count];
                for i in 0..count {
                    (s.get(&to[i]) * s.get(&shares[i])).put(&mut to[i]);
                }
            }
        }
    }
}

#[inline(always)]
fn add_some<S: Simd, const N: usize>(
    s: S,
    rows: &[Blocks<'_>],
    shares: Option<Blocks<'_>>,
    to: &mut [[f32; LANES]],
) {
    let count = to.len();
    let mut all: [Blocks<'_>; N] = [&[]; N];
    for (all, row) in all.iter_mut().zip(rows) {
        *all = &row[..count];
    }
    // What every lane is multiplied by where there is no share: a product with 1 is exact.
    let one = s.splat(1.0);
    let (is_shared, shares) = match shares {
        Some(shares) => (true, &shares[..count]),
        None => (false, all[0]),
    };
    for i in 0..count {
        let mut sum = s.get(&all[0][i]);
        for row in &all[1..] {
            sum = sum + s.get(&row[i]);
        }
        let share = if is_shared { s.get(&shares[i]) } else { one };
        (sum * share).put(&mut to[i]);
    }
}

#[cfg(test)]
mod tests;
