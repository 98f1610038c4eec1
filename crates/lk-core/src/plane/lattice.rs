//! Where the tiles of a plane lie: over what both frames show, half-way between them.

use super::tile::{LARGEST, REACH};
use crate::simd::EIGHT;

/// Frames whose shorter side has at most so many pixels get tiles of this side.
const SIDES: [(usize, usize); 3] = [(56, EIGHT), (130, 2 * EIGHT), (340, 3 * EIGHT)];

/// The tiles of one level: their side, and the middles of their columns and rows.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    pub(super) side: usize,
    columns: Vec<f64>,
    rows: Vec<f64>,
}

impl Lattice {
    /// Of frames of this size, in which the middle moves by `displacement`; all in pixels of the level.
    pub(super) fn new([width, height]: [usize; 2], displacement: [f64; 2]) -> Self {
        let shorter = width.min(height);
        let side = SIDES
            .iter()
            .find(|(size, _)| shorter <= *size)
            .map_or(LARGEST, |(_, side)| *side);
        Self {
            side,
            columns: middles(width, side, displacement[0]),
            rows: middles(height, side, displacement[1]),
        }
    }

    /// Tiles in a row.
    pub(super) fn across(&self) -> usize {
        self.columns.len()
    }

    pub(super) fn len(&self) -> usize {
        self.columns.len() * self.rows.len()
    }

    /// Middle of tile `index`, row by row.
    pub(super) fn middle(&self, index: usize) -> [f64; 2] {
        let across = self.columns.len();
        [self.columns[index % across], self.rows[index / across]]
    }
}

/// Middles of as many tiles as fit beside each other into what both frames show.
fn middles(size: usize, side: usize, displacement: f64) -> Vec<f64> {
    // Rounding to whole pixels and what turns need a pixel more.
    let from = 0.5 * displacement.abs() + (REACH + 1) as f64;
    let room = size as f64 - 1.0 - 2.0 * from;
    let count = (room / side as f64).floor();
    if count.is_nan() || count < 1.0 {
        return Vec::new();
    }
    let pitch = room / count;
    (0..count as usize)
        .map(|index| from + (index as f64 + 0.5) * pitch)
        .collect()
}
