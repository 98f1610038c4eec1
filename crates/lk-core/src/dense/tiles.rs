//! Strips of columns: the rows under way of a wide picture would not stay in the cache together.

use crate::simd::LANES;

/// Bytes that the rows under way of one thread may take.
const CACHE: usize = 5 << 17;

/// Strips begin at whole pairs of groups of lanes: rows that are split into even and odd pixels then split alike.
const STEP: usize = 2 * LANES;

/// Columns `start..end` of a picture, and what is computed beside them so that they come out as if the strip had no
/// sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Columns {
    pub(super) start: usize,
    pub(super) end: usize,
    /// The first column that is computed.
    pub(super) from: usize,
    /// The column after the last one that is computed.
    pub(super) to: usize,
}

impl Columns {
    /// Divide `width` columns where `floats` elements are under way for each; a pixel depends on those up to `reach`
    /// columns away.
    pub(super) fn strips(
        width: usize,
        floats: usize,
        reach: usize,
    ) -> impl Iterator<Item = Self> + Clone {
        let most = (CACHE / (floats * size_of::<f32>()))
            .max(8 * reach)
            .max(STEP);
        let each = width.div_ceil(width.div_ceil(most)).next_multiple_of(STEP);
        let reach = reach.next_multiple_of(STEP);
        (0..width).step_by(each).map(move |start| Self {
            start,
            end: (start + each).min(width),
            from: start.saturating_sub(reach),
            to: (start + each + reach).min(width),
        })
    }

    /// The columns of a picture of `width` that lie under these, which are of half its size.
    pub(super) fn doubled(&self, width: usize) -> Self {
        Self {
            start: 2 * self.start,
            end: (2 * self.end).min(width),
            from: 2 * self.from,
            to: (2 * self.to).min(width),
        }
    }

    /// Columns that are computed.
    pub(super) fn computed(&self) -> usize {
        self.to - self.from
    }

    /// Elements of a split row before the first one that is wanted.
    pub(super) fn skipped(&self) -> usize {
        (self.start - self.from) / 2
    }

    /// Pairs of groups of lanes that hold the columns `start..end`.
    pub(super) fn groups(&self) -> usize {
        (self.end - self.start).div_ceil(STEP)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_cover_every_column_once() {
        for width in [2, 31, 32, 33, 640, 1920, 3840, 5001] {
            for floats in [1, 75, 300, 5000] {
                for reach in [0, 4, 40] {
                    let mut next = 0;
                    for strip in Columns::strips(width, floats, reach) {
                        assert_eq!((strip.start, strip.start % STEP), (next, 0));
                        assert!(strip.from % STEP == 0 && strip.end > strip.start);
                        assert!(strip.from == 0 || strip.from + reach <= strip.start);
                        assert!(strip.to == width || strip.to >= strip.end + reach);
                        assert!(strip.groups() * STEP >= strip.end - strip.start);
                        next = strip.end;
                    }
                    assert_eq!(next, width);
                }
            }
        }
        assert_eq!(Columns::strips(640, 75, 4).count(), 1);
        assert!(Columns::strips(3840, 75, 4).count() > 1);
    }
}
