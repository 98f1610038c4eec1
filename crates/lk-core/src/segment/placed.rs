//! Pictures and masks that are moved by maps of the plane.

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{SimdLevel, dispatch};

use super::morphology::Size;
use super::placed_kernels::{Covered, Nearest};
use super::runs::next;
use super::sampling::{Cubic, Places};
use super::transform::{Map, applied, inverse};

/// A row of a picture seen at places of it, and whether it has each.
pub(crate) struct Moved<'a> {
    /// The picture, and its columns and rows.
    pub(crate) from: (&'a [f32], Size),
    /// From pixels of what is written to those of the picture.
    pub(crate) map: &'a Map,
}

impl Moved<'_> {
    /// Write row `y` with cubic interpolation. Beyond the picture stands its border, and `inside` is 0. `spare` has twice
    /// the columns of what is written.
    pub(crate) fn row(
        &self,
        y: usize,
        to: &mut [f32],
        inside: &mut [u8],
        spare: &mut [f32],
        level: SimdLevel,
    ) {
        let places = places(self.map, y, 0..to.len(), spare, level);
        let (from, size) = self.from;
        dispatch(
            level,
            Cubic {
                from,
                size,
                places,
                to,
                inside,
            },
        );
    }
}

/// Where `map` takes some columns of row `y`.
pub(super) fn places<'a>(
    map: &Map,
    y: usize,
    columns: Range<usize>,
    spare: &'a mut [f32],
    level: SimdLevel,
) -> [&'a [f32]; 2] {
    let (x, rest) = spare.split_at_mut(columns.len());
    let down = &mut rest[..columns.len()];
    let to = [&mut *x, &mut *down];
    let first = columns.start;
    dispatch(level, Places { map, y, first, to });
    [x, down]
}

/// Write what `from` has at the nearest pixel of where `map` takes each pixel of `to`; `missing` beyond.
///
/// # Errors
///
/// Those of the execution.
pub(crate) fn nearest<T: Copy + Send + Sync>(
    (from, (width, height)): (&[T], Size),
    map: &Map,
    (to, to_size): (&mut [T], Size),
    missing: T,
    execution: &Execution,
) -> Result<()> {
    if to_size.0 == 0 {
        return Ok(());
    }
    let level = execution.simd_level();
    let columns = to_size.0;
    let rows = even_bands(execution, to_size.1, [65_536 / columns, 16_384 / columns]);
    let outputs = RowsMut::new(to, columns);
    for_each_band(execution, to_size.1, rows, outputs, |band, mut part| {
        with_scratch(2 * columns, |spare| {
            for (local, y) in band.enumerate() {
                let kernel = Nearest {
                    from,
                    size: (width, height),
                    places: places(map, y, 0..columns, spare, level),
                    missing,
                    to: part.row_mut(local),
                };
                dispatch(level, kernel);
            }
        })
    })
}

/// [`nearest`] of a mask, of which little is set: 0 beyond.
///
/// # Errors
///
/// Those of the execution.
pub(crate) fn nearest_mask(
    (from, size): (&[u8], Size),
    map: &Map,
    (to, to_size): (&mut [u8], Size),
    execution: &Execution,
) -> Result<()> {
    seen_of_mask((from, size), map, (to, to_size), false, execution)
}

/// Write where a mask covers at least half of what is around the place that `map` takes each pixel of `to` to.
///
/// # Errors
///
/// Those of the execution.
pub(crate) fn covered(
    from: (&[u8], Size),
    map: &Map,
    (to, to_size): (&mut [u8], Size),
    execution: &Execution,
) -> Result<()> {
    seen_of_mask(from, map, (to, to_size), true, execution)
}

