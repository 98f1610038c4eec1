//! The linear system of a refinement, relaxed red and black in turn (successive over-relaxation) in one pass over the
//! rows.
//!
//! Half-sweep `k` runs one row behind half-sweep `k - 1`, so that a few rows at a time are all that is kept, and in the
//! cache. Rows are split into even and odd pixels: in each row one of the two is red. A half-sweep reads pixels that it
//! does not write, so that threads cannot change a bit. At the border the picture is mirrored.
//!
//! `docs/explanation/algorithms.md`, section "Refinement".

use std::ops::Range;

use crate::simd::{Floats, Kernel, Simd, SimdLevel, blocks, blocks_mut, dispatch};

use super::half_sweep::{HalfSweep, Join};
use super::padded_plane::PAD;
use super::sum_down::Split;
use super::tiles::Columns;
use super::trend::Slopes;

/// Quantities of a pixel besides the flow: half the weight of smoothness, by whose sum two neighbours are joined; the
/// matrix, later its inverse (xx, xy, yy); the right side.
const SYSTEM: usize = 6;
const SMOOTH: usize = 0;

/// One row to fill, even pixels and odd ones of: u, v, and the [`SYSTEM`] quantities.
pub(super) type Row<'a> = [[&'a mut [f32]; 2]; 2 + SYSTEM];

/// The rows under way.
pub(super) struct Rows<'a> {
    level: SimdLevel,
    width: usize,
    height: usize,
    slots: usize,
    relaxation: f32,
    /// What u and v change by from an element to the next where they are smooth.
    slopes: Slopes,
    split: Split,
    /// u and v.
    flow: &'a mut [f32],
    system: &'a mut [f32],
}

impl<'a> Rows<'a> {
    /// Rows that must be kept: one for each half-sweep and its neighbours.
    fn slots(halves: usize) -> usize {
        halves + 3
    }

    /// Elements that are under way for each column.
    pub(super) fn floats(halves: usize) -> usize {
        Self::slots(halves) * (2 + SYSTEM)
    }

    /// Elements of memory for as many columns.
    pub(super) fn size(width: usize, halves: usize) -> usize {
        Self::slots(halves) * (2 + SYSTEM) * 2 * Split::of(width).half
    }

    pub(super) fn new(
        level: SimdLevel,
        (width, height): (usize, usize),
        halves: usize,
        (relaxation, slopes): (f32, Slopes),
        memory: &'a mut [f32],
    ) -> Self {
        let (split, slots) = (Split::of(width), Self::slots(halves));
        let (flow, system) = memory.split_at_mut(slots * 4 * split.half);
        Self {
            level,
            width,
            height,
            slots,
            relaxation,
            slopes,
            split,
            flow,
            system,
        }
    }

