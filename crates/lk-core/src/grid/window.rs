//! One window of `prev`: its pixels, tile by tile, so that a vector of sixteen is a tile of four by four.

use super::frames::{Frames, REACH};
use crate::error::Result;
use crate::memory::{reserve, resize};
use crate::simd::LANES;

/// Pixels along a side of a tile.
pub(super) const TILE: usize = 4;

/// What memory for a window holds.
const WINDOW: &str = "a window";

/// The places of the pixels of a window, the same for all of them.
#[derive(Debug, Clone)]
pub(super) struct Pattern {
    /// Pixels along a side.
    pub(super) side: usize,
    /// Pixels from the centre to the outermost pixel's.
    pub(super) half: f64,
    /// Tiles along a side.
    pub(super) across: usize,
    /// The place of each pixel, from -1 to 1.
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    /// 1 for the pixels of the window, 0 for those that fill its last tiles.
    inside: Vec<f32>,
}

impl Pattern {
    /// Of a window of `side` by `side` pixels, which is two or more.
    pub(super) fn new(side: usize) -> Result<Self> {
        let across = side.div_ceil(TILE);
        let half = 0.5 * (side as f64 - 1.0);
        let count = across * across * LANES;
        let mut pattern = Self {
            side,
            half,
            across,
            x: Vec::new(),
            y: Vec::new(),
            inside: Vec::new(),
        };
        for memory in [&mut pattern.x, &mut pattern.y, &mut pattern.inside] {
            reserve(WINDOW, memory, count)?;
        }
        for tile in 0..across * across {
            for lane in 0..LANES {
                let x = tile % across * TILE + lane % TILE;
                let y = tile / across * TILE + lane / TILE;
                pattern.x.push(((x as f64 - half) / half) as f32);
                pattern.y.push(((y as f64 - half) / half) as f32);
                pattern
                    .inside
                    .push(if x < side && y < side { 1.0 } else { 0.0 });
            }
        }
        Ok(pattern)
    }

    /// Pixels, with those that fill the last tiles.
    pub(super) fn len(&self) -> usize {
        self.x.len()
    }
}

/// The pixels of one window; memory is kept from window to window.
#[derive(Debug, Default)]
pub(super) struct Window {
    /// Grey levels of `prev` and their derivatives.
    pub(super) template: Vec<f32>,
    pub(super) slope_x: Vec<f32>,
    pub(super) slope_y: Vec<f32>,
    /// 1 where a pixel counts in `prev`, else 0.
    counts: Vec<f32>,
    /// 1 where a pixel counts in both frames, else 0.
    pub(super) met: Vec<f32>,
    /// How much it counts in the least squares.
    pub(super) weight: Vec<f32>,
    /// What is left of the difference of both frames.
    pub(super) residual: Vec<f32>,
    /// Sizes of residuals, to find their median.
    pub(super) sizes: Vec<f32>,
    /// Pixels that count.
    pub(super) counted: f64,
    /// Whether all pixels of `prev` count.
    whole: bool,
}

impl Window {
    /// Take the window whose first pixel is at (left, top).
    pub(super) fn take(
        &mut self,
        frames: &Frames,
        pattern: &Pattern,
        [left, top]: [usize; 2],
    ) -> Result<()> {
        for memory in [
            &mut self.template,
            &mut self.slope_x,
            &mut self.slope_y,
            &mut self.counts,
            &mut self.met,
            &mut self.weight,
            &mut self.residual,
        ] {
            resize(WINDOW, memory, pattern.len(), 0.0)?;
        }
        reserve(WINDOW, &mut self.sizes, pattern.len())?;
        let planes = [
            (&frames.prev, &mut self.template),
            (&frames.slopes[0], &mut self.slope_x),
            (&frames.slopes[1], &mut self.slope_y),
        ];
        for (plane, to) in planes {
            for (tile, to) in to.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
                let x = left + tile % pattern.across * TILE;
                let y = top + tile / pattern.across * TILE;
                for (row, to) in to.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
                    // What fills the last tiles may stand beyond the frame.
                    let row = plane.row((y + row).min(plane.height() - 1));
                    match row.get(x..x + TILE) {
                        Some(from) => to.copy_from_slice(from),
                        None => {
                            for (column, to) in to.iter_mut().enumerate() {
                                *to = row[(x + column).min(row.len() - 1)];
                            }
                        }
                    }
                }
            }
        }
        self.counts.copy_from_slice(&pattern.inside);
        let place = [left, top].map(|at| at as isize - REACH as isize);
        let side = pattern.side + 2 * REACH;
        self.whole = frames
            .prev_support
            .has_all((place[0], place[1]), side, side);
        if !self.whole {
            self.leave_out(frames, pattern, [left, top]);
        }
        Ok(())
    }

    /// Leave out what does not count in `prev`.
    fn leave_out(&mut self, frames: &Frames, pattern: &Pattern, [left, top]: [usize; 2]) {
        for (at, counts) in self.counts.iter_mut().enumerate() {
            let [x, y] = place(pattern, at);
            if *counts > 0.0 && !frames.is_read([left + x, top + y]) {
                *counts = 0.0;
            }
        }
    }

    /// Take the weights of pixels that count in both frames, where pixel `at` is sampled at `sampled(at)` in `next`; `near`
    /// says that all of them are well within what counts there.
    pub(super) fn meet(
        &mut self,
        frames: &Frames,
        near: bool,
        sampled: impl Fn(usize) -> [f64; 2],
    ) {
        self.met.copy_from_slice(&self.counts);
        if !near {
            for (at, met) in self.met.iter_mut().enumerate() {
                if *met > 0.0 && !frames.is_sampled(sampled(at)) {
                    *met = 0.0;
                }
            }
        }
        self.weight.copy_from_slice(&self.met);
        self.counted = self.met.iter().sum::<f32>().into();
    }
}

/// Column and row of a pixel within its window.
pub(super) fn place(pattern: &Pattern, at: usize) -> [usize; 2] {
    let (tile, lane) = (at / LANES, at % LANES);
    [
        tile % pattern.across * TILE + lane % TILE,
        tile / pattern.across * TILE + lane / TILE,
    ]
}
