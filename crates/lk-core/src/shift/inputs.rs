//! The parts of the frames that matter, as planes of all levels, and where their pixels may be used.

use std::sync::atomic::{AtomicBool, Ordering};

use ndarray::ArrayView2;

use super::coordinates::Pair;
use super::normalization::Normalization;
use super::options::Roi;
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane, pixels_of, read_row};
use crate::parallel::for_each_band;
use crate::pyramid::Pyramid;
use crate::simd::{Kernel, Simd, dispatch};
use crate::support::Masks;

/// Pixels on each side that a filter reads: the taps at every level, and the pyramid from level to level.
const FILTER_RADIUS: usize = 2;
/// The least share of the pixels below one of a coarser level that must count.
const LEAST_SHARE: f32 = 0.75;
/// Pixels around the window that the filters read.
const MARGIN: usize = 4;
/// How often to halve the frames for the start: until the longer side is at most 160, and the shorter at least 16.
fn coarse_levels(roi: Roi, limit: [f64; 2], frame: [usize; 2]) -> usize {
    let reach = |side: usize, limit: f64, frame: usize| {
        ((side as f64 + 2.0 * limit).min(frame as f64)).ceil() as usize
    };
    let longest = reach(roi.width, limit[0], frame[0]).max(reach(roi.height, limit[1], frame[1]));
    let shortest = roi.width.min(roi.height);
    let mut levels = 0;
    while shortest >> (levels + 1) >= 16 && (levels == 0 || longest >> levels > 160) {
        levels += 1;
    }
    levels
}
/// The frames' parts that matter, as planes, at all levels; memory is kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Inputs {
    prev: Pyramid,
    next: Pyramid,
    prev_weights: Vec<Option<Plane>>,
    next_weights: Vec<Option<Plane>>,
    origin: [isize; 2],
    window: [(usize, usize); 2],
    pub(super) normalization: Normalization,
    pub(super) usable: f64,
    pub(super) levels: usize,
    /// Pixels along a side of a tile at the finest level.
    pub(super) tile: usize,
}

impl Inputs {
    /// Take what may matter of the frames.
    pub(super) fn take<T: Pixel>(
        &mut self,
        prev: Frame<'_, T>,
        next: Frame<'_, T>,
        masks: Masks<'_>,
        roi: Roi,
        limit: [f64; 2],
        execution: &Execution,
    ) -> Result<()> {
        let (height, width) = prev.dim();
        let levels = coarse_levels(roi, limit, [width, height]);
        let (start, length, size) = ([roi.x, roi.y], [roi.width, roi.height], [width, height]);
        // Both planes begin at the same pixels of the coarsest level.
        let step = 1usize << levels;
        let margin = MARGIN.next_multiple_of(step);
        let mut prev_range = [(0, 0); 2];
        let mut next_range = [(0, 0); 2];
        for axis in 0..2 {
            let low = start[axis] - start[axis].min(margin) / step * step;
            prev_range[axis] = (low, (start[axis] + length[axis] + margin).min(size[axis]));
            let reach = (limit[axis].min(size[axis] as f64).ceil() as usize + margin)
                .next_multiple_of(step);
            let back = reach.min(low) / step * step;
            next_range[axis] = (
                low - back,
                (start[axis] + length[axis] + reach).min(size[axis]),
            );
        }
        let [prev, next] =
            [(prev, prev_range), (next, next_range)].map(|(frame, range)| part(frame, range));
        for (what, frame) in [("prev", prev), ("next", next)] {
            pixels_of(what, frame.dim())?;
        }
        let [mask, next_mask] = [(masks.of_prev(), prev_range), (masks.of_next(), next_range)]
            .map(|(mask, range)| mask.map(|mask| part(mask, range)));
        self.normalization = Normalization::new([(prev, mask), (next, next_mask)]);
        let prev_weight = read(
            prev,
            mask,
            self.normalization,
            &mut self.prev,
            levels,
            execution,
        )?;
        let next_weight = read(
            next,
            next_mask,
            self.normalization,
            &mut self.next,
            levels,
            execution,
        )?;
        self.window = std::array::from_fn(|axis| {
            let low = start[axis] - prev_range[axis].0;
            (low, low + length[axis])
        });
        let [columns, rows] = self.window;
        self.usable = prev_weight
            .as_ref()
            .map_or((length[0] * length[1]) as f64, |plane| {
                let rows = (rows.0..rows.1).map(|y| &plane.row(y)[columns.0..columns.1]);
                rows.flatten().map(|value| f64::from(*value)).sum()
            });
        self.prev_weights = weight_levels(prev_weight, levels)?;
        self.next_weights = weight_levels(next_weight, levels)?;
        self.origin =
            std::array::from_fn(|axis| next_range[axis].0 as isize - prev_range[axis].0 as isize);
        self.levels = levels;
        self.tile = if length[0].min(length[1]) < 128 {
            16
        } else {
            24
        };
        Ok(())
    }

