//! One row of clusters: both frames are sampled half the motion towards each other, and the products of the features of
//! each pixel are summed, eight pixels at a time.
//!
//! What is sampled depends on the whole pixels between a pixel and its counterpart, which change over the window: a part
//! of it in which there are several is gone over once for each, and those pixels count that have it.
#![allow(clippy::needless_range_loop, reason = "rows and features by index")]

use super::sums::{CLUSTER, Sums};
use super::view::{FEATURES, View};
use crate::frame::Plane;
use crate::shift::filters::{DERIVATIVE, RADIUS, lane_taps};
use crate::simd::{EIGHT, Eight, Kernel, Packed, Simd};

/// Clusters that are sampled at once, and how many where the whole pixels change often.
const TOGETHER: usize = 4;
/// Of the whole pixels, so many that the parts are made smaller.
const MANY: isize = 2;
/// Rows that are sampled, and read, for one of clusters.
const SAMPLED: usize = CLUSTER + 2 * RADIUS;
const READ: usize = SAMPLED + 2 * RADIUS;
/// Columns of the buffers.
const COLUMNS: usize = (TOGETHER + 2) * EIGHT;

/// The sums over a row of clusters.
pub(super) struct SumStripe<'a> {
    pub(super) view: &'a View<'a>,
    /// Its first pixel and its rows.
    pub(super) y: isize,
    pub(super) rows: usize,
    pub(super) clusters: &'a mut [Sums],
}

impl Kernel for SumStripe<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let (left, right) = self.view.pair.window[0];
        let mut done = 0;
        while done < self.clusters.len() {
            let x = left + done * CLUSTER;
            let count = TOGETHER.min(self.clusters.len() - done);
            let part = Part {
                view: self.view,
                start: [x as isize, self.y],
                size: [(right - x).min(count * CLUSTER), self.rows],
            };
            if part.wholes() <= MANY {
                part.sum::<S::Eight>(&mut self.clusters[done..done + count]);
            } else {
                for one in 0..count {
                    let x = x + one * CLUSTER;
                    let part = Part {
                        start: [x as isize, self.y],
                        size: [(right - x).min(CLUSTER), self.rows],
                        ..part
                    };
                    part.sum::<S::Eight>(&mut self.clusters[done + one..done + one + 1]);
                }
            }
            done += count;
        }
    }
}

/// Clusters side by side.
#[derive(Clone, Copy)]
struct Part<'a> {
    view: &'a View<'a>,
    /// The first pixel.
    start: [isize; 2],
    /// Columns and rows.
    size: [usize; 2],
}

