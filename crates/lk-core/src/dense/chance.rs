//! Windows that fit by chance.
//!
//! Where the flow is wrong, in a part that has no match or because the motion was too large, a few windows in a hundred fit
//! all the same. They stand alone: where the flow is right most windows around fit as well.

use crate::error::Result;
use crate::memory::resize;

use super::confidence::{Judged, NOTHING};
use super::field::FlowField;

/// Pixels along each side of the cells that are counted.
const CELL: usize = 16;
/// Where at most this share of the windows with texture fits, in 3 x 3 cells, those that do fit by chance.
const CHANCE: f32 = 0.2;
/// One pixel in this many has texture by chance too.
const FEW: u32 = 8;

/// What was counted in a cell.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Count {
    valid: u32,
    /// Pixels whose windows hold something to measure.
    measurable: u32,
    pixels: u32,
}

/// Take back what `field` calls valid by chance; `counts` is memory.
pub(super) fn clear(field: &mut FlowField, judged: &Judged, counts: &mut Vec<Count>) -> Result<()> {
    let width = field.width;
    let columns = width.div_ceil(CELL);
    let rows = field.height.div_ceil(CELL);
    counts.clear();
    resize(
        "counts of validity",
        counts,
        columns * rows,
        Count::default(),
    )?;
    for (y, row) in field.valid.chunks_exact(width).enumerate() {
        let counts = &mut counts[y / CELL * columns..][..columns];
        for (count, cell) in counts.iter_mut().zip(row.chunks(CELL)) {
            count.pixels += cell.len() as u32;
            count.valid += cell.iter().map(|valid| u32::from(*valid)).sum::<u32>();
        }
        if y % 2 == 0 {
            let judged = judged.fit.row(y / 2).chunks(CELL / 2);
            for (count, cell) in counts.iter_mut().zip(judged) {
                let told = cell.iter().map(|fit| u32::from(*fit > NOTHING));
                // One window speaks for four pixels.
                count.measurable += 4 * told.sum::<u32>();
            }
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let [mut valid, mut measurable, mut pixels] = [0; 3];
            for near in row.saturating_sub(1)..(row + 2).min(rows) {
                for count in
                    &counts[near * columns..][column.saturating_sub(1)..(column + 2).min(columns)]
                {
                    valid += count.valid;
                    measurable += count.measurable;
                    pixels += count.pixels;
                }
            }
            let least = CHANCE * measurable.max(pixels / FEW) as f32;
            if valid == 0 || valid as f32 > least {
                continue;
            }
            for y in row * CELL..((row + 1) * CELL).min(field.height) {
                let from = y * width + column * CELL;
                let to = y * width + ((column + 1) * CELL).min(width);
                field.valid[from..to].fill(false);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::padded_plane::PAD;
    use super::*;

    /// A field and its judgement, with texture everywhere, valid where `valid` says so.
    fn field(
        width: usize,
        height: usize,
        valid: impl Fn(usize, usize) -> bool,
    ) -> (FlowField, Judged) {
        let mut field = FlowField::default();
        field.resize(width, height).unwrap();
        let mut judged = Judged::default();
        judged.resize(width, height).unwrap();
        for y in 0..height {
            for x in 0..width {
                field.valid[y * width + x] = valid(x, y);
            }
        }
        for y in 0..judged.fit.height() {
            judged.fit.padded_mut(y).fill(-1.0);
        }
        (field, judged)
    }

    #[test]
    fn what_stands_alone_is_not_valid() {
        for (width, height) in [(5, 3), (64, 48), (101, 67)] {
            // One pixel in ten, and whole parts.
            let (mut sparse, judged) = field(width, height, |x, y| (x + 3 * y) % 10 == 0);
            clear(&mut sparse, &judged, &mut Vec::new()).unwrap();
            assert!(sparse.valid.iter().all(|valid| !valid));
            let half = |x: usize, _: usize| 2 * x < width;
            let (mut part, judged) = field(width, height, half);
            let before = part.valid.clone();
            clear(&mut part, &judged, &mut Vec::new()).unwrap();
            assert_eq!(part.valid, before);
        }
    }

    #[test]
    fn windows_without_texture_do_not_count() {
        let line = |x: usize, _: usize| (30..34).contains(&x);
        let (mut alone, mut judged) = field(64, 64, line);
        let before = alone.valid.clone();
        for y in 0..32 {
            for x in 0..32 {
                if !(15..17).contains(&x) {
                    judged.fit.padded_mut(y)[PAD + x] = NOTHING;
                }
            }
        }
        clear(&mut alone, &judged, &mut Vec::new()).unwrap();
        assert_eq!(alone.valid, before);
    }
}
