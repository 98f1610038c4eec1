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
    if let Some([right, down]) = whole_pixels(map) {
        return for_each_band(execution, to_size.1, rows, outputs, |band, mut part| {
            for (local, y) in band.enumerate() {
                let y = y as i64 + down;
                let row = usize::try_from(y).ok().filter(|y| *y < height);
                let row = row.map_or(&[][..], |y| &from[y * width..(y + 1) * width]);
                copy_shifted(row, right, missing, part.row_mut(local));
            }
        });
    }
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

/// The pixels that a map goes to the right and down, if it does nothing else.
fn whole_pixels(map: &Map) -> Option<[i64; 2]> {
    let [[a, b, right], [d, e, down], last] = *map;
    let straight = [a, b] == [1.0, 0.0] && [d, e] == [0.0, 1.0] && last == [0.0, 0.0, 1.0];
    let whole = |way: f64| way.fract() == 0.0 && way.abs() < 1e6;
    (straight && whole(right) && whole(down)).then_some([right as i64, down as i64])
}

/// Write a row that begins `right` pixels on in another one.
fn copy_shifted<T: Copy>(from: &[T], right: i64, missing: T, to: &mut [T]) {
    let (skip, at) = (right.max(0) as usize, (-right).max(0) as usize);
    let from = from.get(skip..).unwrap_or_default();
    let at = at.min(to.len());
    let (before, rest) = to.split_at_mut(at);
    let count = from.len().min(rest.len());
    before.fill(missing);
    rest[..count].copy_from_slice(&from[..count]);
    rest[count..].fill(missing);
}

/// [`nearest`] of a mask, of which little is set: 0 beyond.
///
/// # Errors
///
/// Those of the execution.
pub(crate) fn nearest_mask(
    from: (&[u8], Size),
    map: &Map,
    to: (&mut [u8], Size),
    execution: &Execution,
) -> Result<()> {
    nearest_of_few(from, |set| *set == 1, map, to, 0, execution)
}

/// [`nearest`] of a plane that has nothing but `missing` at most places: `set` says where it has something else.
///
/// # Errors
///
/// Those of the execution.
pub(crate) fn nearest_of_few<T: Copy + Send + Sync>(
    (from, size): (&[T], Size),
    set: impl Fn(&T) -> bool,
    map: &Map,
    (to, to_size): (&mut [T], Size),
    missing: T,
    execution: &Execution,
) -> Result<()> {
    to.fill(missing);
    let level = execution.simd_level();
    let write = |places: [&[f32]; 2], to: &mut [T]| {
        let kernel = Nearest {
            from,
            size,
            places,
            missing,
            to,
        };
        dispatch(level, kernel);
    };
    where_set(
        &spans(from, size, set)?,
        map,
        (to, to_size),
        write,
        execution,
    )
}

/// Write where a mask covers at least half of what is around the place that `map` takes each pixel of `to` to.
///
/// # Errors
///
/// Those of the execution.
pub(crate) fn covered(
    (from, size): (&[u8], Size),
    map: &Map,
    (to, to_size): (&mut [u8], Size),
    execution: &Execution,
) -> Result<()> {
    to.fill(0);
    let level = execution.simd_level();
    let write = |places: [&[f32]; 2], to: &mut [u8]| {
        let kernel = Covered {
            from,
            size,
            places,
            to,
        };
        dispatch(level, kernel);
    };
    let spans = spans(from, size, |set| *set == 1)?;
    where_set(&spans, map, (to, to_size), write, execution)
}

/// Write rows in the part of `to` that what is set in a plane can come to: `write` is called with places and what stands there.
fn where_set<T: Send>(
    spans: &[Span],
    map: &Map,
    (to, to_size): (&mut [T], Size),
    write: impl Fn([&[f32]; 2], &mut [T]) + Sync,
    execution: &Execution,
) -> Result<()> {
    let Some([columns, rows]) = reached(spans, map, to_size) else {
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
                let Some(part_of) = between(spans, [px, py], ends.map(|x| depth(map, x, y))) else {
                    continue;
                };
                let places = [&px[part_of.clone()], &py[part_of.clone()]];
                let to = &mut part.row_mut(local)[columns.clone()][part_of];
                write(places, to);
            }
        })
    })
}

/// First and last column of what is set in a row; the first is after the last where there is nothing.
type Span = (u32, u32);
const NOTHING: Span = (u32::MAX, 0);

fn spans<T>(plane: &[T], (width, height): Size, set: impl Fn(&T) -> bool) -> Result<Vec<Span>> {
    let mut spans = Vec::new();
    resize("rows of a mask", &mut spans, height, NOTHING)?;
    for (span, row) in spans.iter_mut().zip(plane.chunks_exact(width.max(1))) {
        // A row in which nothing is set is read in lanes.
        if row.iter().fold(false, |any, value| any | set(value)) {
            let first = row.iter().position(&set).unwrap_or(0);
            let last = row.iter().rposition(&set).unwrap_or(first);
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
mod tests;
