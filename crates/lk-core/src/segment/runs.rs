//! Pixels that are set next to each other in a row, and the regions that they make up.

use std::ops::Range;

/// Pixels next to each other in one row, and the region that they belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Run {
    /// The row.
    pub(crate) y: u32,
    /// The first column.
    pub(crate) start: u32,
    /// The column after the last one.
    pub(crate) end: u32,
    /// Its region's place among [`Runs::regions`].
    pub(crate) label: u32,
}

impl Run {
    /// Where it lies in a plane of rows of `width`.
    #[inline(always)]
    pub(crate) fn place(&self, width: usize) -> Range<usize> {
        let row = self.y as usize * width;
        row + self.start as usize..row + self.end as usize
    }
}

/// A connected region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Region {
    /// Its pixels.
    pub(crate) area: u32,
    /// First column and row.
    pub(crate) left: u32,
    /// See `left`.
    pub(crate) top: u32,
    /// The column and the row after its last ones.
    pub(crate) right: u32,
    /// See `right`.
    pub(crate) bottom: u32,
}

impl Region {
    pub(super) const NOTHING: Self = Self {
        area: 0,
        left: u32::MAX,
        top: u32::MAX,
        right: 0,
        bottom: 0,
    };

    /// Whether it lies at the border of a frame.
    pub(crate) fn touches_border(&self, (width, height): (usize, usize)) -> bool {
        self.left == 0
            || self.top == 0
            || self.right as usize == width
            || self.bottom as usize == height
    }

    pub(super) fn add(&mut self, run: &Run) {
        self.area += run.end - run.start;
        self.left = self.left.min(run.start);
        self.right = self.right.max(run.end);
        self.top = self.top.min(run.y);
        self.bottom = self.bottom.max(run.y + 1);
    }
}

/// The first pixel of a row from `x` on that is `value`, the row's end if there is none.
pub(super) fn next(row: &[u8], mut x: usize, value: u8) -> usize {
    // All zero where a byte is not `value`, all one where it is: a byte is 0 or 1.
    let flip = if value == 1 { 0 } else { 0x0101_0101_0101_0101 };
    while let Some(far) = row.get(x..).and_then(|rest| rest.first_chunk::<64>()) {
        let mut any = 0;
        for chunk in far.as_chunks::<8>().0 {
            any |= u64::from_le_bytes(*chunk) ^ flip;
        }
        if any != 0 {
            break;
        }
        x += 64;
    }
    while let Some(near) = row.get(x..).and_then(|rest| rest.first_chunk::<8>()) {
        let found = u64::from_le_bytes(*near) ^ flip;
        if found != 0 {
            return x + (found.trailing_zeros() / 8) as usize;
        }
        x += 8;
    }
    let rest = row.get(x..).unwrap_or_default();
    x.min(row.len())
        + rest
            .iter()
            .position(|byte| *byte == value)
            .unwrap_or(rest.len())
}
