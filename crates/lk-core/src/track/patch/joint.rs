//! The pixels of a window that count: where the template's pixel does and the one that it is compared with.

use super::sums::MAX_CELLS;
use super::{MAX_SIDE, Window};
use crate::simd::{EIGHT, Packed};
use crate::support::{ABSENT, CLIPPED, COUNTS, Support};

/// Share of a window's pixels that must count.
pub(super) const LEAST_SHARE: f64 = 0.125;

/// Pixels that are only clipped are left out unless more than this share of a window would be.
const CLIPPED_SHARE: u32 = 2;

/// How close to a whole pixel, in pixels, a position leaves the outermost tap of its filter without weight, and which
/// pixels a window reads unchanged.
pub(super) const WHOLE: f32 = 0.05;

/// Pixels that are looked at at once, and those of the largest window, up to whole ones.
const CHUNK: usize = 64;
const CHUNKED: usize = (MAX_SIDE * MAX_SIDE).next_multiple_of(CHUNK);

/// With a row below the last.
const SCRATCH: usize = CHUNKED + MAX_SIDE;

/// How many pixels are `least` at least.
fn at_least(least: u8, pixels: &[u8]) -> u32 {
    let chunks = pixels.chunks_exact(CHUNK);
    chunks
        .map(|chunk| {
            u32::from(
                chunk
                    .iter()
                    .map(|byte| u8::from(*byte >= least))
                    .sum::<u8>(),
            )
        })
        .sum()
}

/// Which of a window's pixels count, and sums over those that do.
#[derive(Debug)]
pub(super) struct Joint {
    /// What each pixel of the template is, in rows of the window's width, and whether all of them count.
    pub(super) own: [u8; MAX_SIDE * MAX_SIDE],
    pub(super) own_whole: bool,
    /// Bits to keep of each cell, in the order of the template's cells.
    keep: [Packed; MAX_CELLS],
    /// 1 for each pixel that counts, in rows of the window's width, up to whole chunks.
    counts: [u8; CHUNKED],
    pub(super) scratch: [u8; SCRATCH],
    /// Whether `keep` is in force, and the pixels of `next` that the window's first sample read when it was made.
    pub(super) masked: bool,
    pub(super) seen: [[isize; 2]; 2],
    moments: Moments,
}

/// Sums over the pixels that count of the offset's functions: 1, and x and y made orthogonal to it and to each other.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    /// Pixels that count.
    pub(super) area: f64,
    /// Pairs of pixels, one above the other, that both count.
    pub(super) pairs: f64,
    /// The mean of x and y, and the slope of y over x.
    mean: [f64; 2],
    slope: f64,
    /// Sums of the squares of the functions of x and of y.
    pub(super) squares: [f64; 2],
}

impl Moments {
    pub(super) fn whole(window: Window) -> Self {
        Self {
            area: window.area(),
            pairs: (window.width * (window.height - 1)) as f64,
            mean: [0.0; 2],
            slope: 0.0,
            squares: window.moments(),
        }
    }

    /// Sums with x and y into those with the orthogonal functions, given that with 1.
    #[inline(always)]
    pub(super) fn orthogonal(&self, plain: f64, [x, y]: [f64; 2]) -> [f64; 2] {
        let x = x - self.mean[0] * plain;
        [x, y - self.mean[1] * plain - self.slope * x]
    }
}

/// Whether a window can be compared at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    /// As before: the sums of the template hold.
    Same,
    /// Other pixels count there: the template has other sums.
    Other,
    /// Too few pixels count.
    Bare,
}

/// The pixels that the first sample of a window at `corner` reads on one axis: from the first to the last but what its
/// filter reaches around them.
pub(super) fn reads(corner: f32) -> [isize; 2] {
    [
        (corner + WHOLE).floor() as isize,
        (corner - WHOLE).ceil() as isize,
    ]
}

