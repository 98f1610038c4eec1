//! The best local maxima of the response that keep their distance.

use ndarray::ArrayView2;

use super::options::{Corner, CornerOptions};
use crate::error::Result;
use crate::frame::Plane;
use crate::memory::{reserve, reserve_more, resize};
use crate::simd::{EIGHT, Eight, Kernel, Simd, SimdLevel, dispatch};

/// Memory of the selection.
#[derive(Debug, Default)]
pub(super) struct Selection {
    candidates: Vec<Candidate>,
    cells: Vec<u32>,
    chained: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    response: f32,
    index: u32,
}

impl Candidate {
    /// Best first; among equals the later pixel first, as OpenCV has it.
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        other
            .response
            .total_cmp(&self.response)
            .then(other.index.cmp(&self.index))
    }
}

impl Selection {
    /// Make room for so many candidates.
    pub(super) fn reserve(&mut self, maxima: usize) -> Result<()> {
        reserve("corners", &mut self.candidates, maxima)
    }

    /// Replace `corners` by the best, the best first.
    pub(super) fn choose(
        &mut self,
        response: &Plane,
        mask: Option<ArrayView2<'_, bool>>,
        options: &CornerOptions,
        corners: &mut Vec<Corner>,
    ) -> Result<()> {
        let level = options.execution.simd_level();
        let best = best(response, mask, level);
        if best > 0.0 {
            self.collect(response, best * options.quality, mask, level)?;
            self.keep_apart(response, options, corners)?;
        }
        Ok(())
    }

    /// Collect the local maxima from `threshold` on.
    fn collect(
        &mut self,
        response: &Plane,
        threshold: f32,
        mask: Option<ArrayView2<'_, bool>>,
        level: SimdLevel,
    ) -> Result<()> {
        let (width, height) = (response.width(), response.height());
        self.candidates.clear();
        for y in 1..height - 1 {
            // All pixels of an even row are maxima.
            reserve_more("corners", &mut self.candidates, width)?;
            let rows = [y - 1, y, y + 1].map(|row| response.row(row));
            dispatch(
                level,
                Maxima {
                    rows,
                    threshold,
                    first: (y * width) as u32,
                    mask: mask.map(|mask| (mask, y)),
                    found: &mut self.candidates,
                },
            );
        }
        Ok(())
    }

    /// Choose the best candidates that keep their distance.
    fn keep_apart(
        &mut self,
        response: &Plane,
        options: &CornerOptions,
        corners: &mut Vec<Corner>,
    ) -> Result<()> {
        let (width, height) = (response.width(), response.height());
        let wanted = if options.max_corners == 0 {
            usize::MAX
        } else {
            options.max_corners
        };
        let cell = options.min_distance.round().max(1.0) as usize;
        let (columns, rows) = (width.div_ceil(cell), height.div_ceil(cell));
        let apart = options.min_distance >= 1.0;
        const NONE: u32 = u32::MAX;
        if apart {
            self.cells.clear();
            resize("cells", &mut self.cells, columns * rows, NONE)?;
            self.chained.clear();
        }
        let limit = options.min_distance * options.min_distance;
        let mut sorted = 0;
        for at in 0..self.candidates.len() {
            if corners.len() >= wanted {
                break;
            }
            if at == sorted {
                sorted = sort_some(&mut self.candidates, at, wanted.min(1 << 20));
            }
            let candidate = self.candidates[at];
            let (x, y) = (
                candidate.index as usize % width,
                candidate.index as usize / width,
            );
            let position = [x as f32, y as f32];
            if apart {
                let (column, row) = (x / cell, y / cell);
                let mut free = true;
                'search: for near_row in row.saturating_sub(1)..(row + 2).min(rows) {
                    for near in column.saturating_sub(1)..(column + 2).min(columns) {
                        let mut link = self.cells[near_row * columns + near];
                        while link != NONE {
                            let other = corners[link as usize].position;
                            let (dx, dy) = (other[0] - position[0], other[1] - position[1]);
                            if dx * dx + dy * dy < limit {
                                free = false;
                                break 'search;
                            }
                            link = self.chained[link as usize];
                        }
                    }
                }
                if !free {
                    continue;
                }
                let head = &mut self.cells[row * columns + column];
                reserve_more("corners", &mut self.chained, 1)?;
                self.chained.push(*head);
                *head = corners.len() as u32;
            }
            reserve_more("corners", corners, 1)?;
            corners.push(Corner {
                position,
                response: candidate.response,
            });
        }
        Ok(())
    }
}

