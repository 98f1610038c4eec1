//! The displacement of one window, with its covariance, in changing light.
//!
//! Both frames are sampled half a displacement towards each other, so that swapping them negates the result. Light may
//! change by a gain and an offset that follow the place; they are unknowns of the same least squares. The gradients
//! that weight the differences are smoothed, the differences are not, so that noise does not bias the result.

mod refine;
mod solve;
mod start;
mod sums;

use ndarray::ArrayView2;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane, read_row};
use crate::illumination::Illumination;
use crate::pyramid::Pyramid;
use refine::{GainField, Look, Pair, REACH, Workspace, look};
use solve::{Solution, eigenvalues};
use start::{Start, best_start};

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Roi {
    /// The first column.
    pub x: usize,
    /// The first row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Whether a displacement could be measured, and if not, why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum ShiftStatus {
    /// Measured.
    Valid = 0,
    /// The window, or what a mask or NaN leave of it, has too few pixels.
    TooSmall = 1,
    /// At the displacement found, the frames share too little of the window.
    TooLittleOverlap = 2,
    /// The window shows no structure that stands out of the noise.
    NoTexture = 3,
    /// The window shows structure in one direction only: motion along it cannot be seen.
    Aperture = 4,
    /// Nothing in the other frame looks like the window: a scene cut, or motion beyond `max_displacement`.
    NoMatch = 5,
    /// The iteration did not settle.
    NotConverged = 6,
}

/// The displacement of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shift {
    /// Displacement to the right, in pixels; NaN where not valid.
    pub dx: f64,
    /// Displacement down, in pixels; NaN where not valid.
    pub dy: f64,
    /// Covariance of (dx, dy), in square pixels; infinite where not valid.
    pub covariance: [[f64; 2]; 2],
    /// `next = gain * prev + offset`, on average over the window; 1 if the model has no gain.
    pub gain: f64,
    /// See `gain`; in grey levels, 0 if the model has no offset.
    pub offset: f64,
    /// Root mean square of `next - prev` after motion and light, in grey levels.
    pub residual: f64,
    /// Whether the displacement could be measured, and if not, why.
    pub status: ShiftStatus,
}

impl Shift {
    /// A displacement that could not be measured.
    fn invalid(status: ShiftStatus) -> Self {
        Self {
            dx: f64::NAN,
            dy: f64::NAN,
            covariance: [[f64::INFINITY, 0.0], [0.0, f64::INFINITY]],
            gain: f64::NAN,
            offset: f64::NAN,
            residual: f64::NAN,
            status,
        }
    }

    /// Whether the displacement was measured.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.status == ShiftStatus::Valid
    }
}

/// How [`estimate_shift`] works.
#[derive(Debug, Clone, Default)]
pub struct ShiftOptions {
    roi: Option<Roi>,
    illumination: Illumination,
    max_displacement: Option<f64>,
    execution: Execution,
}

impl ShiftOptions {
    /// The window in `prev`; the whole frame if not set. `next` is read outside of it as far as the motion goes.
    #[must_use]
    pub fn roi(mut self, roi: Roi) -> Self {
        self.roi = Some(roi);
        self
    }

    /// How light may change.
    #[must_use]
    pub fn illumination(mut self, illumination: Illumination) -> Self {
        self.illumination = illumination;
        self
    }

    /// The largest displacement along each axis, in pixels; half the window if not set.
    #[must_use]
    pub fn max_displacement(mut self, pixels: f64) -> Self {
        self.max_displacement = Some(pixels);
        self
    }

    /// On how many threads, with which instructions, until when.
    #[must_use]
    pub fn execution(mut self, execution: Execution) -> Self {
        self.execution = execution;
        self
    }

    /// Check the options against each other and against the frames' size.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] if `max_displacement` is negative or not finite, or the window is not inside of the frame.
    pub fn validate(&self, height: usize, width: usize) -> Result<()> {
        if let Some(limit) = self.max_displacement
            && !(limit.is_finite() && limit >= 0.0)
        {
            return Err(Error::option(
                "max_displacement",
                limit,
                "0 or more pixels, finite",
            ));
        }
        if let Some(roi) = self.roi {
            let inside = roi.x.checked_add(roi.width).is_some_and(|end| end <= width)
                && roi
                    .y
                    .checked_add(roi.height)
                    .is_some_and(|end| end <= height);
            if !inside {
                return Err(Error::option(
                    "roi",
                    format!(
                        "(x={}, y={}, width={}, height={})",
                        roi.x, roi.y, roi.width, roi.height
                    ),
                    format!("a window inside of the frame, {width} wide and {height} high"),
                ));
            }
        }
        Ok(())
    }
}