impl Joint {
    pub(super) fn new() -> Self {
        Self {
            own: [COUNTS; _],
            own_whole: true,
            keep: [Packed::ZERO; _],
            counts: [0; _],
            scratch: [0; _],
            masked: false,
            seen: [[0; 2]; 2],
            moments: Moments::default(),
        }
    }

    /// All pixels count.
    pub(super) fn reset(&mut self) {
        (self.own_whole, self.masked) = (true, false);
    }

    /// Take what `prev` has under the window whose first sample is at `corner`.
    pub(super) fn take_own(
        &mut self,
        support: &Support,
        corner: [f32; 2],
        window: Window,
        spline: bool,
    ) {
        // A gradient looks one sample to each side.
        let reach = if spline { [2, 2] } else { [1, 1] };
        let size = (window.width, window.height);
        self.own_whole = support.least(corner.map(reads), size, reach, &mut self.own);
    }
}

impl Joint {
    /// Keep the pixels that count in both. `whole` where all of `next` do.
    pub(super) fn unite(&mut self, whole: bool, window: Window) -> Place {
        let Window { width, height } = window;
        let count = width * height;
        let (both, own) = (&mut self.scratch[..count], &self.own[..count]);
        if whole {
            both.copy_from_slice(own);
        } else if !self.own_whole {
            for (both, own) in both.iter_mut().zip(own) {
                *both = (*both).min(*own);
            }
        }
        // Up to whole chunks, also those that are read a row further on.
        let padded = count.next_multiple_of(CHUNK);
        self.scratch[count..padded + width].fill(ABSENT);
        let both = &mut self.scratch[..padded];
        let (there, good) = (at_least(CLIPPED, both), at_least(COUNTS, both));
        let least = if CLIPPED_SHARE * good >= there {
            COUNTS
        } else {
            CLIPPED
        };
        let counting = if least == COUNTS { good } else { there };
        if f64::from(counting) < LEAST_SHARE * count as f64 {
            self.masked = true;
            return Place::Bare;
        }
        for byte in both.iter_mut() {
            *byte = u8::from(*byte >= least);
        }
        // The same pixels as before have the same sums.
        let counts = &mut self.counts[..padded];
        if self.masked && counts == both {
            return Place::Same;
        }
        counts.copy_from_slice(both);
        self.masked = true;
        let below = self.scratch[width..].chunks_exact(CHUNK);
        let pairs = counts.chunks_exact(CHUNK).zip(below).map(|(here, below)| {
            let pairs = here.iter().zip(below).map(|(here, below)| here & below);
            u32::from(pairs.sum::<u8>())
        });
        self.moments.pairs = f64::from(pairs.sum::<u32>());
        for block in 0..window.blocks() {
            let first = block * EIGHT;
            let keep = &mut self.keep[block * height..][..height];
            for (row, keep) in keep.iter_mut().enumerate() {
                let bytes = &self.scratch[row * width + first..][..EIGHT];
                for (lane, (keep, byte)) in keep.0.iter_mut().zip(bytes).enumerate() {
                    let counts = u32::from(*byte) & u32::from(first + lane < width);
                    *keep = f32::from_bits(0u32.wrapping_sub(counts));
                }
            }
        }
        Place::Other
    }

    /// The bits to keep of a column of cells.
    #[inline(always)]
    pub(super) fn column(&self, block: usize, window: Window) -> &[Packed] {
        &self.keep[block * window.height..][..window.height]
    }

    /// The moments of the pixels that count, for these sums over them: of 1, x, y, xx, xy, yy.
    pub(super) fn moments(&self, [area, x, y, xx, xy, yy]: [f64; 6]) -> Moments {
        let mean = [x / area, y / area];
        let (xx, xy, yy) = (xx - x * mean[0], xy - x * mean[1], yy - y * mean[1]);
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        Moments {
            area,
            pairs: self.moments.pairs,
            mean,
            slope,
            // A single row or column has no slope along the other: its sum of squares explains nothing.
            squares: [xx, yy - slope * xy].map(|squares| squares.max(1e-3 * area)),
        }
    }
}