    /// The centre of the window, in pixels of the plane of `prev`.
    pub(super) fn center(&self) -> [f64; 2] {
        self.window.map(|(low, high)| (low + high - 1) as f64 / 2.0)
    }

    /// Half the longer side of the window, in pixels.
    pub(super) fn half_side(&self) -> f64 {
        let longer = self.window.map(|(low, high)| high - low).into_iter().max();
        longer.unwrap_or(1) as f64 / 2.0
    }

    /// Pixels of both frames that are held.
    pub(super) fn pixels(&self) -> usize {
        [&self.prev, &self.next]
            .into_iter()
            .filter_map(|pyramid| pyramid.levels().first())
            .map(|plane| plane.data().len())
            .sum()
    }

    pub(super) fn pair(&self, level: usize) -> Pair<'_> {
        Pair {
            prev: &self.prev.levels()[level],
            next: &self.next.levels()[level],
            prev_weight: self.prev_weights[level].as_ref(),
            next_weight: self.next_weights[level].as_ref(),
            origin: self.origin.map(|value| value >> level),
            window: self
                .window
                .map(|(low, high)| (low >> level, (high >> level).max((low >> level) + 1))),
        }
    }
}

/// The part of an array in a range of columns and one of rows.
fn part<T>(whole: ArrayView2<'_, T>, range: [(usize, usize); 2]) -> ArrayView2<'_, T> {
    let [columns, rows] = range.map(|(low, high)| low..high);
    whole.slice_move(ndarray::s![rows, columns])
}

/// Read `frame` into the levels of `pyramid`; a weight where some pixels are not finite or masked.
fn read<T: Pixel>(
    frame: Frame<'_, T>,
    mask: Option<ArrayView2<'_, bool>>,
    normalization: Normalization,
    pyramid: &mut Pyramid,
    levels: usize,
    execution: &Execution,
) -> Result<Option<Plane>> {
    let (height, width) = frame.dim();
    let (mean, scale) = (normalization.mean as f32, normalization.scale as f32);
    let finite = AtomicBool::new(true);
    pyramid.resize([width, height], levels + 1)?;
    let plane = &mut pyramid.levels_mut()[0];
    let level = execution.simd_level();
    for_each_band(
        execution,
        height,
        (65_536 / width.max(1)).max(1),
        plane.rows_mut(),
        |rows, mut part| {
            for (local, y) in rows.enumerate() {
                let row = part.row_mut(local);
                let kernel = ReadRow {
                    frame,
                    y,
                    mean,
                    scale,
                    row,
                };
                if !dispatch(level, kernel) {
                    finite.store(false, Ordering::Relaxed);
                }
            }
        },
    )?;
    let mask = mask.filter(|mask| mask.iter().any(|counts| !counts));
    let mut weight = None;
    if !finite.into_inner() || mask.is_some() {
        let weight = weight.insert(Plane::new(width, height)?);
        for (to, value) in weight.data_mut().iter_mut().zip(plane.data()) {
            *to = if value.is_finite() { 1.0 } else { 0.0 };
        }
        for y in 0..height {
            let counts = weight.row_mut(y);
            if let Some(mask) = mask {
                for (to, counts) in counts.iter_mut().zip(mask.row(y)) {
                    *to = if *counts { *to } else { 0.0 };
                }
            }
            fill(plane.row_mut(y), counts);
        }
    }
    pyramid.reduce_again(execution)?;
    Ok(weight)
}

/// Read one row of a frame in the unit of the planes; whether all of it is finite.
struct ReadRow<'a, T> {
    frame: Frame<'a, T>,
    y: usize,
    mean: f32,
    scale: f32,
    row: &'a mut [f32],
}

