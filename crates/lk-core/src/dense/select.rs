//! Shiftable windows: a pixel takes the flow of the neighbour whose window fits best.
//!
//! A window that straddles the edge of a moving thing mixes two motions; one a little to the side does not.

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::for_each_band;
use crate::simd::{Floats, LANES, LaneKernel, Simd, dispatch_lanes};

use super::grid::{self, Grid, PAD};

/// Write to `to` the flow of `from` at the best of the pixel itself and its eight neighbours `distance` pixels away,
/// which must have less than the share `better` of the pixel's own energy.
pub(super) fn select(
    from: (&Grid, &Grid),
    energy: &Grid,
    distance: usize,
    better: f32,
    to: (&mut Grid, &mut Grid),
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (energy.width(), energy.height());
    to.0.resize(width, height);
    to.1.resize(width, height);
    let level = execution.simd_level();
    for_each_band(
        execution,
        height,
        (32_768 / width).max(1),
        (to.0.rows_mut(), to.1.rows_mut()),
        |rows, (mut to_u, mut to_v)| {
            for (local, y) in rows.enumerate() {
                let near = [
                    y.saturating_sub(distance),
                    y,
                    (y + distance).min(height - 1),
                ];
                let (to_u, to_v) = (to_u.row_mut(local), to_v.row_mut(local));
                let kernel = SelectRow {
                    width,
                    u: near.map(|y| from.0.padded(y)),
                    v: near.map(|y| from.1.padded(y)),
                    energy: near.map(|y| energy.padded(y)),
                    distance,
                    better,
                    to: [&mut *to_u, &mut *to_v],
                };
                dispatch_lanes(level, kernel);
                grid::extend(to_u, width);
                grid::extend(to_v, width);
            }
        },
    )
}

struct SelectRow<'a> {
    width: usize,
    u: [&'a [f32]; 3],
    v: [&'a [f32]; 3],
    energy: [&'a [f32]; 3],
    distance: usize,
    better: f32,
    to: [&'a mut [f32]; 2],
}

impl LaneKernel for SelectRow<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let [to_u, to_v] = self.to;
        let better = s.splat(self.better);
        for x in (0..self.width).step_by(LANES) {
            let at = PAD + x;
            let mut best = s.load(self.energy[1], at) * better;
            let (mut best_u, mut best_v) = (s.load(self.u[1], at), s.load(self.v[1], at));
            for row in 0..3 {
                for column in 0..3 {
                    if row == 1 && column == 1 {
                        continue;
                    }
                    let from = at + column * self.distance - self.distance;
                    let other = s.load(self.energy[row], from);
                    let wins = other.lt(best);
                    best = S::F::select(wins, other, best);
                    best_u = S::F::select(wins, s.load(self.u[row], from), best_u);
                    best_v = S::F::select(wins, s.load(self.v[row], from), best_v);
                }
            }
            best_u.store(to_u, at);
            best_v.store(to_v, at);
        }
    }
}