/// Write what a mask has at the nearest pixel, or `by_half` where it covers half of what is around a place, in the part of
/// `to` that something set can come to; 0 in the rest.
fn seen_of_mask(
    (from, size): (&[u8], Size),
    map: &Map,
    (to, to_size): (&mut [u8], Size),
    by_half: bool,
    execution: &Execution,
) -> Result<()> {
    to.fill(0);
    let spans = spans(from, size)?;
    let Some([columns, rows]) = reached(&spans, map, to_size) else {
        return Ok(());
    };
    let level = execution.simd_level();
    let (stride, width) = (to_size.0, columns.len());
    let to = &mut to[rows.start * stride..rows.end * stride];
    let bands = even_bands(execution, rows.len(), [65_536 / width, 16_384 / width]);
    let outputs = RowsMut::new(to, stride);
    for_each_band(execution, rows.len(), bands, outputs, |band, mut part| {
        with_scratch(2 * width, |spare| {
            for (local, y) in band.enumerate() {
                let y = rows.start + y;
                let [px, py] = places(map, y, columns.clone(), spare, level);
                let ends = [columns.start, columns.end - 1];
                let Some(part_of) = between(&spans, [px, py], ends.map(|x| depth(map, x, y)))
                else {
                    continue;
                };
                let places = [&px[part_of.clone()], &py[part_of.clone()]];
                let to = &mut part.row_mut(local)[columns.clone()][part_of];
                if by_half {
                    let kernel = Covered {
                        from,
                        size,
                        places,
                        to,
                    };
                    dispatch(level, kernel);
                } else {
                    let kernel = Nearest {
                        from,
                        size,
                        places,
                        missing: 0,
                        to,
                    };
                    dispatch(level, kernel);
                }
            }
        })
    })
}

/// First and last column of what is set in a row; the first is after the last where there is nothing.
type Span = (u32, u32);
const NOTHING: Span = (u32::MAX, 0);

fn spans(mask: &[u8], (width, height): Size) -> Result<Vec<Span>> {
    let mut spans = Vec::new();
    resize("rows of a mask", &mut spans, height, NOTHING)?;
    for (span, row) in spans.iter_mut().zip(mask.chunks_exact(width.max(1))) {
        let first = next(row, 0, 1);
        if first < width {
            let last = row.iter().rposition(|set| *set == 1).unwrap_or(first);
            *span = (first as u32, last as u32);
        }
    }
    Ok(spans)
}

fn union(spans: &[Span]) -> Span {
    spans
        .iter()
        .fold(NOTHING, |all, span| (all.0.min(span.0), all.1.max(span.1)))
}

/// What a map divides a place by.
fn depth(map: &Map, x: usize, y: usize) -> f64 {
    map[2][0] * x as f64 + map[2][1] * y as f64 + map[2][2]
}

/// Which of the places along a row can have something of a mask; `None` where none can. `depths` are those of its ends: without
/// a horizon between them places go one way all along.
fn between(spans: &[Span], [px, py]: [&[f32]; 2], depths: [f64; 2]) -> Option<Range<usize>> {
    let last = px.len() - 1;
    if depths.iter().any(|depth| depth.is_nan() || *depth <= 1e-6) {
        return Some(0..px.len());
    }
    let (low, high) = (py[0].min(py[last]) - 2.0, py[0].max(py[last]) + 3.0);
    // What is below 0 is 0.
    let (top, bottom) = (low as usize, (high as usize).min(spans.len()));
    let (first, end) = union(spans.get(top..bottom)?);
    if first > end {
        return None;
    }
    if px[0] > px[last] {
        return Some(0..px.len());
    }
    let (first, end) = (first as f32 - 2.0, end as f32 + 2.0);
    let start = px.partition_point(|x| *x < first);
    let end = px.partition_point(|x| *x <= end);
    (start < end).then_some(start..end)
}

