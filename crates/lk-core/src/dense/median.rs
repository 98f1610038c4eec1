//! Medians of the flow over small windows, by networks of minima and maxima.

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::for_each_band;
use crate::simd::{Floats, LANES, LaneKernel, Simd, dispatch_lanes};

use super::grid::{self, Grid, PAD};

/// Write the median of each `size` x `size` window (3 or 5) of `from`; borders repeat the edge.
pub(super) fn median(from: &Grid, size: usize, to: &mut Grid, execution: &Execution) -> Result<()> {
    let (width, height) = (from.width(), from.height());
    to.resize(width, height);
    let level = execution.simd_level();
    let near =
        |y: usize, offset: isize| from.padded(y.saturating_add_signed(offset).min(height - 1));
    for_each_band(
        execution,
        height,
        (16_384 / width).max(1),
        to.rows_mut(),
        |rows, mut part| {
            for (local, y) in rows.enumerate() {
                let to = part.row_mut(local);
                if size == 3 {
                    let rows = [-1, 0, 1].map(|offset| near(y, offset));
                    dispatch_lanes(
                        level,
                        Median9 {
                            width,
                            rows,
                            to: &mut *to,
                        },
                    );
                } else {
                    let rows = [-2, -1, 0, 1, 2].map(|offset| near(y, offset));
                    dispatch_lanes(
                        level,
                        Median25 {
                            width,
                            rows,
                            to: &mut *to,
                        },
                    );
                }
                grid::extend(to, width);
            }
        },
    )
}

struct Median9<'a> {
    width: usize,
    rows: [&'a [f32]; 3],
    to: &'a mut [f32],
}

struct Median25<'a> {
    width: usize,
    rows: [&'a [f32]; 5],
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

impl LaneKernel for Median9<'_> {
    /// N. Devillard, "Fast median search", 1998.
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        for x in (0..self.width).step_by(LANES) {
            let mut p = [s.splat(0.0); 9];
            for (k, value) in p.iter_mut().enumerate() {
                *value = s.load(self.rows[k / 3], PAD + x + k % 3 - 1);
            }
            exchange!(p: (1 2)(4 5)(7 8)(0 1)(3 4)(6 7)(1 2)(4 5)(7 8)(0 3)(5 8)(4 7)(3 6)(1 4)(2 5)(4 7)(4 2)(6 4)(4 2));
            p[4].store(self.to, PAD + x);
        }
    }
}

impl LaneKernel for Median25<'_> {
    /// The same author's network of 99 exchanges.
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        for x in (0..self.width).step_by(LANES) {
            let mut p = [s.splat(0.0); 25];
            for (k, value) in p.iter_mut().enumerate() {
                *value = s.load(self.rows[k / 5], PAD + x + k % 5 - 2);
            }
            exchange!(p:
                (0 1)(3 4)(2 4)(2 3)(6 7)(5 7)(5 6)(9 10)(8 10)(8 9)(12 13)(11 13)(11 12)(15 16)(14 16)(14 15)(18 19)
                (17 19)(17 18)(21 22)(20 22)(20 21)(23 24)(2 5)(3 6)(0 6)(0 3)(4 7)(1 7)(1 4)(11 14)(8 14)(8 11)(12 15)
                (9 15)(9 12)(13 16)(10 16)(10 13)(20 23)(17 23)(17 20)(21 24)(18 24)(18 21)(19 22)(8 17)(9 18)(0 18)
                (0 9)(10 19)(1 19)(1 10)(11 20)(2 20)(2 11)(12 21)(3 21)(3 12)(13 22)(4 22)(4 13)(14 23)(5 23)(5 14)
                (15 24)(6 24)(6 15)(7 16)(7 19)(13 21)(15 23)(7 13)(7 15)(1 9)(3 11)(5 17)(11 17)(9 17)(4 10)(6 12)
                (7 14)(4 6)(4 7)(12 14)(10 14)(6 7)(10 12)(6 10)(6 17)(12 17)(7 17)(7 10)(12 18)(7 12)(10 18)(12 20)
                (10 20)(10 12));
            p[12].store(self.to, PAD + x);
        }
    }
}
