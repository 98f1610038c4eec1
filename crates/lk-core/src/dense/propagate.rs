//! Shiftable windows: a pixel takes the flow of the neighbour whose window fits best.
//!
//! A window that straddles the edge of a moving thing mixes two motions; one a little to the side does not.
//!
//! `docs/explanation/algorithms.md`, section "A step".

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{even_bands, for_each_band};
use crate::simd::{Floats, Kernel, LANES, Simd, blocks, blocks_mut, dispatch};

use super::padded_plane::{self, PAD, PaddedPlane};
use super::trend::Slopes;

/// Write to `to` the flow of `from` at the best of the pixel itself and its eight neighbours `distance` elements away,
/// which must have less than the share `better` of the pixel's own energy. What is taken from a neighbour is brought here
/// along `slopes`, what u and v change by from an element to the next.
pub(super) fn propagate(
    from: (&PaddedPlane, &PaddedPlane),
    energy: &PaddedPlane,
    (distance, slopes): (usize, Slopes),
    better: f32,
    to: (&mut PaddedPlane, &mut PaddedPlane),
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (energy.width(), energy.height());
    to.0.resize(width, height)?;
    to.1.resize(width, height)?;
    let level = execution.simd_level();
    let slopes = slopes.map(|axis| axis.map(|slope| slope * distance as f32));
    for_each_band(
        execution,
        height,
        even_bands(execution, height, [16_384 / width, 2_048 / width]),
        (to.0.rows_mut(), to.1.rows_mut()),
        |rows, (mut to_u, mut to_v)| {
            for (local, y) in rows.enumerate() {
                let near = [
                    y.saturating_sub(distance),
                    y,
                    (y + distance).min(height - 1),
                ];
                let (to_u, to_v) = (to_u.row_mut(local), to_v.row_mut(local));
                let kernel = PropagateRow {
                    count: padded_plane::groups(width),
                    u: near.map(|y| from.0.padded(y)),
                    v: near.map(|y| from.1.padded(y)),
                    energy: near.map(|y| energy.padded(y)),
                    distance,
                    slopes,
                    better,
                    to: [&mut *to_u, &mut *to_v],
                };
                dispatch(level, kernel);
                padded_plane::extend(to_u, width);
                padded_plane::extend(to_v, width);
            }
        },
    )
}

struct PropagateRow<'a> {
    count: usize,
    u: [&'a [f32]; 3],
    v: [&'a [f32]; 3],
    energy: [&'a [f32]; 3],
    distance: usize,
    /// What u and v change by over the distance.
    slopes: Slopes,
    better: f32,
    to: [&'a mut [f32]; 2],
}

/// The pixel's group of lanes, then those of its neighbours, in the order in which ties are settled.
type Around<'a> = [&'a [[f32; LANES]]; 9];

/// Where each of them stands.
const STANDS: [[f32; 2]; 9] = [
    [0.0, 0.0],
    [-1.0, -1.0],
    [0.0, -1.0],
    [1.0, -1.0],
    [-1.0, 0.0],
    [1.0, 0.0],
    [-1.0, 1.0],
    [0.0, 1.0],
    [1.0, 1.0],
];

impl PropagateRow<'_> {
    #[inline(always)]
    fn around<'b>(&self, [above, here, below]: [&'b [f32]; 3]) -> Around<'b> {
        let (count, distance) = (self.count, self.distance);
        [
            blocks(here, PAD, count),
            blocks(above, PAD - distance, count),
            blocks(above, PAD, count),
            blocks(above, PAD + distance, count),
            blocks(here, PAD - distance, count),
            blocks(here, PAD + distance, count),
            blocks(below, PAD - distance, count),
            blocks(below, PAD, count),
            blocks(below, PAD + distance, count),
        ]
    }
}

impl Kernel for PropagateRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.count;
        let energy = self.around(self.energy);
        let (u, v) = (self.around(self.u), self.around(self.v));
        let [to_u, to_v] = self.to;
        let (to_u, to_v) = (blocks_mut(to_u, PAD, count), blocks_mut(to_v, PAD, count));
        let better = s.splat(self.better);
        let along = STANDS.map(|[x, y]| self.slopes.map(|slopes| slopes[0] * x + slopes[1] * y));
        for i in 0..count {
            let mut best = s.get(&energy[0][i]) * better;
            let (mut best_u, mut best_v) = (s.get(&u[0][i]), s.get(&v[0][i]));
            macro_rules! neighbour {
                ($($k:literal)+) => {$(
                    let other = s.get(&energy[$k][i]);
                    let wins = other.lt(best);
                    best = S::F::select(wins, other, best);
                    let [along_u, along_v] = along[$k];
                    best_u = S::F::select(wins, s.get(&u[$k][i]) - s.splat(along_u), best_u);
                    best_v = S::F::select(wins, s.get(&v[$k][i]) - s.splat(along_v), best_v);
                )+};
            }
            neighbour!(1 2 3 4 5 6 7 8);
            let _ = best;
            best_u.put(&mut to_u[i]);
            best_v.put(&mut to_v[i]);
        }
    }
}
