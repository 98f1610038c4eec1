//! From the flow of a coarse level to that of the next finer one.

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{even_bands, for_each_band};
use crate::simd::{Floats, Kernel, LANES, Simd, SimdLevel, blocks, blocks_mut, dispatch};

use super::padded_plane::{self, PAD, PaddedPlane};

/// Write `scale` times the values of `coarse`, interpolated, into `fine` of the given size: pixel (x, y) of `coarse` sits
/// over (2x, 2y) of `fine`. The scale is 2 from level to level, and 1 within one.
pub(super) fn upsample(
    coarse: &PaddedPlane,
    (width, height): (usize, usize),
    scale: f32,
    fine: &mut PaddedPlane,
    execution: &Execution,
) -> Result<()> {
    fine.resize(width, height)?;
    let level = execution.simd_level();
    for_each_band(
        execution,
        height,
        even_bands(execution, height, [65_536 / width, 16_384 / width]),
        fine.rows_mut(),
        |rows, mut part| {
            for (local, y) in rows.enumerate() {
                row(level, coarse, y, 0..width, scale, part.row_mut(local));
            }
        },
    )
}

/// Columns of row `y` of [`upsample`], from an even one on, padded.
pub(super) fn row(
    level: SimdLevel,
    coarse: &PaddedPlane,
    y: usize,
    columns: Range<usize>,
    scale: f32,
    to: &mut [f32],
) {
    let rows = [y / 2, (y / 2 + y % 2).min(coarse.height() - 1)];
    let kernel = DoubleRow {
        count: columns.len().div_ceil(2 * LANES),
        coarse: rows.map(|y| &coarse.padded(y)[columns.start / 2..]),
        scale,
        to: &mut *to,
    };
    dispatch(level, kernel);
    padded_plane::extend(to, columns.len());
}

/// A row between two of half the size, or on them if they are the same.
struct DoubleRow<'a> {
    count: usize,
    coarse: [&'a [f32]; 2],
    scale: f32,
    to: &'a mut [f32],
}

impl Kernel for DoubleRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.count;
        let [above, below] = self
            .coarse
            .map(|row| [PAD, PAD + 1].map(|at| blocks(row, at, count)));
        let to = blocks_mut(self.to, PAD, 2 * count);
        let (one, two) = (s.splat(0.5 * self.scale), s.splat(0.25 * self.scale));
        for i in 0..count {
            let here = s.get(&above[0][i]) + s.get(&below[0][i]);
            let there = s.get(&above[1][i]) + s.get(&below[1][i]);
            let (first, second) = (one * here).interleave(two * (here + there));
            first.put(&mut to[2 * i]);
            second.put(&mut to[2 * i + 1]);
        }
    }
}
