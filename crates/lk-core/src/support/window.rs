//! What the pixels under a window are.

use super::{ABSENT, COUNTS, Support, TILE};

/// Samples along a row of a window, of most windows and of the widest one.
const NARROW: usize = 32;
const WIDE: usize = 80;

/// Pixels beyond the first that a sample reads, at most.
const MOST_REACH: usize = 7;

impl Support {
    /// Whether all `columns` by `rows` pixels from (x, y) on count.
    #[inline(always)]
    pub(crate) fn holds(&self, (x, y): (isize, isize), columns: usize, rows: usize) -> bool {
        let [(left, right), (top, bottom)] = self.inner;
        x >= left as isize
            && y >= top as isize
            && x + columns as isize <= right as isize
            && y + rows as isize <= bottom as isize
            && (self.bytes.is_empty() || self.has_whole((x as usize, y as usize), columns, rows))
    }

    /// [`Support::holds`] where clipped pixels count too.
    pub(crate) fn has_all(&self, place: (isize, isize), columns: usize, rows: usize) -> bool {
        if self.absent {
            return self.holds(place, columns, rows);
        }
        let [(left, right), (top, bottom)] = self.inner;
        place.0 >= left as isize
            && place.1 >= top as isize
            && place.0 + columns as isize <= right as isize
            && place.1 + rows as isize <= bottom as isize
    }

    /// [`Support::holds`] for pixels of the frame.
    fn has_whole(&self, (x, y): (usize, usize), columns: usize, rows: usize) -> bool {
        if columns == 0 || rows == 0 {
            return true;
        }
        let across = self.width.div_ceil(TILE);
        let tiles = y / TILE..(y + rows - 1) / TILE + 1;
        let whole = tiles.clone().all(|row| {
            let tiles = x / TILE..(x + columns - 1) / TILE + 1;
            !self.broken[row * across..][tiles].contains(&true)
        });
        whole
            || (y..y + rows).all(|y| {
                let pixels = &self.row(y)[x..x + columns];
                pixels.iter().fold(COUNTS, |least, byte| least.min(*byte)) == COUNTS
            })
    }

    /// The least of what a filter finds that reaches `before` and `after` each of `columns` by `rows` samples, the first of
    /// which reads the pixels `reads`, from one to another along x and y; true where all of it counts. Otherwise it stands
    /// in `to`, row by row.
    pub(crate) fn least(
        &self,
        [x, y]: [[isize; 2]; 2],
        (width, height): (usize, usize),
        [before, after]: [isize; 2],
        to: &mut [u8],
    ) -> bool {
        let reach = [x, y].map(|[low, high]| (high - low + before + after) as usize);
        let place = [x[0] - before, y[0] - before];
        // The samples whose pixels are all within, from the first to the last but one: no other counts.
        let within = |axis: usize, samples: usize| {
            let (first, end) = self.inner[axis];
            let samples = samples as isize;
            let start = (first as isize - place[axis]).clamp(0, samples);
            let end = end as isize - place[axis] - reach[axis] as isize;
            (start as usize, end.clamp(start, samples) as usize)
        };
        let (columns, rows) = (within(0, width), within(1, height));
        let size = [columns.1 - columns.0, rows.1 - rows.0];
        let region = Region {
            x: (place[0] + columns.0 as isize) as usize,
            y: (place[1] + rows.0 as isize) as usize,
            reach,
            size,
        };
        let some = size[0] > 0 && size[1] > 0;
        let whole = self.bytes.is_empty()
            || !some
            || self.has_whole((region.x, region.y), size[0] + reach[0], size[1] + reach[1]);
        if whole && size == [width, height] {
            return true;
        }
        let to = &mut to[..width * height];
        if size != [width, height] {
            to.fill(ABSENT);
        }
        if some {
            let inside = to[rows.0 * width..rows.1 * width].chunks_exact_mut(width);
            let inside = inside.map(|row| &mut row[columns.0..columns.1]);
            if whole {
                inside.for_each(|row| row.fill(COUNTS));
            } else if size[0] <= NARROW {
                self.filter::<NARROW>(region, inside);
            } else {
                self.filter::<WIDE>(region, inside);
            }
        }
        false
    }

