//! The parts of the frames that matter, as planes of all levels, and where their pixels may be used.

use ndarray::ArrayView2;

use super::Roi;
use super::refine::Pair;
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane, read_row};
use crate::pyramid::Pyramid;

/// Pixels on each side that a filter reads: the taps at every level, and the pyramid from level to level.
const FILTER_RADIUS: usize = 2;
/// Pixels around the window that the filters read.
const MARGIN: usize = 4;
/// How often to halve the frames for the start: until the longer side is at most 160, and the shorter at least 16.
pub(super) fn coarse_levels(roi: Roi, limit: [f64; 2], frame: [usize; 2]) -> usize {
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
/// The frames' parts that matter, as planes, at all levels.
pub(super) struct Inputs {
    prev: Pyramid,
    next: Pyramid,
    prev_weights: Vec<Option<Plane>>,
    next_weights: Vec<Option<Plane>>,
    origin: [isize; 2],
    window: [(usize, usize); 2],
    /// Taken from both frames, so that sums of squares do not lose digits.
    pub(super) mean: f64,
    pub(super) usable: f64,
    pub(super) levels: usize,
    /// Pixels along a side of a tile at the finest level.
    pub(super) tile: usize,
}

impl Inputs {
    pub(super) fn new<T: Pixel>(
        prev: Frame<'_, T>,
        next: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        roi: Roi,
        limit: [f64; 2],
        levels: usize,
    ) -> Self {
        let (height, width) = prev.dim();
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
        let (mut prev_plane, mut prev_weight) = crop(prev, prev_range);
        let (mut next_plane, next_weight) = crop(next, next_range);
        if let Some(mask) = mask {
            let weight = prev_weight.get_or_insert_with(|| {
                let mut plane = Plane::new(prev_plane.width(), prev_plane.height());
                plane.data_mut().fill(1.0);
                plane
            });
            for y in 0..weight.height() {
                for (x, value) in weight.row_mut(y).iter_mut().enumerate() {
                    if !mask[(prev_range[1].0 + y, prev_range[0].0 + x)] {
                        *value = 0.0;
                    }
                }
            }
        }
        let window = std::array::from_fn(|axis| {
            let low = start[axis] - prev_range[axis].0;
            (low, low + length[axis])
        });
        let mean = (mean_of(&prev_plane, prev_weight.as_ref())
            + mean_of(&next_plane, next_weight.as_ref()))
            / 2.0;
        for plane in [&mut prev_plane, &mut next_plane] {
            for value in plane.data_mut() {
                *value -= mean as f32;
            }
        }
        let usable = prev_weight
            .as_ref()
            .map_or((length[0] * length[1]) as f64, |plane| {
                plane.data().iter().map(|value| f64::from(*value)).sum()
            });
        let execution = Execution::default().threads(1);
        let build = |plane: &Plane| {
            let view = ArrayView2::from_shape((plane.height(), plane.width()), plane.data());
            view.map_or_else(
                |_| Pyramid::default(),
                |view| Pyramid::new(view, levels + 1, &execution).unwrap_or_default(),
            )
        };
        Self {
            prev: build(&prev_plane),
            next: build(&next_plane),
            prev_weights: weight_levels(prev_weight, levels),
            next_weights: weight_levels(next_weight, levels),
            origin: std::array::from_fn(|axis| {
                next_range[axis].0 as isize - prev_range[axis].0 as isize
            }),
            window,
            mean,
            usable,
            levels,
            tile: if length[0].min(length[1]) < 128 {
                16
            } else {
                24
            },
        }
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

/// The pixels of `frame` in `range` (columns, rows), and a weight where some are not finite.
fn crop<T: Pixel>(frame: Frame<'_, T>, range: [(usize, usize); 2]) -> (Plane, Option<Plane>) {
    let part = frame.slice(ndarray::s![range[1].0..range[1].1, range[0].0..range[0].1]);
    let (height, width) = part.dim();
    let mut plane = Plane::new(width, height);
    for y in 0..height {
        read_row(part, y, plane.row_mut(y));
    }
    if plane.data().iter().all(|value| value.is_finite()) {
        return (plane, None);
    }
    let mut weight = Plane::new(width, height);
    for (to, value) in weight.data_mut().iter_mut().zip(plane.data()) {
        *to = if value.is_finite() { 1.0 } else { 0.0 };
    }
    let mean = mean_of(&plane, Some(&weight)) as f32;
    for y in 0..height {
        fill(plane.row_mut(y), mean);
    }
    (plane, Some(weight))
}

/// Put into each pixel that is not finite the last finite one of its row, so that filters meet no edge.
fn fill(row: &mut [f32], otherwise: f32) {
    let mut last = row
        .iter()
        .copied()
        .find(|value| value.is_finite())
        .unwrap_or(otherwise);
    for value in row {
        if value.is_finite() {
            last = *value;
        } else {
            *value = last;
        }
    }
}

fn mean_of(plane: &Plane, weight: Option<&Plane>) -> f64 {
    let Some(weight) = weight else {
        let rows = (0..plane.height()).map(|y| lane_sum(plane.row(y)));
        return rows.sum::<f64>() / plane.data().len().max(1) as f64;
    };
    let (mut sum, mut count) = (0.0f64, 0.0f64);
    for (value, w) in plane.data().iter().zip(weight.data()) {
        if *w > 0.0 {
            sum += f64::from(*value);
            count += 1.0;
        }
    }
    sum / f64::max(count, 1.0)
}

/// The sum of a row in lanes, in a fixed order.
fn lane_sum(row: &[f32]) -> f64 {
    let (chunks, rest) = row.as_chunks::<8>();
    let mut lanes = [0.0f32; 8];
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += value;
        }
    }
    lanes
        .iter()
        .chain(rest)
        .map(|value| f64::from(*value))
        .sum()
}

/// The weights of all levels: a pixel counts where all pixels that the filters read for it do.
fn weight_levels(weight: Option<Plane>, levels: usize) -> Vec<Option<Plane>> {
    let Some(weight) = weight else {
        return vec![None; levels + 1];
    };
    let mut raw = weight;
    let mut result = Vec::with_capacity(levels + 1);
    for level in 0..=levels {
        let wide = eroded(&raw, FILTER_RADIUS);
        result.push(Some(wide.clone()));
        if level < levels {
            let (width, height) = (raw.width().div_ceil(2), raw.height().div_ceil(2));
            let mut half = Plane::new(width, height);
            for y in 0..height {
                for x in 0..width {
                    half.row_mut(y)[x] = wide.row(2 * y)[2 * x];
                }
            }
            raw = half;
        }
    }
    result
}

/// 1 where all pixels within `radius` are 1.
fn eroded(plane: &Plane, radius: usize) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let mut across = Plane::new(width, height);
    for y in 0..height {
        let row = plane.row(y);
        for x in 0..width {
            let near = &row[x.saturating_sub(radius)..(x + radius + 1).min(width)];
            across.row_mut(y)[x] = near.iter().copied().fold(1.0, f32::min);
        }
    }
    let mut result = Plane::new(width, height);
    for y in 0..height {
        for near in y.saturating_sub(radius)..(y + radius + 1).min(height) {
            if near == y.saturating_sub(radius) {
                let row = across.row(near).to_vec();
                result.row_mut(y).copy_from_slice(&row);
            } else {
                let row = across.row(near).to_vec();
                for (to, from) in result.row_mut(y).iter_mut().zip(row) {
                    *to = to.min(from);
                }
            }
        }
    }
    result
}
