//! Which pixels of a window count, at both of its ends.

use crate::simd::{Kernel, Simd, SimdLevel, dispatch};
use crate::support::{CLIPPED, COUNTS, Support};
use crate::track::affine::template::{Samples, stride};
use crate::track::affine::warp::Positions;
use crate::track::patch::{MAX_SIDE, Window};

/// Pixels of a window and around it whose support is looked at.
const LOOKED: usize = (MAX_SIDE + 6) * (MAX_SIDE + 6);

/// What counts of a template, and of where it is compared.
#[derive(Debug)]
pub(super) struct Counting {
    /// What the pixels of the template are, and whether all of them count.
    own: [u8; LOOKED],
    own_whole: bool,
    /// Bits to keep of each pixel, if some do not count.
    keep: Samples,
    /// How many of them were found for this template.
    kept: usize,
}

impl Counting {
    pub(super) fn new() -> Self {
        Self {
            own: [COUNTS; _],
            own_whole: true,
            keep: [0.0; _],
            kept: 0,
        }
    }

    /// Bits to keep of each pixel, if some do not count.
    pub(super) fn keep(&self, met: Meeting) -> Option<&Samples> {
        met.is_part().then_some(&self.keep)
    }

    /// Find what the pixels of a template are whose first sample is at `first`.
    pub(super) fn begin(&mut self, support: &Support, first: [f64; 2], window: Window) {
        let reads = first.map(|at| [at.floor() as isize, at.ceil() as isize]);
        let size = (window.width, window.height);
        let place = reads.map(|[low, _]| low - 2);
        let [columns, rows] = [0, 1].map(|axis: usize| {
            let [low, high] = reads[axis];
            [size.0, size.1][axis] + (high - low) as usize + 4
        });
        // Clipped pixels count here: where only they are missing, all count.
        self.own_whole = support.has_all((place[0], place[1]), columns, rows)
            || support.least(reads, size, [2, 2], &mut self.own);
        self.kept = 0;
    }

    /// Find which pixels count with those of `support` at `positions`.
    pub(super) fn meet(
        &mut self,
        support: &Support,
        positions: &Positions,
        level: SimdLevel,
    ) -> Meeting {
        let [x, y] = positions.bounds();
        let low = [x, y].map(|[low, _]| low.floor() as isize - 1);
        let high = [x, y].map(|[_, high]| high.floor() as isize + 2);
        let size = [0, 1].map(|axis: usize| (high[axis] - low[axis] + 1).max(0) as usize);
        let whole = support.has_all((low[0], low[1]), size[0], size[1]);
        if whole && self.own_whole {
            return Meeting::Whole;
        }
        let own = (!self.own_whole).then_some(&self.own[..]);
        let keep = &mut self.keep;
        let (counting, changed) = if whole || !support.has_absent() {
            // Where nothing is missing from within the frame, the four pixels around on both axes are.
            let inner = support.inner().map(|(first, end)| {
                if whole {
                    [f64::NEG_INFINITY, f64::INFINITY]
                } else {
                    [first as f64 + 1.0, end as f64 - 2.0]
                }
            });
            let positions = *positions;
            let kernel = Within {
                positions,
                inner,
                own,
                keep,
            };
            dispatch(level, kernel)
        } else {
            let counts = |x: isize, y: isize| support.has_all((x - 1, y - 1), 4, 4);
            one_by_one(positions, own, keep, counts)
        };
        self.kept += usize::from(changed || self.kept == 0);
        Meeting::Part {
            counting,
            turn: self.kept,
        }
    }
}

/// Which pixels of a window count at both of its ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meeting {
    Whole,
    /// So many; `turn` tells those of one place from those of another.
    Part {
        counting: usize,
        turn: usize,
    },
}

impl Meeting {
    fn is_part(self) -> bool {
        self != Self::Whole
    }
}

/// The whole number below; without a call of a library, and for what lies near a frame.
fn whole_below(coordinate: f64) -> isize {
    let whole = coordinate as isize;
    whole - isize::from(whole as f64 > coordinate)
}

/// Bits to keep of a pixel that counts, or does not.
#[inline(always)]
fn bits(counts: bool) -> u32 {
    0u32.wrapping_sub(u32::from(counts))
}

/// Find the pixels that count by what `counts` says of the one that a position is in; how many, and whether they are
/// others than before.
fn one_by_one(
    positions: &Positions,
    own: Option<&[u8]>,
    keep: &mut Samples,
    counts: impl Fn(isize, isize) -> bool,
) -> (usize, bool) {
    let (mut counting, mut changed) = (0, false);
    for row in 0..positions.rows {
        for column in 0..positions.columns {
            let own = own.is_none_or(|own| own[row * positions.columns + column] >= CLIPPED);
            let [x, y] = positions.at(column, row).map(whole_below);
            let bits = bits(own && counts(x, y));
            let keep = &mut keep[row * stride(positions.columns) + column];
            counting += (bits & 1) as usize;
            changed |= keep.to_bits() != bits;
            *keep = f32::from_bits(bits);
        }
    }
    (counting, changed)
}

/// [`one_by_one`] for positions that are to lie from a first coordinate to another along x and y.
struct Within<'a> {
    positions: Positions,
    inner: [[f64; 2]; 2],
    own: Option<&'a [u8]>,
    keep: &'a mut Samples,
}

impl Kernel for Within<'_> {
    type Output = (usize, bool);

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> (usize, bool) {
        let [[left, right], [top, bottom]] = self.inner;
        let Positions {
            first,
            across,
            down,
            columns,
            rows,
        } = self.positions;
        let (mut counting, mut changed) = (0u32, 0u32);
        let lines = self.keep.chunks_exact_mut(stride(columns)).take(rows);
        for (row, line) in lines.enumerate() {
            let (down_x, down_y) = (row as f64 * down[0], row as f64 * down[1]);
            for (column, keep) in line[..columns].iter_mut().enumerate() {
                let step = f64::from(column as u32);
                let x = first[0] + step * across[0] + down_x;
                let y = first[1] + step * across[1] + down_y;
                let inside = (x >= left) & (x < right) & (y >= top) & (y < bottom);
                let mut bits = bits(inside);
                if let Some(own) = self.own {
                    bits &= self::bits(own[row * columns + column] >= CLIPPED);
                }
                counting += bits & 1;
                changed |= keep.to_bits() ^ bits;
                *keep = f32::from_bits(bits);
            }
        }
        (counting as usize, changed != 0)
    }
}