impl<T: Pixel> Kernel for ReadRow<'_, T> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> bool {
        read_row(self.frame, self.y, self.row);
        let mut finite = true;
        for value in self.row {
            *value = (*value - self.mean) * self.scale;
            finite &= value.is_finite();
        }
        finite
    }
}

/// Put into each pixel that does not count the last one of its row that does, so that filters meet no edge; zero, the
/// mean, where the row has none.
fn fill(row: &mut [f32], counts: &[f32]) {
    let first = counts.iter().position(|counts| *counts > 0.0);
    let mut last = first.map_or(0.0, |first| row[first]);
    for (value, counts) in row.iter_mut().zip(counts) {
        if *counts > 0.0 {
            last = *value;
        } else {
            *value = last;
        }
    }
}

/// The weights of all levels. At the finest a pixel counts where all pixels that the filters read for it do. At a coarser
/// one it is made of many, and a few that were filled in are no harm: it counts where most of them do.
fn weight_levels(weight: Option<Plane>, levels: usize) -> Result<Vec<Option<Plane>>> {
    let Some(mut share) = weight else {
        return Ok(vec![None; levels + 1]);
    };
    let mut result = vec![Some(eroded(&share, FILTER_RADIUS)?)];
    for _ in 0..levels {
        share = halved(&share)?;
        let mut counts = Plane::new(share.width(), share.height())?;
        for (to, share) in counts.data_mut().iter_mut().zip(share.data()) {
            *to = if *share >= LEAST_SHARE { 1.0 } else { 0.0 };
        }
        result.push(Some(counts));
    }
    Ok(result)
}

/// The share that counts of the pixels that the pyramid makes each pixel of the next level from.
fn halved(share: &Plane) -> Result<Plane> {
    const TAPS: [f32; 2 * FILTER_RADIUS + 1] = [0.0625, 0.25, 0.375, 0.25, 0.0625];
    let (width, height) = (share.width(), share.height());
    let near = |at: usize, k: usize, size: usize| {
        (at + k)
            .saturating_sub(FILTER_RADIUS)
            .min(size.saturating_sub(1))
    };
    let mut half = Plane::new(width.div_ceil(2), height.div_ceil(2))?;
    for y in 0..half.height() {
        for (x, to) in half.row_mut(y).iter_mut().enumerate() {
            for (j, down) in TAPS.iter().enumerate() {
                let row = share.row(near(2 * y, j, height));
                for (i, across) in TAPS.iter().enumerate() {
                    *to += down * across * row[near(2 * x, i, width)];
                }
            }
        }
    }
    Ok(half)
}

/// 1 where all pixels within `radius` are 1.
fn eroded(plane: &Plane, radius: usize) -> Result<Plane> {
    let (width, height) = (plane.width(), plane.height());
    let mut across = Plane::new(width, height)?;
    for y in 0..height {
        let row = plane.row(y);
        for x in 0..width {
            let near = &row[x.saturating_sub(radius)..(x + radius + 1).min(width)];
            across.row_mut(y)[x] = near.iter().copied().fold(1.0, f32::min);
        }
    }
    let mut result = Plane::new(width, height)?;
    for y in 0..height {
        for near in y.saturating_sub(radius)..(y + radius + 1).min(height) {
            let (row, to) = (across.row(near), result.row_mut(y));
            if near == y.saturating_sub(radius) {
                to.copy_from_slice(row);
            } else {
                for (to, from) in to.iter_mut().zip(row) {
                    *to = to.min(*from);
                }
            }
        }
    }
    Ok(result)
}