/// The largest response.
fn best(response: &Plane, mask: Option<ArrayView2<'_, bool>>, level: SimdLevel) -> f32 {
    let mut best = f32::MIN;
    for y in 0..response.height() {
        let row = response.row(y);
        match mask {
            None => best = best.max(dispatch(level, Largest(row))),
            Some(mask) => {
                for (value, wanted) in row.iter().zip(mask.row(y)) {
                    if *wanted {
                        best = best.max(*value);
                    }
                }
            }
        }
    }
    best
}

/// Put the best of the candidates from `from` on into order, about as many as are likely needed, and say up to where.
fn sort_some(candidates: &mut [Candidate], from: usize, wanted: usize) -> usize {
    let rest = &mut candidates[from..];
    let count = wanted.saturating_mul(4).max(64);
    if count < rest.len() {
        rest.select_nth_unstable_by(count, Candidate::order);
        rest[..count].sort_unstable_by(Candidate::order);
        from + count
    } else {
        rest.sort_unstable_by(Candidate::order);
        candidates.len()
    }
}

/// The largest value of a row that is not NaN.
struct Largest<'a>(&'a [f32]);

impl Kernel for Largest<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> f32 {
        let mut lanes = [f32::MIN; 4 * EIGHT];
        let chunks = self.0.chunks_exact(4 * EIGHT);
        let rest = chunks.remainder().iter().copied().fold(f32::MIN, f32::max);
        for chunk in chunks {
            for (lane, value) in lanes.iter_mut().zip(chunk) {
                *lane = if *value > *lane { *value } else { *lane };
            }
        }
        lanes.into_iter().fold(rest, f32::max)
    }
}

/// The pixels of the middle row, but for its ends, that no neighbour exceeds.
struct Maxima<'a> {
    rows: [&'a [f32]; 3],
    threshold: f32,
    /// Index of the row's first pixel in the frame.
    first: u32,
    mask: Option<(ArrayView2<'a, bool>, usize)>,
    found: &'a mut Vec<Candidate>,
}

impl Kernel for Maxima<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, _: S) {
        let [above, here, below] = self.rows;
        let width = here.len();
        let (above, below) = (&above[..width], &below[..width]);
        let threshold = S::Eight::splat(self.threshold);
        let mut x = 1;
        while x < width - 1 {
            // Most blocks hold no maximum, and whole lanes tell so at once.
            let whole = x + EIGHT < width;
            let count = if whole { EIGHT } else { width - 1 - x };
            let mut bits = u8::MAX >> (EIGHT - count);
            if whole {
                let value = S::Eight::load(here, x);
                bits = value.at_least(threshold)
                    & value.at_least(S::Eight::load(above, x))
                    & value.at_least(S::Eight::load(below, x))
                    & value.at_least(S::Eight::load(here, x - 1))
                    & value.at_least(S::Eight::load(here, x + 1));
            }
            while bits != 0 {
                self.add_if_maximum(above, here, below, x + bits.trailing_zeros() as usize);
                bits &= bits - 1;
            }
            x += count;
        }
    }
}

impl Maxima<'_> {
    /// Take pixel `x` if it is a maximum.
    fn add_if_maximum(&mut self, above: &[f32], here: &[f32], below: &[f32], x: usize) {
        let value = here[x];
        let near = x - 1..x + 2;
        let is_maximum = value > self.threshold
            && value >= here[x - 1]
            && value >= here[x + 1]
            && above[near.clone()].iter().all(|other| value >= *other)
            && below[near].iter().all(|other| value >= *other);
        if is_maximum && self.mask.is_none_or(|(mask, y)| mask[(y, x)]) {
            self.found.push(Candidate {
                response: value,
                index: self.first + x as u32,
            });
        }
    }
}
