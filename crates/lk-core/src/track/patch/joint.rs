//! The pixels of a window that count: where the template's pixel does and the one that it is compared with.

use super::template::{MAX_CELLS, TemplateSums};
use super::{MAX_SIDE, Sampling, Sums, Template, Window};
use crate::simd::{EIGHT, Eight, EightKernel, Packed};
use crate::support::{ABSENT, CLIPPED, COUNTS, Support};

/// Share of a window's pixels that must count.
const LEAST_SHARE: f64 = 0.125;

/// Pixels that are only clipped are left out unless more than this share of a window would be.
const CLIPPED_SHARE: u32 = 2;

/// How close to a whole pixel, in pixels, a position leaves the outermost tap of its filter without weight, and which
/// pixels a window reads unchanged.
const WHOLE: f32 = 0.05;

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
    own: [u8; MAX_SIDE * MAX_SIDE],
    own_whole: bool,
    /// Bits to keep of each cell, in the order of the template's cells.
    keep: [Packed; MAX_CELLS],
    /// 1 for each pixel that counts, in rows of the window's width, up to whole chunks.
    counts: [u8; CHUNKED],
    scratch: [u8; SCRATCH],
    /// Whether `keep` is in force, and the pixels of `next` that the window's first sample read when it was made.
    masked: bool,
    seen: [[isize; 2]; 2],
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
fn reads(corner: f32) -> [isize; 2] {
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
    fn take_own(&mut self, support: &Support, corner: [f32; 2], window: Window, spline: bool) {
        // A gradient looks one sample to each side.
        let reach = if spline { [2, 2] } else { [1, 1] };
        let size = (window.width, window.height);
        self.own_whole = support.least(corner.map(reads), size, reach, &mut self.own);
    }
}

impl Template {
    /// Whether some of the window may not count, after [`Template::belongs_to`].
    pub(crate) fn is_masked(&self) -> bool {
        self.joint.masked
    }

    /// Whether too few pixels count wherever it is compared, after [`Template::belongs_to`].
    pub(crate) fn is_bare(&self) -> bool {
        let count = self.window.width * self.window.height;
        let own = self.joint.own[..count].iter();
        let there = own.filter(|byte| **byte >= CLIPPED).count();
        !self.joint.own_whole && (there as f64) < LEAST_SHARE * count as f64
    }

    /// Take into account which pixels of the frame it was built from count.
    pub(crate) fn belongs_to(&mut self, support: &Support) {
        let spline = self.sampling == Sampling::Spline;
        self.joint
            .take_own(support, self.corner, self.window, spline);
    }

    /// Take into account which pixels of `next` count with the window around `centre`.
    pub(crate) fn meets(&mut self, support: &Support, centre: [f32; 2]) -> Place {
        let half = self.window.half();
        let corner = [centre[0] - half[0], centre[1] - half[1]];
        let spline = self.sampling == Sampling::Spline;
        let reach = if spline { [1, 1] } else { [0, 0] };
        if self.joint.masked {
            // What is read near a whole pixel has no weight: a window that rests there does not change.
            let within = [0, 1].into_iter().all(|axis| {
                let [low, high] = self.joint.seen[axis];
                let first = (corner[axis] + 2.0 * WHOLE).floor() as isize;
                let last = (corner[axis] - 2.0 * WHOLE).ceil() as isize;
                first >= low && last <= high
            });
            if within {
                return Place::Same;
            }
        }
        let reads = corner.map(reads);
        let window = self.window;
        let size = (window.width, window.height);
        let joint = &mut self.joint;
        let whole = support.least(reads, size, reach, &mut joint.scratch);
        if whole && joint.own_whole {
            if !joint.masked {
                return Place::Same;
            }
            joint.masked = false;
            self.moments = Moments::whole(window);
            self.sums = self.whole_sums;
            return Place::Other;
        }
        if !joint.masked {
            self.whole_sums = self.sums;
        }
        joint.seen = reads;
        joint.unite(whole, window)
    }

    /// Sums over the window of the difference, with the coordinates made orthogonal.
    #[inline(always)]
    pub(super) fn orthogonal(&self, sums: Sums) -> Sums {
        Sums {
            tilt: self.moments.orthogonal(sums.plain, sums.tilt),
            ..sums
        }
    }
}

impl Joint {
    /// Keep the pixels that count in both. `whole` where all of `next` do.
    fn unite(&mut self, whole: bool, window: Window) -> Place {
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
    fn moments(&self, [area, x, y, xx, xy, yy]: [f64; 6]) -> Moments {
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

/// Make the sums of a template again, over the pixels that count.
pub(crate) struct SumAgain<'a>(pub(crate) &'a mut Template);

impl EightKernel for SumAgain<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Eight>(self) {
        let template = self.0;
        if !template.joint.masked {
            return;
        }
        let window = template.window;
        let base = L::splat(template.level);
        let half = window.half();
        let mut plain = [L::zero(); 3];
        let mut with = [[L::zero(); 3]; 2];
        let mut products = [L::zero(); 6];
        let mut lagged = [L::zero(); 2];
        let mut moments = [L::zero(); 6];
        let one = L::splat(1.0);
        for block in 0..window.blocks() {
            let x = window.block_x::<L>(block);
            let keep = template.joint.column(block, window);
            let cells = template.column(block);
            let mut last = [L::zero(); 2];
            let mut own = [L::zero(); 3];
            for (row, (cell, keep)) in cells.iter().zip(keep).enumerate() {
                let keep = L::unpack(keep);
                let y = L::splat(row as f32 - half[1]);
                let a = (L::unpack(&cell.prev) - base).keep(keep);
                let gx = L::unpack(&cell.gradient[0]).keep(keep);
                let gy = L::unpack(&cell.gradient[1]).keep(keep);
                for (index, value) in [a, gx, gy].into_iter().enumerate() {
                    own[index] += value;
                    with[1][index] += value * y;
                }
                products[0] += a * a;
                products[1] += a * gx;
                products[2] += a * gy;
                products[3] += gx * gx;
                products[4] += gx * gy;
                products[5] += gy * gy;
                lagged[0] += gx * last[0];
                lagged[1] += gy * last[1];
                last = [gx, gy];
                let (counts, along) = (one.keep(keep), x.keep(keep));
                moments[0] += counts;
                moments[1] += along;
                moments[2] += counts * y;
                moments[3] += along * x;
                moments[4] += along * y;
                moments[5] += counts * y * y;
            }
            for (index, own) in own.into_iter().enumerate() {
                plain[index] += own;
                with[0][index] += own * x;
            }
        }
        let plain = L::sums(&plain);
        let [with_x, with_y] = [L::sums(&with[0]), L::sums(&with[1])];
        let moments = template.joint.moments(L::sums(&moments));
        let mut sums = TemplateSums {
            plain,
            products: L::sums(&products),
            lagged: L::sums(&lagged),
            ..TemplateSums::default()
        };
        for index in 0..3 {
            let [x, y] = moments.orthogonal(plain[index], [with_x[index], with_y[index]]);
            (sums.with_x[index], sums.with_y[index]) = (x, y);
        }
        template.sums = sums;
        template.moments = moments;
    }
}
