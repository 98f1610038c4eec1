//! The response of every pixel: gradients, the structure tensor over a block, and its smaller eigenvalue.

use super::options::CornerOptions;
use crate::frame::Plane;
use crate::pyramid::mirror;
use crate::simd::{EIGHT, Eight, Kernel, Simd, SimdLevel, dispatch};
use crate::support::{ABSENT, Support};

/// The rows of one band: products of gradients of the last few rows, and their sums.
pub(super) struct TensorRows<'a> {
    level: SimdLevel,
    block: usize,
    harris: Option<f32>,
    width: usize,
    /// Rows of xx, xy, yy, mirrored beyond both ends, in the slot of their index modulo the block.
    products: &'a mut [f32],
    /// The next row of products to compute, counted from `-block / 2`.
    next: isize,
    smooth: &'a mut [f32],
    slope: &'a mut [f32],
    sums: &'a mut [f32],
    /// Which pixels count; `None` for all.
    support: Option<&'a Support>,
}

impl<'a> TensorRows<'a> {
    /// The size of the memory that rows of `width` pixels take.
    pub(super) fn room(width: usize, options: &CornerOptions) -> usize {
        3 * Self::padded(width, options.block_size) * (options.block_size + 1)
            + 2 * Self::line(width)
    }

    /// Rows in `memory` of that size.
    pub(super) fn new(
        width: usize,
        options: &CornerOptions,
        support: Option<&'a Support>,
        memory: &'a mut [f32],
    ) -> Self {
        let padded = Self::padded(width, options.block_size);
        let (products, rest) = memory.split_at_mut(3 * padded * options.block_size);
        let (smooth, rest) = rest.split_at_mut(Self::line(width));
        let (slope, sums) = rest.split_at_mut(Self::line(width));
        Self {
            level: options.execution.simd_level(),
            block: options.block_size,
            harris: options.harris,
            width,
            products,
            next: isize::MIN,
            smooth,
            slope,
            sums,
            support: support.filter(|support| support.has_absent()),
        }
    }

    /// A row of gradients along one axis, with what is mirrored on both sides and whole lanes after the end.
    fn line(width: usize) -> usize {
        width.next_multiple_of(EIGHT) + EIGHT
    }

    /// Columns of a row of products, with what is mirrored on both sides and whole lanes after the end.
    fn padded(width: usize, block: usize) -> usize {
        width.next_multiple_of(EIGHT) + block + EIGHT
    }

    /// Write the response of row `y`; rows come in order.
    pub(super) fn respond(&mut self, plane: &Plane, y: usize, row: &mut [f32]) {
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
                rows: self.products,
                count: self.block,
                sums: self.sums,
            },
        );
        // Sobel's filters weigh 8 pixels a side; the mean over the block, per pixel squared.
        let scale = 1.0 / (8.0 * 8.0 * (self.block * self.block) as f32);
        dispatch(
            self.level,
            Respond {
                sums: self.sums,
                block: self.block,
                harris: self.harris,
                scale,
                row,
            },
        );
        if let Some(support) = self.support {
            for (value, byte) in row.iter_mut().zip(support.row(y)) {
                if *byte == ABSENT {
                    *value = 0.0;
                }
            }
        }
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
        for line in [&mut *self.smooth, &mut *self.slope] {
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
        if let Some(support) = self.support {
            // A gradient counts where all pixels do that it is made of.
            let rows = [y - 1, y, y + 1].map(|row| support.row(mirror(row, height)));
            for x in 0..width {
                let near = x.saturating_sub(1)..(x + 2).min(width);
                if rows.iter().any(|row| row[near.clone()].contains(&ABSENT)) {
                    for line in target.chunks_exact_mut(padded) {
                        line[left + x] = 0.0;
                    }
                }
            }
        }
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
    fn run<S: Simd>(self, _: S) {
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
    fn run<S: Simd>(self, _: S) {
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
    fn run<S: Simd>(self, _: S) {
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

impl Kernel for Respond<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let padded = self.sums.len() / 3;
        let (xx, rest) = self.sums.split_at(padded);
        let (xy, yy) = rest.split_at(padded);
        let width = self.row.len();
        let mut x = 0;
        while x < width {
            let mut tensor = [S::Eight::zero(); 3];
            for step in 0..self.block {
                tensor[0] += S::Eight::load(xx, x + step);
                tensor[1] += S::Eight::load(xy, x + step);
                tensor[2] += S::Eight::load(yy, x + step);
            }
            let scale = S::Eight::splat(self.scale);
            let [xx, xy, yy] = tensor;
            let (xx, xy, yy) = (xx * scale, xy * scale, yy * scale);
            let response = if let Some(k) = self.harris {
                let trace = xx + yy;
                xx * yy - xy * xy - S::Eight::splat(k) * trace * trace
            } else {
                let half = S::Eight::splat(0.5);
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