/// Fewer usable pixels along a side cannot hold the filters.
const MIN_SIDE: usize = 8;
/// Pixels around the window that the filters read.
const MARGIN: usize = 4;
/// A standard deviation above this is no measurement, in pixels.
const MAX_SIGMA: f64 = 0.2;
/// Light may vary from tile to tile: small enough for the border of a shadow to spoil few.
const MAX_TILE: usize = 20;
const COARSE_TILE: usize = 8;
/// The iteration has settled once a step is below this, in pixels.
const SETTLED: f64 = 1e-4;
/// The same at a coarse level, in its pixels.
const COARSE_SETTLED: f64 = 0.05;

/// A step, made longer or shorter by what the one before it left: the gradients are not exact, but their error is the
/// same in each step.
fn extrapolated(step: [f64; 2], before: Option<[f64; 2]>) -> [f64; 2] {
    let Some(before) = before else { return step };
    let square = before[0] * before[0] + before[1] * before[1];
    if square <= 0.0 {
        return step;
    }
    let left = ((step[0] * before[0] + step[1] * before[1]) / square).clamp(-0.3, 0.3);
    step.map(|value| value / (1.0 - left))
}

/// The displacement of the window from `prev` to `next`.
///
/// Pixels that are NaN, and those of `prev` where `mask` is false, are left out.
///
/// # Errors
///
/// [`Error::Shape`] if the frames or the mask differ in size, [`Error::Option`] if the options do not fit, and those of
/// the execution.
///
/// ```
/// use lk_core::{ShiftOptions, estimate_shift};
/// use ndarray::Array2;
///
/// let scene = |x: f32, y: f32| 100.0 + 40.0 * (0.4 * x).sin() * (0.3 * y + 0.1 * x).cos();
/// let prev = Array2::from_shape_fn((60, 60), |(y, x)| scene(x as f32, y as f32));
/// // What was at (x, y) is now at (x + 2.25, y - 1.5), in brighter light.
/// let next = Array2::from_shape_fn((60, 60), |(y, x)| 1.2 * scene(x as f32 - 2.25, y as f32 + 1.5));
///
/// let shift = estimate_shift(prev.view(), next.view(), None, &ShiftOptions::default())?;
/// assert!(shift.is_valid());
/// assert!((shift.dx - 2.25).abs() < 0.01 && (shift.dy + 1.5).abs() < 0.01);
/// assert!((shift.gain - 1.2).abs() < 0.01);
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn estimate_shift<T: Pixel>(
    prev: Frame<'_, T>,
    next: Frame<'_, T>,
    mask: Option<ArrayView2<'_, bool>>,
    options: &ShiftOptions,
) -> Result<Shift> {
    let (height, width) = prev.dim();
    if next.dim() != (height, width) {
        return Err(Error::shape(
            "next",
            format!("({}, {})", next.dim().0, next.dim().1),
            format!("the shape of prev, ({height}, {width})"),
        ));
    }
    if let Some(mask) = mask
        && mask.dim() != (height, width)
    {
        return Err(Error::shape(
            "mask",
            format!("({}, {})", mask.dim().0, mask.dim().1),
            format!("the shape of the frames, ({height}, {width})"),
        ));
    }
    options.validate(height, width)?;
    let roi = options.roi.unwrap_or(Roi {
        x: 0,
        y: 0,
        width,
        height,
    });
    if roi.width < MIN_SIDE || roi.height < MIN_SIDE {
        return Ok(Shift::invalid(ShiftStatus::TooSmall));
    }
    let limit = match options.max_displacement {
        Some(limit) => [limit, limit],
        None => [roi.width as f64 / 2.0, roi.height as f64 / 2.0],
    };
    let levels = coarse_levels(roi, limit, [width, height]);
    let inputs = Inputs::new(prev, next, mask, roi, limit, levels);
    if inputs.usable < (MIN_SIDE * MIN_SIDE) as f64 {
        return Ok(Shift::invalid(ShiftStatus::TooSmall));
    }
    inputs.estimate(limit, options)
}

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

/// The frames' parts that matter, as planes, at all levels.
struct Inputs {
    prev: Pyramid,
    next: Pyramid,
    prev_weights: Vec<Option<Plane>>,
    next_weights: Vec<Option<Plane>>,
    origin: [isize; 2],
    window: [(usize, usize); 2],
    /// Taken from both frames, so that sums of squares do not lose digits.
    mean: f64,
    usable: f64,
    levels: usize,
    /// Pixels along a side of a tile at the finest level.
    tile: usize,
}

