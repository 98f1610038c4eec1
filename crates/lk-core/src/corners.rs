//! Where to start points: the corners whose window fixes a displacement best.
//!
//! J. Shi and C. Tomasi, "Good features to track", CVPR 1994: the smaller eigenvalue of the structure tensor, the
//! largest of its 3 x 3 neighbourhood, best first, none closer to a better one than the least distance.

use ndarray::ArrayView2;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane};
use crate::parallel::for_each_band;
use crate::pyramid::mirror;
use crate::simd::{EIGHT, Eight, EightKernel, Kernel, Level, dispatch, dispatch_eight};

/// What counts as a corner, and how many are wanted.
///
/// ```
/// use lk_core::CornerOptions;
///
/// assert!(CornerOptions::default().max_corners(100).min_distance(10.0).validate().is_ok());
/// assert!(CornerOptions::default().quality(0.0).validate().is_err());
/// ```
#[derive(Debug, Clone)]
pub struct CornerOptions {
    pub(crate) max_corners: usize,
    quality: f32,
    pub(crate) min_distance: f32,
    block_size: usize,
    harris: Option<f32>,
    execution: Execution,
}

impl Default for CornerOptions {
    fn default() -> Self {
        Self {
            max_corners: 400,
            quality: 0.01,
            min_distance: 8.0,
            block_size: 3,
            harris: None,
            execution: Execution::default(),
        }
    }
}

impl CornerOptions {
    /// The most corners to return, the best ones; 0 means all. 400 by default.
    #[must_use]
    pub fn max_corners(mut self, corners: usize) -> Self {
        self.max_corners = corners;
        self
    }

    /// The least response of a corner, as a share of the best one's; 0.01 by default.
    #[must_use]
    pub fn quality(mut self, share: f32) -> Self {
        self.quality = share;
        self
    }

    /// The least distance between corners in pixels; 8 by default.
    #[must_use]
    pub fn min_distance(mut self, pixels: f32) -> Self {
        self.min_distance = pixels;
        self
    }

    /// Side of the window over which the structure tensor is summed; 3 by default.
    #[must_use]
    pub fn block_size(mut self, pixels: usize) -> Self {
        self.block_size = pixels;
        self
    }

    /// Harris and Stephens' response, determinant - k trace^2, with this k, in place of the smaller eigenvalue.
    #[must_use]
    pub fn harris(mut self, k: Option<f32>) -> Self {
        self.harris = k;
        self
    }

    /// Threads, instructions and cancellation.
    #[must_use]
    pub fn execution(mut self, execution: Execution) -> Self {
        self.execution = execution;
        self
    }

    /// Check every option.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] for the first one outside of what it allows.
    pub fn validate(&self) -> Result<()> {
        if !(self.quality > 0.0 && self.quality <= 1.0) {
            return Err(Error::option(
                "quality",
                self.quality,
                "more than 0, at most 1",
            ));
        }
        if !(self.min_distance >= 0.0 && self.min_distance.is_finite()) {
            return Err(Error::option(
                "min_distance",
                self.min_distance,
                "0 or more pixels",
            ));
        }
        if !(1..=MAX_BLOCK).contains(&self.block_size) {
            return Err(Error::option(
                "block_size",
                self.block_size,
                format!("1 to {MAX_BLOCK} pixels"),
            ));
        }
        if let Some(k) = self.harris
            && !k.is_finite()
        {
            return Err(Error::option("harris", k, "a finite number"));
        }
        Ok(())
    }
}

/// The largest window of the structure tensor, in pixels a side.
const MAX_BLOCK: usize = 63;

/// A corner of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Position (x, y) in pixels.
    pub position: [f32; 2],
    /// Its response, in squared grey levels per pixel: the smaller eigenvalue of the mean structure tensor, or
    /// Harris and Stephens' response.
    pub response: f32,
}

/// Memory that is kept from frame to frame.
#[derive(Debug, Default)]
pub struct CornerDetector {
    plane: Plane,
    response: Plane,
    candidates: Vec<Candidate>,
    cells: Vec<u32>,
    chained: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    response: f32,
    index: u32,
}

