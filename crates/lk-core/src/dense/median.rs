//! Medians of the flow over nine pixels, by networks of minima and maxima.

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{even_bands, for_each_band};
use crate::simd::{Floats, Kernel, Simd, blocks, blocks_mut, dispatch};

use super::padded_plane::{self, PAD, PaddedPlane};

/// Write the median of each pixel of `from` and its eight neighbours `spacing` pixels away; borders repeat the edge.
///
/// With a spacing of 2 the nine reach as far as all of a window of 5 x 5, at the price of 3 x 3.
pub(super) fn median(
    from: [&PaddedPlane; 2],
    spacing: usize,
    to: [&mut PaddedPlane; 2],
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (from[0].width(), from[0].height());
    let [to_u, to_v] = to;
    to_u.resize(width, height)?;
    to_v.resize(width, height)?;
    let level = execution.simd_level();
    for_each_band(
        execution,
        height,
        even_bands(execution, height, [16_384 / width, 2_048 / width]),
        (to_u.rows_mut(), to_v.rows_mut()),
        |rows, (mut to_u, mut to_v)| {
            for (local, y) in rows.enumerate() {
                let near = [y.saturating_sub(spacing), y, (y + spacing).min(height - 1)];
                for (from, to) in from.iter().zip([&mut to_u, &mut to_v]) {
                    let to = to.row_mut(local);
                    let kernel = MedianRow {
                        count: padded_plane::groups(width),
                        spacing,
                        rows: near.map(|y| from.padded(y)),
                        to: &mut *to,
                    };
                    dispatch(level, kernel);
                    padded_plane::extend(to, width);
                }
            }
        },
    )
}

struct MedianRow<'a> {
    count: usize,
    spacing: usize,
    rows: [&'a [f32]; 3],
    to: &'a mut [f32],
}

/// Exchange so that the smaller stands first, for each pair of a list, unrolled.
macro_rules! exchange {
    ($p:ident: $(($a:literal $b:literal))+) => {$(
        let (x, y) = ($p[$a], $p[$b]);
        $p[$a] = x.min(y);
        $p[$b] = x.max(y);
    )+};
}

impl Kernel for MedianRow<'_> {
    type Output = ();

    /// N. Devillard, "Fast median search", 1998.
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.count;
        let [above, here, below] = self.rows;
        let (left, right) = (PAD - self.spacing, PAD + self.spacing);
        let (a, d, g) = (
            blocks(above, left, count),
            blocks(here, left, count),
            blocks(below, left, count),
        );
        let (b, e, h) = (
            blocks(above, PAD, count),
            blocks(here, PAD, count),
            blocks(below, PAD, count),
        );
        let (c, f, k) = (
            blocks(above, right, count),
            blocks(here, right, count),
            blocks(below, right, count),
        );
        let to = blocks_mut(self.to, PAD, count);
        for i in 0..count {
            let mut p = [
                s.get(&a[i]),
                s.get(&b[i]),
                s.get(&c[i]),
                s.get(&d[i]),
                s.get(&e[i]),
                s.get(&f[i]),
                s.get(&g[i]),
                s.get(&h[i]),
                s.get(&k[i]),
            ];
            exchange!(p: (1 2)(4 5)(7 8)(0 1)(3 4)(6 7)(1 2)(4 5)(7 8)(0 3)(5 8)(4 7)(3 6)(1 4)(2 5)(4 7)(4 2)(6 4)(4 2));
            p[4].put(&mut to[i]);
        }
    }
}
