//! Grey levels between pixels: separable filters with the same weights for every pixel of a window.
//!
//! `docs/explanation/algorithms.md`, section "Sampling and gradients".

use super::region::{Region, Rows, SPLINE_TAPS};
use crate::simd::{EIGHT, Eight};

/// How grey levels between pixels are had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sampling {
    /// Linearly, the template too, with Scharr's gradients: as Bouguet's and OpenCV's trackers have it.
    Bouguet,
    /// Linearly, and the template at whole pixels: cheap, but it blurs more the further the offset is from a pixel.
    Linear,
    /// By the cubic B-spline without its prefilter: it smooths alike at every offset, so that the offset leaves no
    /// bias.
    Spline,
}

/// Eight columns of a region, filtered row by row from the top.
pub(super) trait Filtered<L> {
    /// Those of the taps along one axis.
    type Weights;

    /// The samples of the next row. Mark the implementation `#[inline(always)]`: a closure in its place would not be
    /// compiled with the level's instructions.
    fn below(&mut self, wx: &Self::Weights, wy: &Self::Weights) -> L;
}

/// The weights of the four pixels around a position `f` after the second of them.
#[inline(always)]
pub(super) fn spline_weights<L: Eight>(f: f32) -> [L; SPLINE_TAPS] {
    let g = 1.0 - f;
    let sixth = 1.0 / 6.0;
    [
        L::splat(g * g * g * sixth),
        L::splat((f * f * (3.0 * f - 6.0) + 4.0) * sixth),
        L::splat((g * g * (3.0 * g - 6.0) + 4.0) * sixth),
        L::splat(f * f * f * sixth),
    ]
}

/// Pixels of a row that eight samples of the spline take.
const SPLINE_REACH: usize = EIGHT + SPLINE_TAPS - 1;

/// Eight columns of a region, filtered by the spline row by row from the top.
pub(super) struct Spline<'a, L> {
    source: Rows<'a, SPLINE_REACH>,
    /// The rows above the newest, filtered along x, the newest last.
    rows: [L; SPLINE_TAPS - 1],
}

impl<'a, L: Eight> Spline<'a, L> {
    #[inline(always)]
    pub(super) fn new(region: Region<'a>, column: usize, wx: &[L; SPLINE_TAPS]) -> Self {
        let mut source = region.rows(column);
        let rows = [
            Self::across(source.below(), wx),
            Self::across(source.below(), wx),
            Self::across(source.below(), wx),
        ];
        Self { source, rows }
    }

    #[inline(always)]
    fn across(row: &[f32; SPLINE_REACH], w: &[L; SPLINE_TAPS]) -> L {
        (L::load(row, 1) * w[1] + L::load(row, 2) * w[2])
            + (L::load(row, 0) * w[0] + L::load(row, 3) * w[3])
    }
}

impl<L: Eight> Filtered<L> for Spline<'_, L> {
    type Weights = [L; SPLINE_TAPS];

    #[inline(always)]
    fn below(&mut self, wx: &Self::Weights, wy: &Self::Weights) -> L {
        let [a, b, c] = self.rows;
        let newest = Self::across(self.source.below(), wx);
        self.rows = [b, c, newest];
        (b * wy[1] + c * wy[2]) + (a * wy[0] + newest * wy[3])
    }
}

/// The weights of the two pixels around a position `f` after the first.
#[inline(always)]
pub(super) fn pair<L: Eight>(f: f32) -> [L; 2] {
    [L::splat(1.0 - f), L::splat(f)]
}

/// Eight columns of a region, interpolated linearly row by row from the top.
pub(super) struct Linear<'a, L> {
    source: Rows<'a, { EIGHT + 1 }>,
    above: L,
}

impl<'a, L: Eight> Linear<'a, L> {
    #[inline(always)]
    pub(super) fn new(region: Region<'a>, column: usize, wx: &[L; 2]) -> Self {
        let mut source = region.rows(column);
        let above = Self::across(source.below(), wx);
        Self { source, above }
    }

    #[inline(always)]
    fn across(row: &[f32; EIGHT + 1], wx: &[L; 2]) -> L {
        L::load(row, 0) * wx[0] + L::load(row, 1) * wx[1]
    }
}

impl<L: Eight> Filtered<L> for Linear<'_, L> {
    type Weights = [L; 2];

    #[inline(always)]
    fn below(&mut self, wx: &Self::Weights, wy: &Self::Weights) -> L {
        let below = Self::across(self.source.below(), wx);
        let value = self.above * wy[0] + below * wy[1];
        self.above = below;
        value
    }
}