    /// The least of the pixels that each sample reads, into `rows`, which are at most `LANES` wide.
    ///
    /// All lanes are worked on, so that no loop has an end that vectors do not fill.
    fn filter<'a, const LANES: usize>(
        &self,
        region: Region,
        rows: impl Iterator<Item = &'a mut [u8]>,
    ) {
        let Region { x, y, reach, size } = region;
        let mut line = [[COUNTS; LANES]; 2];
        let mut along = [[COUNTS; LANES]; MOST_REACH + 1];
        let columns = size[0] + reach[0];
        let mut filtered = |y: usize, to: &mut [u8; LANES]| {
            let line = line.as_flattened_mut();
            line[..columns].copy_from_slice(&self.row(y)[x..][..columns]);
            to.copy_from_slice(&line[..LANES]);
            for tap in 1..=reach[0] {
                for (to, byte) in to.iter_mut().zip(&line[tap..]) {
                    *to = (*to).min(*byte);
                }
            }
        };
        for row in 0..reach[1] {
            filtered(y + row, &mut along[row % (MOST_REACH + 1)]);
        }
        for (row, to) in rows.enumerate() {
            filtered(
                y + row + reach[1],
                &mut along[(row + reach[1]) % (MOST_REACH + 1)],
            );
            let mut least = [COUNTS; LANES];
            for tap in 0..=reach[1] {
                let along = &along[(row + tap) % (MOST_REACH + 1)];
                for (least, byte) in least.iter_mut().zip(along) {
                    *least = (*least).min(*byte);
                }
            }
            to.copy_from_slice(&least[..to.len()]);
        }
    }
}

/// Samples of a window, and how far beyond the first pixel that it reads each of them reads.
#[derive(Debug, Clone, Copy)]
struct Region {
    x: usize,
    y: usize,
    reach: [usize; 2],
    size: [usize; 2],
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;
    use proptest::prelude::*;

    use crate::execution::Execution;
    use crate::support::{ABSENT, COUNTS, Support};

    /// The definition.
    fn plain(
        support: &Support,
        [x, y]: [[isize; 2]; 2],
        (width, height): (usize, usize),
        [before, after]: [isize; 2],
    ) -> Vec<u8> {
        let mut found = Vec::new();
        for row in 0..height as isize {
            for column in 0..width as isize {
                let rows = row + y[0] - before..=row + y[1] + after;
                let least = rows
                    .flat_map(|y| {
                        (column + x[0] - before..=column + x[1] + after).map(move |x| (x, y))
                    })
                    .fold(COUNTS, |least, (x, y)| least.min(support.at(x, y)));
                found.push(least);
            }
        }
        found
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(600))]
        #[test]
        fn windows_have_the_least_of_their_pixels(
            height in 1usize..40, width in 1usize..90, x in -40isize..100, y in -40isize..50,
            columns in 1usize..66, rows in 1usize..30, seed in any::<u32>(), share in 0u32..40,
            edge in 0usize..4, between in prop::array::uniform2(0isize..2), clipped in any::<bool>(),
            reach in prop::array::uniform2(0isize..3), coarser in any::<bool>(),
        ) {
            let random = |x: usize, y: usize| {
                (x as u32 * 7919 + y as u32 * 104_729).wrapping_add(seed).wrapping_mul(2_654_435_761) >> 16
            };
            // A frame that slopes to where it is cut off, or does not; a mask that takes some pixels, or an edge, or none.
            let frame = Array2::from_shape_fn((height, width), |(y, x)| {
                let share = if edge == 1 { share } else { 0 };
                let grey = 3.0 * x as f32 + y as f32;
                if random(x, y) % 997 < share { f32::NAN } else if clipped { grey.min(90.0) } else { grey }
            });
            let mask = Array2::from_shape_fn((height, width), |(y, x)| match edge {
                0 => true,
                1 => random(y + 99, x) % 991 >= share,
                2 => x > share as usize,
                _ => y > share as usize / 2,
            });
            let mut found = Support::default();
            let execution = Execution::default();
            found.take(frame.view(), Some(mask.view()), &execution).unwrap();
            if coarser {
                let finer = std::mem::take(&mut found);
                found.reduce(&finer).unwrap();
            } else {
                for (y, x) in ndarray::indices((height, width)) {
                    let there = mask[(y, x)] && frame[(y, x)].is_finite();
                    prop_assert_eq!(found.at(x as isize, y as isize) != ABSENT, there);
                }
            }
            let reads = [[x, x + between[0]], [y, y + between[1]]];
            let want = plain(&found, reads, (columns, rows), reach);
            // What stood there before does not matter.
            let mut least = vec![7; columns * rows];
            let all = want.iter().all(|byte| *byte == COUNTS);
            prop_assert_eq!(found.least(reads, (columns, rows), reach, &mut least), all);
            if !all {
                prop_assert_eq!(least, want);
            }
            let pixels = plain(&found, [[x, x], [y, y]], (columns, rows), [0; 2]);
            let all = pixels.iter().all(|byte| *byte == COUNTS);
            prop_assert_eq!(found.holds((x, y), columns, rows), all);
        }
    }
}
