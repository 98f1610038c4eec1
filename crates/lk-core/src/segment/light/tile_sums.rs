//! Sums over the cells of tiles, and over tiles.

use crate::segment::morphology::Size;
use crate::simd::{Kernel, Simd};

use super::cells::{CELLS, Cells, fold};

/// Of a tile: weights, levels, changes, squares of levels, products; and of the first round alone squares of changes, and
/// of the Laplacians of both pictures their count, squares of the reference's, products, squares of the picture's.
pub(super) const CHANNELS: usize = 10;
/// Those of every round.
pub(super) const ALWAYS: usize = 5;

/// Where cells stand between the middles of two tiles.
const STEPS: [f32; CELLS] = [0.125, 0.375, 0.625, 0.875];

/// The light so far, at the tiles' middles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model<'a> {
    pub(super) size: Size,
    pub(super) slope: &'a [f32],
    pub(super) smooth: &'a [f32],
    pub(super) trust: &'a [f32],
}

impl Model<'_> {
    /// Write the slope or the smooth change at each cell of row `y`.
    #[inline(always)]
    fn row(&self, values: &[f32], y: usize, to: &mut [f32]) {
        let (columns, rows) = self.size;
        let at = (2 * y + 1) as f32 / (2 * CELLS) as f32 - 0.5;
        let above = (at.max(0.0) as usize).min(rows - 1);
        let below = (above + 1).min(rows - 1);
        let down = (at - above as f32).clamp(0.0, 1.0);
        let (above, below) = (
            &values[above * columns..][..columns],
            &values[below * columns..][..columns],
        );
        let mut here = above[0] + (below[0] - above[0]) * down;
        let (first, rest) = to.split_at_mut(to.len().min(CELLS / 2));
        first.fill(here);
        let mut tile = 0;
        let (whole, part) = rest.as_chunks_mut::<CELLS>();
        for to in whole {
            tile = (tile + 1).min(columns - 1);
            let next = above[tile] + (below[tile] - above[tile]) * down;
            for (value, step) in to.iter_mut().zip(STEPS) {
                *value = here + (next - here) * step;
            }
            here = next;
        }
        tile = (tile + 1).min(columns - 1);
        let next = above[tile] + (below[tile] - above[tile]) * down;
        for (value, step) in part.iter_mut().zip(STEPS) {
            *value = here + (next - here) * step;
        }
    }
}

/// The sums of a row of tiles.
pub(super) struct TileSums<'a> {
    pub(super) cells: &'a Cells,
    pub(super) model: Model<'a>,
    /// Its place.
    pub(super) tile: usize,
    /// How far from the light so far a cell may be; everything counts where there is none, and Laplacians too.
    pub(super) limit: Option<f32>,
    pub(super) memory: &'a mut [f32],
    pub(super) to: &'a mut [f32],
}

impl Kernel for TileSums<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let (columns, rows) = self.cells.size;
        let (sums, rest) = self.memory.split_at_mut(CHANNELS * columns);
        let (slope, smooth) = rest.split_at_mut(columns);
        let smooth = &mut smooth[..columns];
        sums.fill(0.0);
        for y in self.tile * CELLS..((self.tile + 1) * CELLS).min(rows) {
            let row = y * columns..(y + 1) * columns;
            let weight = &self.cells.weight[row.clone()];
            let level = &self.cells.level[row.clone()];
            let change = &self.cells.change[row];
            if let Some(limit) = self.limit {
                self.model.row(self.model.slope, y, slope);
                self.model.row(self.model.smooth, y, smooth);
                let share = 1.0 / (limit * limit);
                for x in 0..columns {
                    let left = change[x] - (smooth[x] + slope[x] * level[x]);
                    let near = 1.0 - left * left * share;
                    smooth[x] = weight[x] * if near > 0.0 { near } else { 0.0 };
                }
            } else {
                smooth.copy_from_slice(weight);
                laplacians(self.cells, y, &mut sums[(ALWAYS + 1) * columns..]);
                let squares = &mut sums[ALWAYS * columns..][..columns];
                for x in 0..columns {
                    squares[x] += weight[x] * change[x] * change[x];
                }
            }
            moments(smooth, level, change, &mut sums[..ALWAYS * columns]);
        }
        let channels = if self.limit.is_some() {
            ALWAYS
        } else {
            CHANNELS
        };
        let tiles = self.model.size.0;
        for channel in 0..channels {
            let to = &mut self.to[channel * tiles..][..tiles];
            fold(&sums[channel * columns..][..columns], to);
            if channel < ALWAYS {
                let trust = &self.model.trust[self.tile * tiles..][..tiles];
                for (to, trust) in to.iter_mut().zip(trust) {
                    *to *= trust;
                }
            }
        }
    }
}