impl Candidate {
    /// Best first; among equals the later pixel first, as OpenCV has it.
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        other
            .response
            .total_cmp(&self.response)
            .then(other.index.cmp(&self.index))
    }
}

/// The corners of `frame`, the best first; `mask` is true where to look.
///
/// # Errors
///
/// [`Error::Shape`] if the mask does not fit; those of [`CornerOptions::validate`] and of the execution.
pub fn detect_corners<T: Pixel>(
    frame: Frame<'_, T>,
    mask: Option<ArrayView2<'_, bool>>,
    options: &CornerOptions,
) -> Result<Vec<Corner>> {
    let mut corners = Vec::new();
    CornerDetector::default().detect(frame, mask, options, &mut corners)?;
    Ok(corners)
}

impl CornerDetector {
    /// The same as [`detect_corners`]; `corners` is replaced.
    ///
    /// # Errors
    ///
    /// Those of [`detect_corners`].
    pub fn detect<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        options: &CornerOptions,
        corners: &mut Vec<Corner>,
    ) -> Result<()> {
        options.validate()?;
        let mut plane = std::mem::take(&mut self.plane);
        let copied = plane.copy_from(frame, &options.execution);
        let result = copied.and_then(|()| self.detect_in(&plane, mask, options, corners));
        self.plane = plane;
        result
    }

    /// The same on a plane, such as the finest level of a pyramid.
    ///
    /// # Errors
    ///
    /// Those of [`detect_corners`].
    pub fn detect_in(
        &mut self,
        plane: &Plane,
        mask: Option<ArrayView2<'_, bool>>,
        options: &CornerOptions,
        corners: &mut Vec<Corner>,
    ) -> Result<()> {
        options.validate()?;
        corners.clear();
        let (width, height) = (plane.width(), plane.height());
        if let Some(mask) = mask
            && mask.dim() != (height, width)
        {
            return Err(Error::shape(
                "mask",
                format!("({}, {})", mask.dim().0, mask.dim().1),
                format!("the shape of the frame, ({height}, {width})"),
            ));
        }
        if width < 3 || height < 3 {
            return Ok(());
        }
        self.respond(plane, options)?;
        let level = options.execution.simd_level();
        let best = self.best(mask, level);
        if best <= 0.0 {
            return Ok(());
        }
        self.collect(best * options.quality, mask, level);
        self.choose(options, corners);
        Ok(())
    }

    /// Fill the response of every pixel.
    fn respond(&mut self, plane: &Plane, options: &CornerOptions) -> Result<()> {
        let (width, height) = (plane.width(), plane.height());
        self.response.resize(width, height);
        // A row costs some 30 operations a pixel; this many pixels cost well above what a hand-over does.
        let min_rows = (16_384 / width).max(options.block_size);
        for_each_band(
            &options.execution,
            height,
            min_rows,
            self.response.rows_mut(),
            |rows, mut part| {
                let mut tensor = TensorRows::new(width, options);
                for (local, y) in rows.enumerate() {
                    tensor.respond(plane, y, part.row_mut(local));
                }
            },
        )
    }

    /// The largest response.
    fn best(&self, mask: Option<ArrayView2<'_, bool>>, level: Level) -> f32 {
        let mut best = f32::MIN;
        for y in 0..self.response.height() {
            let row = self.response.row(y);
            match mask {
                None => best = best.max(dispatch(level, Largest(row))),
                Some(mask) => {
                    for (value, wanted) in row.iter().zip(mask.row(y)) {
                        if *wanted {
                            best = best.max(*value);
                        }
                    }
                }
            }
        }
        best
    }

    /// Collect the local maxima from `threshold` on.
    fn collect(&mut self, threshold: f32, mask: Option<ArrayView2<'_, bool>>, level: Level) {
        let (width, height) = (self.response.width(), self.response.height());
        self.candidates.clear();
        for y in 1..height - 1 {
            let rows = [y - 1, y, y + 1].map(|row| self.response.row(row));
            dispatch_eight(
                level,
                Maxima {
                    rows,
                    threshold,
                    first: (y * width) as u32,
                    mask: mask.map(|mask| (mask, y)),
                    found: &mut self.candidates,
                },
            );
        }
    }

    /// Choose the best candidates that keep their distance.
    fn choose(&mut self, options: &CornerOptions, corners: &mut Vec<Corner>) {
        let (width, height) = (self.response.width(), self.response.height());
        let wanted = if options.max_corners == 0 {
            usize::MAX
        } else {
            options.max_corners
        };
        let cell = options.min_distance.round().max(1.0) as usize;
        let (columns, rows) = (width.div_ceil(cell), height.div_ceil(cell));
        let apart = options.min_distance >= 1.0;
        const NONE: u32 = u32::MAX;
        if apart {
            self.cells.clear();
            self.cells.resize(columns * rows, NONE);
            self.chained.clear();
        }
        let limit = options.min_distance * options.min_distance;
        let mut sorted = 0;
        for at in 0..self.candidates.len() {
            if corners.len() >= wanted {
                break;
            }
            if at == sorted {
                sorted = sort_some(&mut self.candidates, at, wanted.min(1 << 20));
            }
            let candidate = self.candidates[at];
            let (x, y) = (
                candidate.index as usize % width,
                candidate.index as usize / width,
            );
            let position = [x as f32, y as f32];
            if apart {
                let (column, row) = (x / cell, y / cell);
                let mut free = true;
                'search: for near_row in row.saturating_sub(1)..(row + 2).min(rows) {
                    for near in column.saturating_sub(1)..(column + 2).min(columns) {
                        let mut link = self.cells[near_row * columns + near];
                        while link != NONE {
                            let other = corners[link as usize].position;
                            let (dx, dy) = (other[0] - position[0], other[1] - position[1]);
                            if dx * dx + dy * dy < limit {
                                free = false;
                                break 'search;
                            }
                            link = self.chained[link as usize];
                        }
                    }
                }
                if !free {
                    continue;
                }
                let head = &mut self.cells[row * columns + column];
                self.chained.push(*head);
                *head = corners.len() as u32;
            }
            corners.push(Corner {
                position,
                response: candidate.response,
            });
        }
    }
}