impl Part<'_> {
    /// The least and the largest whole pixels to a counterpart along each axis: the motion is linear.
    #[inline(always)]
    fn range(&self) -> [[isize; 2]; 2] {
        let mut range = [[isize::MAX, isize::MIN]; 2];
        for corner in 0..4 {
            let mut pixel = self.start;
            for axis in 0..2 {
                if corner & (axis + 1) != 0 {
                    pixel[axis] += self.size[axis] as isize - 1;
                }
            }
            let whole = self.view.whole(pixel);
            for axis in 0..2 {
                range[axis][0] = range[axis][0].min(whole[axis]);
                range[axis][1] = range[axis][1].max(whole[axis]);
            }
        }
        range
    }

    /// How many whole pixels there may be.
    #[inline(always)]
    fn wholes(&self) -> isize {
        let [x, y] = self.range();
        (x[1] - x[0] + 1) * (y[1] - y[0] + 1)
    }

    #[inline(always)]
    fn sum<L: Eight>(&self, clusters: &mut [Sums]) {
        let [across, down] = self.range();
        let several = across[0] < across[1] || down[0] < down[1];
        let mut samples = Samples {
            mean: [[0.0; COLUMNS]; SAMPLED],
            difference: [[0.0; COLUMNS]; SAMPLED],
        };
        for y in down[0]..=down[1] {
            for x in across[0]..=across[1] {
                let Some(weight) = self.weight([x, y], several) else {
                    continue;
                };
                self.sample::<L>([x, y], clusters.len() + 1, &mut samples);
                for (index, sums) in clusters.iter_mut().enumerate() {
                    self.add::<L>([x, y], index, &weight, &samples, sums);
                }
            }
        }
    }

    /// The weight of each pixel that is compared over these whole pixels; `None` where there is none.
    #[inline(always)]
    fn weight(
        &self,
        whole: [isize; 2],
        several: bool,
    ) -> Option<[[f32; TOGETHER * CLUSTER]; CLUSTER]> {
        let pair = &self.view.pair;
        let mut weight = [[0.0; TOGETHER * CLUSTER]; CLUSTER];
        let margin = 2 * RADIUS as isize;
        let sizes = [
            [pair.prev.width(), pair.next.width()],
            [pair.prev.height(), pair.next.height()],
        ];
        let offset: [isize; 2] = [whole[0] - pair.origin[0], whole[1] - pair.origin[1]];
        // The pixels around which both frames are shown as far as the filters reach.
        let mut inside = [[0; 2]; 2];
        for axis in 0..2 {
            let [prev, next] = sizes[axis];
            let low = margin.max(margin - offset[axis]) - self.start[axis];
            let high =
                (prev as isize).min(next as isize - offset[axis]) - margin - self.start[axis];
            let last = self.size[axis] as isize;
            inside[axis] = [low.clamp(0, last), high.clamp(0, last)];
        }
        let ([left, right], [top, bottom]) = (inside[0], inside[1]);
        if left >= right || top >= bottom {
            return None;
        }
        let mut any = false;
        for y in top as usize..bottom as usize {
            let row = &mut weight[y][left as usize..right as usize];
            row.fill(1.0);
            let at = [self.start[0] + left, self.start[1] + y as isize];
            multiply(row, pair.prev_weight, at);
            multiply(
                row,
                pair.next_weight,
                [at[0] + offset[0], at[1] + offset[1]],
            );
            if several {
                for (x, value) in row.iter_mut().enumerate() {
                    if self.view.whole([at[0] + x as isize, at[1]]) != whole {
                        *value = 0.0;
                    }
                }
            }
            for value in row {
                any |= *value != 0.0;
            }
        }
        any.then_some(weight)
    }

    /// Both frames, moved towards each other, with [`RADIUS`] more pixels on each side: `blocks` of eight columns.
    #[inline(always)]
    fn sample<L: Eight>(&self, whole: [isize; 2], blocks: usize, samples: &mut Samples) {
        let pair = &self.view.pair;
        let mut read = [[[0.0f32; COLUMNS]; READ]; 2];
        let margin = 2 * RADIUS as isize;
        let first = [self.start[0] - margin, self.start[1] - margin];
        let offset = [whole[0] - pair.origin[0], whole[1] - pair.origin[1]];
        let (rows, columns) = (self.size[1] + 4 * RADIUS, (blocks + 1) * EIGHT);
        copy(&mut read[0], pair.prev, first, [columns, rows]);
        copy(
            &mut read[1],
            pair.next,
            [first[0] + offset[0], first[1] + offset[1]],
            [columns, rows],
        );
        let [prev, next] = &read;
        let steps = L::unpack(&Packed::STEPS);
        let by = [self.view.motion[2], self.view.motion[4]].map(|value| (value / 2.0) as f32);
        let (half, low) = (L::splat(0.5), L::splat(-0.5));
        for y in 0..self.size[1] + 2 * RADIUS {
            for block in 0..blocks {
                let x = block * EIGHT;
                let radius = RADIUS as isize;
                let pixel = [
                    self.start[0] + x as isize - radius,
                    self.start[1] + y as isize - radius,
                ];
                let (at, _) = self.view.half(pixel, whole);
                let mut places = [L::zero(); 2];
                for axis in 0..2 {
                    let place = L::splat(at[axis] as f32) + L::splat(by[axis]) * steps;
                    let place = place.larger(low);
                    places[axis] = half.mask_from(place).choose(place, half);
                }
                let across = lane_taps(places[0]);
                let down = lane_taps(places[1]);
                let (mut p, mut n) = (L::zero(), L::zero());
                for k in 0..2 * RADIUS + 1 {
                    let row = &prev[y + k];
                    let outer = across[4] * L::load(row, x) + across[0] * L::load(row, x + 4);
                    let inner = across[3] * L::load(row, x + 1) + across[1] * L::load(row, x + 3);
                    p += down[2 * RADIUS - k] * (outer + inner + across[2] * L::load(row, x + 2));
                    let row = &next[y + k];
                    let outer = across[0] * L::load(row, x) + across[4] * L::load(row, x + 4);
                    let inner = across[1] * L::load(row, x + 1) + across[3] * L::load(row, x + 3);
                    n += down[k] * (outer + inner + across[2] * L::load(row, x + 2));
                }
                (half * (p + n)).store(&mut samples.mean[y], x);
                (n - p).store(&mut samples.difference[y], x);
            }
        }
    }

    /// Add the products of the features of the pixels of a cluster.
    #[inline(always)]
    fn add<L: Eight>(
        &self,
        whole: [isize; 2],
        index: usize,
        weight: &[[f32; TOGETHER * CLUSTER]; CLUSTER],
        samples: &Samples,
        sums: &mut Sums,
    ) {
        let x = index * CLUSTER;
        let mut features = [[Packed::ZERO; CLUSTER]; FEATURES];
        let mut weighted = [[Packed::ZERO; CLUSTER]; FEATURES];
        let (near, far) = (L::splat(DERIVATIVE[3]), L::splat(DERIVATIVE[4]));
        let least = L::splat(f32::MIN_POSITIVE);
        let across = L::splat((1.0 / self.view.unit) as f32) * L::unpack(&Packed::STEPS);
        for y in 0..self.size[1] {
            let weight = L::load(&weight[y], x);
            let counts = weight.mask_from(least);
            let pixel = [self.start[0] + x as isize, self.start[1] + y as isize];
            let (_, place) = self.view.half(pixel, whole);
            let px = L::splat(place[0] as f32) + across;
            let py = L::splat(place[1] as f32);
            let m = &samples.mean;
            let row = &m[y + 2];
            let at = |row: usize| L::load(&m[row], x + RADIUS);
            let gx = near * (L::load(row, x + 3) - L::load(row, x + 1))
                + far * (L::load(row, x + 4) - L::load(row, x));
            let gy = near * (at(y + 3) - at(y + 1)) + far * (at(y + 4) - at(y));
            let of = [
                gx,
                gy,
                gx * px,
                gx * py,
                gy * px,
                gy * py,
                L::splat(1.0),
                px,
                py,
                at(y + 2),
                L::load(&samples.difference[y + 2], x + RADIUS),
            ];
            for i in 0..FEATURES {
                let feature = of[i].keep(counts);
                features[i][y] = feature.pack();
                weighted[i][y] = (weight * feature).pack();
            }
        }
        let mut next = 0;
        for i in 0..FEATURES {
            let mut own = [L::zero(); CLUSTER];
            for y in 0..CLUSTER {
                own[y] = L::unpack(&weighted[i][y]);
            }
            for j in i..FEATURES {
                let mut sum = L::zero();
                for y in 0..CLUSTER {
                    sum += own[y] * L::unpack(&features[j][y]);
                }
                sums[next] += sum.sum();
                next += 1;
            }
        }
    }
}