/// Add a row of weights and of what they weigh.
#[inline(always)]
fn moments(weight: &[f32], level: &[f32], change: &[f32], sums: &mut [f32]) {
    let columns = weight.len();
    let (level, change) = (&level[..columns], &change[..columns]);
    let (of_weight, rest) = sums.split_at_mut(columns);
    let (of_level, rest) = rest.split_at_mut(columns);
    let (of_change, rest) = rest.split_at_mut(columns);
    let (of_square, of_product) = rest.split_at_mut(columns);
    let of_product = &mut of_product[..columns];
    for x in 0..columns {
        let (w, a, d) = (weight[x], level[x], change[x]);
        of_weight[x] += w;
        of_level[x] += w * a;
        of_change[x] += w * d;
        of_square[x] += w * a * a;
        of_product[x] += w * a * d;
    }
}

/// Add what the Laplacians of a row have, where all five cells count.
#[inline(always)]
fn laplacians(cells: &Cells, y: usize, sums: &mut [f32]) {
    let (columns, rows) = cells.size;
    if y == 0 || y + 1 >= rows || columns < 3 {
        return;
    }
    let inner = columns - 2;
    let start = y * columns;
    let (count, rest) = sums.split_at_mut(columns);
    let (of_aa, rest) = rest.split_at_mut(columns);
    let (of_ab, of_bb) = rest.split_at_mut(columns);
    let (count, of_aa) = (&mut count[1..=inner], &mut of_aa[1..=inner]);
    let (of_ab, of_bb) = (&mut of_ab[1..=inner], &mut of_bb[1..=inner]);
    let w = Cross::of(&cells.weight, start, columns);
    let a = Cross::of(&cells.level, start, columns);
    let d = Cross::of(&cells.change, start, columns);
    for x in 0..inner {
        let least = w.here[x]
            .min(w.left[x])
            .min(w.right[x])
            .min(w.above[x])
            .min(w.below[x]);
        let of_a = a.laplacian(x);
        let of_b = of_a + d.laplacian(x);
        let (one, of_a, of_b) = if least > 0.5 {
            (1.0, of_a, of_b)
        } else {
            (0.0, 0.0, 0.0)
        };
        count[x] += one;
        of_aa[x] += of_a * of_a;
        of_ab[x] += of_a * of_b;
        of_bb[x] += of_b * of_b;
    }
}

/// The inner cells of a row and those beside them.
struct Cross<'a> {
    here: &'a [f32],
    left: &'a [f32],
    right: &'a [f32],
    above: &'a [f32],
    below: &'a [f32],
}

impl<'a> Cross<'a> {
    #[inline(always)]
    fn of(plane: &'a [f32], start: usize, columns: usize) -> Self {
        let inner = columns - 2;
        Self {
            here: &plane[start + 1..][..inner],
            left: &plane[start..][..inner],
            right: &plane[start + 2..][..inner],
            above: &plane[start + 1 - columns..][..inner],
            below: &plane[start + 1 + columns..][..inner],
        }
    }

    #[inline(always)]
    fn laplacian(&self, x: usize) -> f32 {
        4.0 * self.here[x] - ((self.left[x] + self.right[x]) + (self.above[x] + self.below[x]))
    }
}

/// How far the cells of a row are from the light.
pub(super) struct Misfit<'a> {
    pub(super) model: Model<'a>,
    /// Weights, levels and changes.
    pub(super) planes: [&'a [f32]; 3],
    pub(super) y: usize,
    pub(super) memory: &'a mut [f32],
    pub(super) to: &'a mut [f32],
}

impl Kernel for Misfit<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let columns = self.to.len();
        let (slope, smooth) = self.memory.split_at_mut(columns);
        self.model.row(self.model.slope, self.y, slope);
        self.model.row(self.model.smooth, self.y, smooth);
        let [weight, level, change] = self.planes;
        let (weight, level, change) = (&weight[..columns], &level[..columns], &change[..columns]);
        for x in 0..columns {
            let left = change[x] - (smooth[x] + slope[x] * level[x]);
            self.to[x] = if weight[x] >= 0.5 {
                left.abs()
            } else {
                f32::NAN
            };
        }
    }
}

/// Sum the tiles within `reach` along both axes, as far as there are any, for the first `channels` of [`CHANNELS`].
pub(super) struct Boxed<'a> {
    pub(super) from: &'a [f32],
    pub(super) spare: &'a mut [f32],
    pub(super) to: &'a mut [f32],
    pub(super) size: Size,
    pub(super) channels: usize,
    pub(super) reach: usize,
}

impl Kernel for Boxed<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let ((columns, rows), reach) = (self.size, self.reach);
        let (stride, wide) = (CHANNELS * columns, self.channels * columns);
        for y in 0..rows {
            let sums = &mut self.spare[..wide];
            sums.fill(0.0);
            for row in y.saturating_sub(reach)..(y + reach + 1).min(rows) {
                for (sum, value) in sums.iter_mut().zip(&self.from[row * stride..][..wide]) {
                    *sum += value;
                }
            }
            let to = &mut self.to[y * stride..][..wide];
            for (row, to) in sums.chunks_exact(columns).zip(to.chunks_exact_mut(columns)) {
                to.copy_from_slice(row);
                for step in 1..=reach.min(columns - 1) {
                    for (to, value) in to.iter_mut().zip(&row[step..]) {
                        *to += value;
                    }
                    for (to, value) in to[step..].iter_mut().zip(row) {
                        *to += value;
                    }
                }
            }
        }
    }
}