/// Put the best of the candidates from `from` on into order, about as many as are likely needed, and say up to where.
fn sort_some(candidates: &mut [Candidate], from: usize, wanted: usize) -> usize {
    let rest = &mut candidates[from..];
    let count = wanted.saturating_mul(4).max(64);
    if count < rest.len() {
        rest.select_nth_unstable_by(count, Candidate::order);
        rest[..count].sort_unstable_by(Candidate::order);
        from + count
    } else {
        rest.sort_unstable_by(Candidate::order);
        candidates.len()
    }
}

/// The rows of one band: products of gradients of the last few rows, and their sums.
struct TensorRows {
    level: Level,
    block: usize,
    harris: Option<f32>,
    width: usize,
    /// Rows of xx, xy, yy, mirrored beyond both ends, in the slot of their index modulo the block.
    products: Vec<f32>,
    /// The next row of products to compute, counted from `-block / 2`.
    next: isize,
    smooth: Vec<f32>,
    slope: Vec<f32>,
    sums: Vec<f32>,
}

impl TensorRows {
    fn new(width: usize, options: &CornerOptions) -> Self {
        let padded = Self::padded(width, options.block_size);
        Self {
            level: options.execution.simd_level(),
            block: options.block_size,
            harris: options.harris,
            width,
            products: vec![0.0; 3 * padded * options.block_size],
            next: isize::MIN,
            smooth: vec![0.0; width.next_multiple_of(EIGHT) + EIGHT],
            slope: vec![0.0; width.next_multiple_of(EIGHT) + EIGHT],
            sums: vec![0.0; 3 * padded],
        }
    }

    /// Columns of a row of products, with what is mirrored on both sides and whole lanes after the end.
    fn padded(width: usize, block: usize) -> usize {
        width.next_multiple_of(EIGHT) + block + EIGHT
    }