impl Inputs {
    fn new<T: Pixel>(
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
            tile: (length[0].min(length[1]) / 4).clamp(8, MAX_TILE),
        }
    }

    fn pair(&self, level: usize) -> Pair<'_> {
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

    fn estimate(&self, limit: [f64; 2], options: &ShiftOptions) -> Result<Shift> {
        let mut start: Option<Start> = None;
        let mut from = self.levels;
        for level in (0..=self.levels).rev() {
            // The finer levels are for texture that the coarse ones do not show.
            let scale = f64::from(1u32 << level);
            let limit = limit.map(|value| (value / scale).ceil());
            if let Some(found) = best_start(self.pair(level), limit, &options.execution)? {
                if start.is_none_or(|best| found.better_than(&best)) {
                    start = Some(found);
                    from = level;
                }
                if found.convinces() {
                    break;
                }
            }
        }
        let Some(start) = start else {
            return Ok(Shift::invalid(ShiftStatus::TooLittleOverlap));
        };
        let mut displacement = start.displacement.map(|value| value as f64);
        let mut match_found = false;
        let mut gain = GainField::default();
        let mut workspace = Workspace::default();
        for level in (0..=from).rev() {
            if level != from && level != 0 {
                displacement = displacement.map(|value| 2.0 * value);
                continue;
            }
            let finest = level == 0;
            let mut whole = displacement.map(f64::round);
            let mut before: Option<[f64; 2]> = None;
            let mut steady = false;
            let mut last = None;
            for _ in 0..if finest { 20 } else { 6 } {
                for (whole, exact) in whole.iter_mut().zip(displacement) {
                    if (exact - *whole).abs() > REACH {
                        *whole = exact.round();
                        before = None;
                    }
                }
                let how = Look {
                    displacement,
                    whole,
                    illumination: options.illumination,
                    gain,
                    tile: if finest { self.tile } else { COARSE_TILE },
                };
                let Some(solution) =
                    look(self.pair(level), how, &mut workspace, &options.execution)?
                else {
                    return Ok(Shift::invalid(ShiftStatus::TooLittleOverlap));
                };
                let step = extrapolated(solution.step, before);
                let length = step[0].hypot(step[1]);
                let damp = if length > 1.0 { 1.0 / length } else { 1.0 };
                for (value, step) in displacement.iter_mut().zip(step) {
                    *value += damp * step;
                }
                steady = length < if finest { SETTLED } else { COARSE_SETTLED };
                last = Some((solution, gain));
                if length < 0.2 && before.is_none() {
                    for (to, more) in gain.0.iter_mut().zip(solution.gain) {
                        *to += more;
                    }
                }
                before = (length < 0.2).then_some(solution.step);
                if steady {
                    break;
                }
            }
            let Some((solution, gain)) = last else {
                return Ok(Shift::invalid(ShiftStatus::NotConverged));
            };
            if level == from {
                match_found = solution.matches();
            }
            if finest {
                return Ok(self.judge(displacement, limit, match_found, steady, &solution, gain));
            }
            displacement = displacement.map(|value| 2.0 * value);
        }
        Ok(Shift::invalid(ShiftStatus::NotConverged))
    }

    fn judge(
        &self,
        displacement: [f64; 2],
        limit: [f64; 2],
        match_found: bool,
        steady: bool,
        solution: &Solution,
        field: GainField,
    ) -> Shift {
        let variance = eigenvalues(solution.covariance);
        let [low, high] = solution.information;
        let limit_sigma = MAX_SIGMA * MAX_SIGMA;
        let status = if high <= 0.05 {
            ShiftStatus::NoTexture
        } else if low <= 0.05 || low <= 1e-4 * high {
            ShiftStatus::Aperture
        } else if !match_found {
            ShiftStatus::NoMatch
        } else if variance[1].is_nan() || variance[1] > limit_sigma {
            if variance[0] < 0.04 * variance[1] {
                ShiftStatus::Aperture
            } else {
                ShiftStatus::NoTexture
            }
        } else if (0..2).any(|axis| displacement[axis].abs() > limit[axis] + 1.0) {
            ShiftStatus::NoMatch
        } else if !steady {
            ShiftStatus::NotConverged
        } else {
            ShiftStatus::Valid
        };
        if status != ShiftStatus::Valid {
            return Shift::invalid(status);
        }
        let alpha = solution.alpha + field.0[0];
        let gain = (1.0 + alpha / 2.0) / (1.0 - alpha / 2.0);
        let offset = solution.beta / (1.0 - alpha / 2.0);
        Shift {
            dx: displacement[0],
            dy: displacement[1],
            covariance: solution.covariance,
            gain,
            offset: offset + self.mean * (1.0 - gain),
            residual: solution.residual,
            status,
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
    let (mut sum, mut count) = (0.0f64, 0.0f64);
    for y in 0..plane.height() {
        for (x, value) in plane.row(y).iter().enumerate() {
            let w = weight.map_or(1.0, |weight| weight.row(y)[x]);
            if w > 0.0 {
                sum += f64::from(*value);
                count += 1.0;
            }
        }
    }
    sum / f64::max(count, 1.0)
}

/// The weights of all levels: a pixel counts where all pixels that the filters read for it do.
fn weight_levels(weight: Option<Plane>, levels: usize) -> Vec<Option<Plane>> {
    let Some(weight) = weight else {
        return vec![None; levels + 1];
    };
    let mut raw = weight;
    let mut result = Vec::with_capacity(levels + 1);
    for level in 0..=levels {
        result.push(Some(eroded(&raw, 1)));
        if level < levels {
            let wide = eroded(&raw, 1);
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