    /// Row `y`, to fill.
    pub(super) fn next(&mut self, y: usize) -> Row<'_> {
        let (slot, half) = (y % self.slots, self.split.half);
        let flow = &mut self.flow[slot * 4 * half..][..4 * half];
        let system = &mut self.system[slot * SYSTEM * 2 * half..][..SYSTEM * 2 * half];
        let mut parts = flow
            .chunks_exact_mut(half)
            .chain(system.chunks_exact_mut(half));
        std::array::from_fn(|_| std::array::from_fn(|_| parts.next().unwrap_or_default()))
    }

    /// Mirror the flow and the smoothness of row `y`, which has been filled.
    pub(super) fn border(&mut self, y: usize) {
        let (slot, half, width) = (y % self.slots, self.split.half, self.width);
        let flow = &mut self.flow[slot * 4 * half..][..4 * half];
        let smooth = &mut self.system[(slot * SYSTEM + SMOOTH) * 2 * half..][..2 * half];
        let steps = [self.slopes[0][0], self.slopes[1][0], 0.0];
        for (row, step) in flow.chunks_exact_mut(2 * half).chain([smooth]).zip(steps) {
            let (even, odd) = row.split_at_mut(half);
            mirror(even, 0, width, step);
            mirror(odd, 1, width, step);
        }
    }

    /// Rows above and below `y`.
    fn neighbours(&self, y: usize) -> [usize; 2] {
        let above = if y == 0 { 1 } else { y - 1 };
        let below = if y + 1 == self.height { y - 1 } else { y + 1 };
        [above, below]
    }

    /// Join the pixels of row `y` to their neighbours and invert their matrices.
    fn close(&mut self, y: usize) {
        let [above, below] = self.neighbours(y);
        let (slots, size) = (self.slots, SYSTEM * 2 * self.split.half);
        let (here, [above, below]) =
            around(self.system, size, [y, above, below].map(|y| y % slots));
        let kernel = Join {
            split: self.split,
            smooth: [above, below],
            slopes: self.slopes,
            // Beyond the first and the last row stands the mirrored one, which lies on the other side.
            sides: [y == 0, y + 1 == self.height].map(|outside| if outside { -1.0 } else { 1.0 }),
            here,
        };
        dispatch(self.level, kernel);
    }

    /// Relax every second pixel of row `y`, as the `half`-th half-sweep does.
    fn half_sweep(&mut self, half: usize, y: usize) {
        let [above, below] = self.neighbours(y);
        let (slots, row) = (self.slots, 2 * self.split.half);
        let places = [y, above, below].map(|y| y % slots);
        let (here, near) = around(self.flow, 2 * row, places);
        let system = |place: usize| &self.system[place * SYSTEM * row..][..SYSTEM * row];
        let first = (y + half) % 2;
        let kernel = HalfSweep {
            split: self.split,
            first,
            smooth: [system(places[1]), system(places[2])],
            system: system(places[0]),
            near,
            relaxation: self.relaxation,
            flow: &mut *here,
        };
        dispatch(self.level, kernel);
        for (axis, slopes) in here.chunks_exact_mut(row).zip(self.slopes) {
            mirror(
                &mut axis[first * self.split.half..][..self.split.half],
                first,
                self.width,
                slopes[0],
            );
        }
    }

    /// Relax what can be relaxed once row `lead` is filled, where `band` and as many rows beyond it as its sweeps depend on
    /// are wanted. Returns the row that is done, if it is one of the band.
    pub(super) fn follow(
        &mut self,
        lead: usize,
        band: &Range<usize>,
        halves: usize,
    ) -> Option<usize> {
        // How far beyond the band a row must be up to date: less from half-sweep to half-sweep.
        let height = self.height;
        let within = |y: usize, margin: usize| {
            y + margin >= band.start && y < (band.end + margin).min(height)
        };
        let y = lead.checked_sub(1)?;
        if within(y, halves.saturating_sub(1)) {
            self.close(y);
        }
        for half in 0..halves.min(y + 1) {
            if within(y - half, halves - 1 - half) {
                self.half_sweep(half, y - half);
            }
        }
        lead.checked_sub(halves.max(1))
            .filter(|done| band.contains(done))
    }

    /// Write the columns of row `y` that are wanted into padded rows.
    pub(super) fn write(&self, y: usize, columns: Columns, to: [&mut [f32]; 2]) {
        let row = 2 * self.split.half;
        let flow = &self.flow[(y % self.slots) * 2 * row..][..2 * row];
        for (to, from) in to.into_iter().zip(flow.chunks_exact(row)) {
            let kernel = Interleave {
                half: self.split.half,
                columns,
                from,
                to,
            };
            dispatch(self.level, kernel);
        }
    }
}

/// Mirror the pixels of one half of a split row (`odd` is 0 or 1) into the places that neighbours look at, on a slope of
/// `step` from pixel to pixel.
fn mirror(row: &mut [f32], odd: usize, width: usize, step: f32) {
    if odd == 1 {
        row[PAD - 1] = row[PAD] - 2.0 * step;
    }
    // The pixel right of the last one, if it belongs to this half.
    if width % 2 == odd {
        let at = PAD + width / 2;
        row[at] = row[at - 1] + 2.0 * step;
    }
}

/// One of the rows of `size` elements to write, and two others to read.
fn around(
    rows: &mut [f32],
    size: usize,
    [here, above, below]: [usize; 3],
) -> (&mut [f32], [&[f32]; 2]) {
    let (before, rest) = rows.split_at_mut(here * size);
    let (row, after) = rest.split_at_mut(size);
    let (before, after) = (&*before, &*after);
    let other = |place: usize| {
        if place < here {
            &before[place * size..][..size]
        } else {
            &after[(place - here - 1) * size..][..size]
        }
    };
    (row, [other(above), other(below)])
}

/// Even and odd pixels in turn.
struct Interleave<'a> {
    half: usize,
    columns: Columns,
    from: &'a [f32],
    to: &'a mut [f32],
}

impl Kernel for Interleave<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let (first, count) = (PAD + self.columns.skipped(), self.columns.groups());
        let (even, odd) = (
            blocks(self.from, first, count),
            blocks(self.from, self.half + first, count),
        );
        let to = blocks_mut(self.to, PAD, 2 * count);
        for i in 0..count {
            let (first, second) = s.get(&even[i]).interleave(s.get(&odd[i]));
            first.put(&mut to[2 * i]);
            second.put(&mut to[2 * i + 1]);
        }
    }
}