/// The mean of both frames and their difference.
struct Samples {
    mean: [[f32; COLUMNS]; SAMPLED],
    difference: [[f32; COLUMNS]; SAMPLED],
}

/// Multiply by the weights from a pixel on, if there are any.
#[inline(always)]
fn multiply(row: &mut [f32], weight: Option<&Plane>, [x, y]: [isize; 2]) {
    if let Some(plane) = weight {
        let from = &plane.row(y as usize)[x as usize..];
        for (value, weight) in row.iter_mut().zip(from) {
            *value *= weight;
        }
    }
}

/// The pixels of a plane from `first` on, its border repeated.
#[inline(always)]
fn copy(
    to: &mut [[f32; COLUMNS]; READ],
    plane: &Plane,
    first: [isize; 2],
    [columns, rows]: [usize; 2],
) {
    let (width, height) = (plane.width() as isize, plane.height() as isize);
    let whole = first[0] >= 0 && first[0] + columns as isize <= width;
    for (y, to) in to[..rows].iter_mut().enumerate() {
        let row = plane.row((first[1] + y as isize).clamp(0, height - 1) as usize);
        let to = &mut to[..columns];
        if whole {
            to.copy_from_slice(&row[first[0] as usize..][..columns]);
        } else {
            for (x, value) in to.iter_mut().enumerate() {
                *value = row[(first[0] + x as isize).clamp(0, width - 1) as usize];
            }
        }
    }
}