    /// Write the response of row `y`; rows come in order.
    fn respond(&mut self, plane: &Plane, y: usize, row: &mut [f32]) {
        let block = self.block as isize;
        let first = y as isize - block / 2;
        if self.next < first {
            self.next = first;
        }
        while self.next < first + block {
            self.add_row(plane, self.next);
            self.next += 1;
        }
        dispatch(
            self.level,
            SumDown {
                rows: &self.products,
                count: self.block,
                sums: &mut self.sums,
            },
        );
        // Sobel's filters weigh 8 pixels a side; the mean over the block, per pixel squared.
        let scale = 1.0 / (8.0 * 8.0 * (self.block * self.block) as f32);
        dispatch_eight(
            self.level,
            Respond {
                sums: &self.sums,
                block: self.block,
                harris: self.harris,
                scale,
                row,
            },
        );
    }

    fn add_row(&mut self, plane: &Plane, y: isize) {
        let (width, height) = (self.width, plane.height());
        let padded = Self::padded(width, self.block);
        let slot = y.rem_euclid(self.block as isize) as usize;
        let y = mirror(y, height) as isize;
        let rows = [y - 1, y, y + 1].map(|row| plane.row(mirror(row, height)));
        dispatch(
            self.level,
            FilterDown {
                rows,
                smooth: &mut self.smooth[1..=width],
                slope: &mut self.slope[1..=width],
            },
        );
        for line in [&mut self.smooth, &mut self.slope] {
            line[0] = line[1 + mirror(-1, width)];
            line[width + 1] = line[1 + mirror(width as isize, width)];
        }
        let left = self.block / 2;
        let target = &mut self.products[3 * padded * slot..3 * padded * (slot + 1)];
        dispatch(
            self.level,
            Products {
                smooth: &self.smooth[..width + 2],
                slope: &self.slope[..width + 2],
                left,
                padded,
                target,
            },
        );
        for line in target.chunks_exact_mut(padded) {
            for beyond in 0..left {
                line[beyond] = line[left + mirror(beyond as isize - left as isize, width)];
            }
            for beyond in 0..self.block - left {
                line[left + width + beyond] = line[left + mirror((width + beyond) as isize, width)];
            }
        }
    }
}

/// Sobel's filters down the columns: smoothing and slope.
struct FilterDown<'a> {
    rows: [&'a [f32]; 3],
    smooth: &'a mut [f32],
    slope: &'a mut [f32],
}

impl Kernel for FilterDown<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.smooth.len();
        let [a, b, c] = self.rows.map(|row| &row[..width]);
        let slope = &mut self.slope[..width];
        for x in 0..width {
            self.smooth[x] = (a[x] + c[x]) + 2.0 * b[x];
            slope[x] = c[x] - a[x];
        }
    }
}

/// Sobel's filters along the row, and the products of both gradients.
struct Products<'a> {
    smooth: &'a [f32],
    slope: &'a [f32],
    left: usize,
    padded: usize,
    target: &'a mut [f32],
}

impl Kernel for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.smooth.len() - 2;
        let (xx, rest) = self.target.split_at_mut(self.padded);
        let (xy, yy) = rest.split_at_mut(self.padded);
        let (xx, xy, yy) = (
            &mut xx[self.left..self.left + width],
            &mut xy[self.left..self.left + width],
            &mut yy[self.left..self.left + width],
        );
        let (s0, s2) = (&self.smooth[..width], &self.smooth[2..width + 2]);
        let (t0, t1, t2) = (
            &self.slope[..width],
            &self.slope[1..width + 1],
            &self.slope[2..width + 2],
        );
        for x in 0..width {
            let gx = s2[x] - s0[x];
            let gy = (t0[x] + t2[x]) + 2.0 * t1[x];
            xx[x] = gx * gx;
            xy[x] = gx * gy;
            yy[x] = gy * gy;
        }
    }
}

/// Sums of the rows of products.
struct SumDown<'a> {
    rows: &'a [f32],
    count: usize,
    sums: &'a mut [f32],
}

impl Kernel for SumDown<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let length = self.sums.len();
        if self.count == 3 {
            let (a, rest) = self.rows.split_at(length);
            let (b, c) = rest.split_at(length);
            let c = &c[..length];
            for x in 0..length {
                self.sums[x] = a[x] + b[x] + c[x];
            }
            return;
        }
        self.sums.copy_from_slice(&self.rows[..length]);
        for row in self.rows.chunks_exact(length).skip(1) {
            for (sum, value) in self.sums.iter_mut().zip(row) {
                *sum += value;
            }
        }
    }
}

