//! Which pixels of a tile count: those whose filters reach nothing that does not, in either frame.

use super::tile::{Buffers, LARGEST, REACH};
use crate::support::{COUNTS, Support};

/// Say of each pixel of a tile whether all that its filters reach counts in both frames; how many do.
pub(super) fn weigh(
    supports: [&Support; 2],
    corners: [[usize; 2]; 2],
    side: usize,
    buffers: &mut Buffers,
) -> usize {
    const MOST: usize = LARGEST + 2 * REACH;
    let footprint = side + 2 * REACH;
    let mut counts = [[true; MOST]; MOST];
    for (support, [x, y]) in supports.into_iter().zip(corners) {
        let [(left, right), (top, bottom)] = support.inner();
        for (row, counts) in counts[..footprint].iter_mut().enumerate() {
            let y = y + row - REACH;
            let bytes = support.row(y);
            for (column, counts) in counts[..footprint].iter_mut().enumerate() {
                let x = x + column - REACH;
                let inside = (left..right).contains(&x) && (top..bottom).contains(&y);
                *counts &= inside && (bytes.is_empty() || bytes[x] == COUNTS);
            }
        }
    }
    // All within the reach, along rows, then along columns.
    let mut across = [[true; MOST]; MOST];
    for (row, to) in counts[..footprint].iter().zip(&mut across) {
        for (column, to) in to[..side].iter_mut().enumerate() {
            *to = row[column..=column + 2 * REACH]
                .iter()
                .all(|counts| *counts);
        }
    }
    let mut total = 0;
    for (row, weights) in buffers.weight[..side].iter_mut().enumerate() {
        for (column, weight) in weights[..side].iter_mut().enumerate() {
            let counts = across[row..=row + 2 * REACH]
                .iter()
                .all(|line| line[column]);
            *weight = f32::from(u8::from(counts));
            total += usize::from(counts);
        }
    }
    total
}
