//! From the flow of a coarse level to that of the next finer one.

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{even_bands, for_each_band};

use super::grid::{self, Grid, PAD};

/// Write `scale` times the values of `coarse`, interpolated, into `fine` of the given size: pixel (x, y) of `coarse` sits
/// over (2x, 2y) of `fine`. The scale is 2 from level to level, and 1 within one.
pub(super) fn upsample(
    coarse: &Grid,
    (width, height): (usize, usize),
    scale: f32,
    fine: &mut Grid,
    execution: &Execution,
) -> Result<()> {
    fine.resize(width, height);
    for_each_band(
        execution,
        height,
        even_bands(execution, height, [65_536 / width, 16_384 / width]),
        fine.rows_mut(),
        |rows, mut part| {
            for (local, y) in rows.enumerate() {
                row(coarse, y, 0..width, scale, part.row_mut(local));
            }
        },
    )
}

/// Columns of row `y` of [`upsample`], from an even one on, padded.
pub(super) fn row(coarse: &Grid, y: usize, columns: Range<usize>, scale: f32, to: &mut [f32]) {
    let a = coarse.padded(y / 2);
    let b = coarse.padded((y / 2 + y % 2).min(coarse.height() - 1));
    let (half, first) = (columns.len().div_ceil(2), PAD + columns.start / 2);
    let (a, b) = (&a[first..=first + half], &b[first..=first + half]);
    let (pairs, _) = to[PAD..].as_chunks_mut::<2>();
    let pairs = &mut pairs[..half];
    let (one, two) = (0.5 * scale, 0.25 * scale);
    for x in 0..half {
        let (here, there) = (a[x] + b[x], a[x + 1] + b[x + 1]);
        pairs[x] = [one * here, two * (here + there)];
    }
    grid::extend(to, columns.len());
}