/// Columns and rows of what is written that can have something of a mask; `None` where nothing has.
fn reached(spans: &[Span], map: &Map, (columns, rows): Size) -> Option<[Range<usize>; 2]> {
    let (left, right) = union(spans);
    let top = spans.iter().position(|span| *span != NOTHING)?;
    let bottom = spans.iter().rposition(|span| *span != NOTHING)?;
    let [left, top, right, bottom] = [f64::from(left), top as f64, f64::from(right), bottom as f64];
    let all = [0..columns, 0..rows];
    let Some(back) = inverse(map) else {
        return Some(all);
    };
    // Up to one pixel around what is set is written, and one for rounding.
    let (low, high) = ([left - 2.0, top - 2.0], [right + 2.0, bottom + 2.0]);
    let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in [low, [high[0], low[1]], high, [low[0], high[1]]] {
        let w = back[2][0] * corner[0] + back[2][1] * corner[1] + back[2][2];
        if w.is_nan() || w <= 1e-6 {
            return Some(all);
        }
        for (axis, value) in applied(&back, corner).into_iter().enumerate() {
            least[axis] = least[axis].min(value);
            most[axis] = most[axis].max(value);
        }
    }
    let ranges = [columns, rows].map(|count| 0..count);
    let mut axis = 0;
    let ranges = ranges.map(|all| {
        let (least, most) = (least[axis] - 2.0, most[axis] + 3.0);
        axis += 1;
        // What is no number, or below 0, is 0.
        (least as usize).min(all.end)..(most as usize).min(all.end)
    });
    ranges
        .iter()
        .all(|range| range.start < range.end)
        .then_some(ranges)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::transform::{along_row, shift};
    use super::*;
    use crate::segment::made::{Numbers, every_way, mask};

    #[test]
    fn whole_pixels_move_without_a_change() {
        let size = (7, 5);
        let from: Vec<f32> = (0..35).map(|k| (k * k % 13) as f32).collect();
        let map = shift(2.0, 1.0);
        let moved = Moved {
            from: (&from, size),
            map: &map,
        };
        for y in 0..4 {
            let (mut row, mut inside, mut spare) = (vec![0.0; 7], vec![0; 7], vec![0.0; 14]);
            moved.row(y, &mut row, &mut inside, &mut spare, SimdLevel::detected());
            assert_eq!(row[..5], from[(y + 1) * 7 + 2..(y + 2) * 7]);
            assert_eq!(inside, [1, 1, 1, 1, 1, 0, 0]);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn masks_are_seen_where_single_places_say(
            w in 1usize..90, h in 1usize..40, seed in any::<u64>(), share in 0usize..4, kind in 0..5
        ) {
            let (size, to_size) = ((w, h), (w + 7, h + 3));
            let mut numbers = Numbers::new(seed);
            let mut n = |size: f64| size * numbers.normal();
            let map = match kind {
                0 => shift(n(3.0).round(), n(2.0).round()),
                1 => [[0.5, 0.0, -0.25], [0.0, 0.5, -0.25], [0.0, 0.0, 1.0]],
                2 => [[1.0 + n(0.1), n(0.1), n(3.0)], [n(0.1), 1.0 + n(0.1), n(3.0)], [0.0, 0.0, 1.0]],
                3 => [[1.0, n(0.05), n(3.0)], [n(0.05), 1.0, n(3.0)], [n(0.03), n(0.03), 1.0]],
                _ => [[0.0; 3]; 3],
            };
            let from = mask(size, [0.0, 0.002, 0.05, 0.6][share], seed);
            let (mut want, mut half) = (vec![0; to_size.0 * to_size.1], vec![0; to_size.0 * to_size.1]);
            for y in 0..to_size.1 {
                along_row(&map, y, to_size.0, |x, px, py| {
                    let at = y * to_size.0 + x;
                    let (nx, ny) = (px + 0.5, py + 0.5);
                    if nx >= 0.0 && ny >= 0.0 && nx < w as f32 && ny < h as f32 {
                        want[at] = from[ny as usize * w + nx as usize];
                    }
                    if px > -1.0 && py > -1.0 && px < w as f32 && py < h as f32 {
                        let (left, top) = (px.max(0.0) as usize, py.max(0.0) as usize);
                        let (right, down) = ((left + 1).min(w - 1), (top + 1).min(h - 1));
                        let of = |y: usize, x: usize| f32::from(from[y * w + x]);
                        let (fx, fy) = (px - left as f32, py - top as f32);
                        let upper = of(top, left) + fx * (of(top, right) - of(top, left));
                        let lower = of(down, left) + fx * (of(down, right) - of(down, left));
                        half[at] = u8::from(upper + fy * (lower - upper) >= 0.5);
                    }
                });
            }
            for execution in every_way() {
                let mut to = vec![7; want.len()];
                nearest_mask((&from, size), &map, (&mut to, to_size), &execution).unwrap();
                prop_assert_eq!(&to, &want);
                nearest((&from, size), &map, (&mut to, to_size), 0, &execution).unwrap();
                prop_assert_eq!(&to, &want);
                covered((&from, size), &map, (&mut to, to_size), &execution).unwrap();
                prop_assert_eq!(&to, &half);
            }
        }
    }
}
