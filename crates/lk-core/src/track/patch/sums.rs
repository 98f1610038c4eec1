//! What is kept of a window: its pixels in memory, and sums over them.

use super::MAX_SIDE;
use crate::simd::{EIGHT, Packed};

/// Blocks of lanes across the widest window.
const MAX_BLOCKS: usize = MAX_SIDE.div_ceil(EIGHT);

/// Cells of the largest window.
pub(super) const MAX_CELLS: usize = MAX_BLOCKS * MAX_SIDE;

/// What a template holds for eight pixels of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Grey levels of `prev`; 0 in the padding.
    pub(super) prev: Packed,
    /// Gradients along x and y; 0 in the padding.
    pub(super) gradient: [Packed; 2],
}

/// Sums over the window of the difference d = next - prev; 0 where they were not asked for.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums {
    /// With the intensity and the gradients.
    pub(crate) products: [f64; 3],
    /// Alone.
    pub(crate) plain: f64,
    /// With the coordinates from the window's centre.
    pub(crate) tilt: [f64; 2],
    /// Squared.
    pub(crate) squared: f64,
}

/// Sums over the window of the intensity a and the gradients x and y; 0 where they were not asked for.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TemplateSums {
    /// Of a, x, y.
    pub(crate) plain: [f64; 3],
    /// Of a, x, y times the x coordinate from the window's centre.
    pub(crate) with_x: [f64; 3],
    /// Of a, x, y times the y coordinate from the window's centre.
    pub(crate) with_y: [f64; 3],
    /// Of aa, ax, ay, xx, xy, yy.
    pub(crate) products: [f64; 6],
    /// Of x and of y, each with its value one row above.
    pub(crate) lagged: [f64; 2],
}
