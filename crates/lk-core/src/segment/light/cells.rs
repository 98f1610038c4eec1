//! Means of 4 x 4 pixels, of those that count: what the light of a tile is fitted to.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::segment::morphology::Size;
use crate::segment::reduction::Reduction;
use crate::simd::{Floats, Kernel, LANES, Simd, blocks_mut, dispatch};

use super::frame_light::FrameLight;
use super::pair::Pair;

/// Cells of a tile along each axis, and pixels of a cell.
pub(super) const CELLS: usize = 4;
const CELL: usize = Reduction::Quarter.factor();

/// Planes of cells.
#[derive(Debug, Default)]
pub(super) struct Cells {
    pub(super) size: Size,
    /// Share of a cell's pixels that count.
    pub(super) weight: Vec<f32>,
    /// The reference in the frame's light, less the middle of its range.
    pub(super) level: Vec<f32>,
    /// The picture less that.
    pub(super) change: Vec<f32>,
    /// How far the change is from the light that was fitted.
    pub(super) misfit: Vec<f32>,
}

impl Cells {
    /// Take the means of a pair.
    pub(super) fn reduce(
        &mut self,
        pair: &Pair<'_>,
        light: &FrameLight,
        execution: &Execution,
    ) -> Result<()> {
        let (columns, rows) = Reduction::Quarter.of(pair.size);
        self.size = (columns, rows);
        for plane in [
            &mut self.weight,
            &mut self.level,
            &mut self.change,
            &mut self.misfit,
        ] {
            resize("cells of light", plane, columns * rows, 0.0)?;
        }
        if columns == 0 || rows == 0 {
            return Ok(());
        }
        let level = execution.simd_level();
        let width = pair.size.0;
        for_each_band(
            execution,
            rows,
            even_bands(execution, rows, [16_384 / columns, 4_096 / columns]),
            (
                RowsMut::new(&mut self.weight, columns),
                RowsMut::new(&mut self.level, columns),
                RowsMut::new(&mut self.change, columns),
            ),
            |band, (mut weight, mut grey, mut change)| {
                with_scratch((3 + CELL) * width, |sums| {
                    for (local, y) in band.enumerate() {
                        let to = [
                            weight.row_mut(local),
                            grey.row_mut(local),
                            change.row_mut(local),
                        ];
                        dispatch(
                            level,
                            Reduce {
                                pair,
                                light,
                                y,
                                sums,
                                to,
                            },
                        );
                    }
                })
            },
        )
    }
}

/// A row of cells.
struct Reduce<'a> {
    pair: &'a Pair<'a>,
    light: &'a FrameLight,
    y: usize,
    sums: &'a mut [f32],
    to: [&'a mut [f32]; 3],
}

impl Kernel for Reduce<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (width, height) = self.pair.size;
        let rows = self.y * CELL..((self.y + 1) * CELL).min(height);
        let (still, sums) = self.sums.split_at_mut(CELL * width);
        let marks = &self.pair.still[rows.start * width..rows.end * width];
        for (to, mark) in still.iter_mut().zip(marks) {
            *to = f32::from(*mark);
        }
        let still = &still[..marks.len()];
        let (count, rest) = sums.split_at_mut(width);
        let (of_a, of_b) = rest.split_at_mut(width);
        let of_b = &mut of_b[..width];
        let a = &self.pair.reference[rows.start * width..rows.end * width];
        let b = &self.pair.image[rows.start * width..rows.end * width];
        let whole = width / LANES;
        let [low, high] = self.pair.range;
        let (lows, highs) = (s.splat(low), s.splat(high));
        let (zero, one) = (s.splat(0.0), s.splat(1.0));
        for block in 0..whole {
            let (mut n, mut p, mut q) = (zero, zero, zero);
            for row in 0..rows.len() {
                let at = row * width + block * LANES;
                let (x, y, mark) = (s.load(a, at), s.load(b, at), s.load(still, at));
                let above = S::F::both(lows.lt(x), lows.lt(y));
                let below = S::F::both(x.lt(highs), y.lt(highs));
                let counts = S::F::both(S::F::both(above, below), zero.lt(mark));
                n = n + S::F::select(counts, one, zero);
                p = p + S::F::select(counts, x, zero);
                q = q + S::F::select(counts, y, zero);
            }
            n.put(&mut blocks_mut(count, 0, whole)[block]);
            p.put(&mut blocks_mut(of_a, 0, whole)[block]);
            q.put(&mut blocks_mut(of_b, 0, whole)[block]);
        }
        for x in whole * LANES..width {
            (count[x], of_a[x], of_b[x]) = (0.0, 0.0, 0.0);
            for row in 0..rows.len() {
                let at = row * width + x;
                let inside = (a[at] > low) & (a[at] < high) & (b[at] > low) & (b[at] < high);
                if inside & (still[at] > 0.0) {
                    count[x] += 1.0;
                    of_a[x] += a[at];
                    of_b[x] += b[at];
                }
            }
        }
        let [weight, level, change] = self.to;
        let columns = weight.len();
        let (level, change) = (&mut level[..columns], &mut change[..columns]);
        fold(count, weight);
        fold(of_a, level);
        fold(of_b, change);
        let (gain, offset) = (self.light.gain, self.light.offset - self.light.middle);
        for x in 0..columns {
            let used = weight[x];
            let share = 1.0 / used.max(1.0);
            // A cell of which nothing counts has no weight, whatever it says.
            let lit = gain * (level[x] * share) + offset;
            change[x] = change[x] * share - self.light.middle - lit;
            level[x] = lit;
            weight[x] = used * (1.0 / (CELL * CELL) as f32);
        }
    }
}

/// Sums of four side by side; the last may be of fewer.
#[inline(always)]
pub(super) fn fold(from: &[f32], to: &mut [f32]) {
    let (fours, rest) = from.as_chunks::<4>();
    for (to, [a, b, c, d]) in to.iter_mut().zip(fours) {
        *to = (a + b) + (c + d);
    }
    if let (false, Some(to)) = (rest.is_empty(), to.last_mut()) {
        let mut sum = 0.0;
        for value in rest {
            sum += value;
        }
        *to = sum;
    }
}