/// Sums along the row, and the response.
struct Respond<'a> {
    sums: &'a [f32],
    block: usize,
    harris: Option<f32>,
    scale: f32,
    row: &'a mut [f32],
}

impl EightKernel for Respond<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Eight>(self) {
        let padded = self.sums.len() / 3;
        let (xx, rest) = self.sums.split_at(padded);
        let (xy, yy) = rest.split_at(padded);
        let width = self.row.len();
        let mut x = 0;
        while x < width {
            let mut tensor = [L::zero(); 3];
            for step in 0..self.block {
                tensor[0] += L::load(xx, x + step);
                tensor[1] += L::load(xy, x + step);
                tensor[2] += L::load(yy, x + step);
            }
            let scale = L::splat(self.scale);
            let [xx, xy, yy] = tensor;
            let (xx, xy, yy) = (xx * scale, xy * scale, yy * scale);
            let response = if let Some(k) = self.harris {
                let trace = xx + yy;
                xx * yy - xy * xy - L::splat(k) * trace * trace
            } else {
                let half = L::splat(0.5);
                let difference = (xx - yy) * half;
                (xx + yy) * half - (difference * difference + xy * xy).sqrt()
            };
            if x + EIGHT <= width {
                response.store(self.row, x);
            } else {
                let mut last = [0.0; EIGHT];
                response.store(&mut last, 0);
                let count = width - x;
                self.row[x..].copy_from_slice(&last[..count]);
            }
            x += EIGHT;
        }
    }
}

/// The largest value of a row that is not NaN.
struct Largest<'a>(&'a [f32]);

impl Kernel for Largest<'_> {
    type Output = f32;

    #[inline(always)]
    fn run(self) -> f32 {
        let mut lanes = [f32::MIN; 4 * EIGHT];
        let chunks = self.0.chunks_exact(4 * EIGHT);
        let rest = chunks.remainder().iter().copied().fold(f32::MIN, f32::max);
        for chunk in chunks {
            for (lane, value) in lanes.iter_mut().zip(chunk) {
                *lane = if *value > *lane { *value } else { *lane };
            }
        }
        lanes.into_iter().fold(rest, f32::max)
    }
}

/// The pixels of the middle row, but for its ends, that no neighbour exceeds.
struct Maxima<'a> {
    rows: [&'a [f32]; 3],
    threshold: f32,
    /// Index of the row's first pixel in the frame.
    first: u32,
    mask: Option<(ArrayView2<'a, bool>, usize)>,
    found: &'a mut Vec<Candidate>,
}

impl EightKernel for Maxima<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Eight>(mut self) {
        let [above, here, below] = self.rows;
        let width = here.len();
        let (above, below) = (&above[..width], &below[..width]);
        let threshold = L::splat(self.threshold);
        let mut x = 1;
        while x < width - 1 {
            // Most blocks hold no maximum, and whole lanes tell so at once.
            let whole = x + EIGHT < width;
            let count = if whole { EIGHT } else { width - 1 - x };
            let mut bits = u8::MAX >> (EIGHT - count);
            if whole {
                let value = L::load(here, x);
                bits = value.at_least(threshold)
                    & value.at_least(L::load(above, x))
                    & value.at_least(L::load(below, x))
                    & value.at_least(L::load(here, x - 1))
                    & value.at_least(L::load(here, x + 1));
            }
            while bits != 0 {
                self.look(above, here, below, x + bits.trailing_zeros() as usize);
                bits &= bits - 1;
            }
            x += count;
        }
    }
}

impl Maxima<'_> {
    /// Take pixel `x` if it is a maximum.
    fn look(&mut self, above: &[f32], here: &[f32], below: &[f32], x: usize) {
        let value = here[x];
        let near = x - 1..x + 2;
        let is_maximum = value > self.threshold
            && value >= here[x - 1]
            && value >= here[x + 1]
            && above[near.clone()].iter().all(|other| value >= *other)
            && below[near].iter().all(|other| value >= *other);
        if is_maximum && self.mask.is_none_or(|(mask, y)| mask[(y, x)]) {
            self.found.push(Candidate {
                response: value,
                index: self.first + x as u32,
            });
        }
    }
}
