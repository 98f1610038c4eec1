//! The sums over tiles that the normal equations need: products of gradients, mean and difference of the frames, and of
//! these with a constant and with the place in the tile.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use std::ops::Range;

use super::filters::{DERIVATIVE, RADIUS};
use super::gram::{F_DIFFERENCE, F_GX, F_GY, F_MEAN, F_ONE, F_X, F_Y, Gram};
use crate::error::Result;
use crate::frame::Plane;
use crate::memory::reserve;
use crate::simd::{EIGHT, Eight, Packed};

/// What is summed of each pixel: ten products of the gradients along x and along y, the mean and the difference; each of them; each times x; each times y; the weight times
/// 1, x, y, xx, xy, yy; the squared Laplacian.
const PRODUCTS: usize = 0;
const PLAIN: usize = 10;
const TIMES_X: usize = 14;
const TIMES_Y: usize = 18;
const WEIGHT: usize = 22;
const LAPLACIAN: usize = 28;
const SUMS: usize = 29;

/// The sums of one tile, by lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tile {
    sums: [Packed; SUMS],
}

impl Tile {
    pub(super) const ZERO: Self = Self {
        sums: [Packed::ZERO; SUMS],
    };
}

/// How a region is cut into tiles.
#[derive(Debug, Default)]
pub(super) struct Tiling {
    columns: Vec<usize>,
    rows: Vec<usize>,
    size: f32,
}

impl Tiling {
    /// Cut a region of `region` columns and rows into tiles of about `sides` pixels across and down; the last ones of each
    /// row and column may be up to half smaller or larger.
    pub(super) fn cut(&mut self, region: [usize; 2], sides: [usize; 2]) -> Result<()> {
        let axes = [&mut self.columns, &mut self.rows].into_iter();
        for ((cuts, length), size) in axes.zip(region).zip(sides) {
            let count = ((length + size / 2) / size).max(1);
            cuts.clear();
            reserve("tiles", cuts, count + 1)?;
            cuts.extend((0..count).map(|index| index * size));
            cuts.push(length);
        }
        self.size = sides[0].max(sides[1]) as f32;
        Ok(())
    }

    pub(super) fn across(&self) -> usize {
        self.columns.len() - 1
    }

    pub(super) fn down(&self) -> usize {
        self.rows.len() - 1
    }

    /// The rows of a stripe of tiles.
    pub(super) fn rows(&self, stripe: usize) -> Range<usize> {
        self.rows[stripe]..self.rows[stripe + 1]
    }

    /// The place of row `y` in its stripe, 0 in the middle.
    pub(super) fn y(&self, stripe: usize, y: usize) -> f32 {
        let middle = (self.rows[stripe] + self.rows[stripe + 1]) as f32 / 2.0;
        (y as f32 + 0.5 - middle) / self.size
    }

    /// The place of column `x` in its tile, 0 in the middle.
    #[inline(always)]
    fn x(&self, tile: usize, x: usize) -> f32 {
        let middle = (self.columns[tile] + self.columns[tile + 1]) as f32 / 2.0;
        (x as f32 + 0.5 - middle) / self.size
    }

    /// The middle of a tile, in pixels from the border of the region.
    pub(super) fn middle_pixels(&self, column: usize, row: usize) -> [f64; 2] {
        let middle = |cuts: &[usize], index: usize| (cuts[index] + cuts[index + 1]) as f64 / 2.0;
        [middle(&self.columns, column), middle(&self.rows, row)]
    }

    /// The middle of a tile, in the unit of x and y.
    pub(super) fn middle(&self, column: usize, row: usize) -> [f64; 2] {
        self.middle_pixels(column, row)
            .map(|value| value / f64::from(self.size))
    }

    /// The middle of the region, in the unit of x and y.
    pub(super) fn center(&self) -> [f64; 2] {
        [&self.columns, &self.rows]
            .map(|cuts| cuts.last().map_or(0.0, |end| *end as f64 / 2.0) / f64::from(self.size))
    }

    /// Pixels in the unit of x and y.
    pub(super) fn unit(&self) -> f64 {
        f64::from(self.size)
    }

    /// From `point` to the middle of a tile, in the unit of x and y.
    pub(super) fn from(&self, tile: usize, point: [f64; 2]) -> [f64; 2] {
        let middle = self.middle(tile % self.across(), tile / self.across());
        [middle[0] - point[0], middle[1] - point[1]]
    }

    /// The sums of 1, x, y, xx, xy, yy over a whole tile.
    fn place(&self, tile: usize) -> [f64; 6] {
        let (column, row) = (tile % self.across(), tile / self.across());
        let width = (self.columns[column + 1] - self.columns[column]) as f64;
        let height = (self.rows[row + 1] - self.rows[row]) as f64;
        let size = f64::from(self.size);
        // The sum of squares of n numbers one apart around 0 is n (n n - 1) / 12.
        let square = |n: f64| n * (n * n - 1.0) / 12.0 / (size * size);
        [
            width * height,
            0.0,
            0.0,
            height * square(width),
            0.0,
            width * square(height),
        ]
    }
}

impl Tile {
    /// The sums in f64, and that of the squared Laplacian.
    pub(super) fn gram(&self, index: usize, tiling: &Tiling, weighted: bool) -> (Gram, f64) {
        let total = |sum: usize| self.sums[sum].sum();
        let gram = Self::gram_of(total, (!weighted).then(|| tiling.place(index)));
        (gram, total(LAPLACIAN))
    }

    /// The sums over every eighth column of a tile that was weighted: over column `lane`, where it has eight.
    pub(super) fn column_gram(&self, lane: usize) -> Gram {
        Self::gram_of(|sum| f64::from(self.sums[sum].0[lane]), None)
    }

    #[inline(always)]
    fn gram_of(total: impl Fn(usize) -> f64, place: Option<[f64; 6]>) -> Gram {
        const PIXEL: [usize; 4] = [F_GX, F_GY, F_MEAN, F_DIFFERENCE];
        let mut gram = Gram::default();
        let g = &mut gram.0;
        let mut next = PRODUCTS;
        for i in 0..4 {
            for j in i..4 {
                g[PIXEL[i].min(PIXEL[j])][PIXEL[i].max(PIXEL[j])] = total(next);
                next += 1;
            }
            g[F_ONE][PIXEL[i]] = total(PLAIN + i);
            g[F_X][PIXEL[i]] = total(TIMES_X + i);
            g[F_Y][PIXEL[i]] = total(TIMES_Y + i);
        }
        let place = place.unwrap_or_else(|| std::array::from_fn(|k| total(WEIGHT + k)));
        [
            g[F_ONE][F_ONE],
            g[F_ONE][F_X],
            g[F_ONE][F_Y],
            g[F_X][F_X],
            g[F_X][F_Y],
            g[F_Y][F_Y],
        ] = place;
        gram
    }
}

/// Sums up a stripe of tiles.
pub(super) struct StripeSums<'a> {
    /// The rows of the stripe, of the mean of both frames, with [`RADIUS`] more above, below and on each side.
    pub(super) mean: &'a Plane,
    /// The same rows of the difference, without more columns on each side.
    pub(super) difference: &'a Plane,
    /// Of the whole region.
    pub(super) weight: Option<&'a Plane>,
    pub(super) tiling: &'a Tiling,
    pub(super) stripe: usize,
}

/// Which pixels of some lanes count.
const ALL: u8 = 0;
const SOME_LANES: u8 = 1;
const WEIGHTED: u8 = 2;

impl StripeSums<'_> {
    #[inline(always)]
    pub(super) fn run<L: Eight>(self, tiles: &mut [Tile]) {
        let columns = &self.tiling.columns;
        for (index, tile) in tiles.iter_mut().enumerate() {
            let mut x = columns[index];
            let end = columns[index + 1];
            while x < end {
                let inside = (end - x).min(EIGHT);
                if self.weight.is_some() {
                    self.column::<L, WEIGHTED>(index, tile, x, inside);
                } else if inside < EIGHT {
                    self.column::<L, SOME_LANES>(index, tile, x, inside);
                } else {
                    self.column::<L, ALL>(index, tile, x, inside);
                }
                x += EIGHT;
            }
        }
    }

    /// Add the lanes from column `x` on, of all rows of the stripe; `inside` of them are in the tile.
    #[inline(always)]
    fn column<L: Eight, const COUNT: u8>(
        &self,
        index: usize,
        tile: &mut Tile,
        x: usize,
        inside: usize,
    ) {
        let lanes = L::first(inside);
        let place_x = L::splat(self.tiling.x(index, x))
            + L::splat(1.0 / self.tiling.size) * L::unpack(&Packed::STEPS);
        let (near, far) = (L::splat(DERIVATIVE[3]), L::splat(DERIVATIVE[4]));
        let four = L::splat(4.0);
        let mut products = [L::zero(); 10];
        let mut plain = [L::zero(); 4];
        let mut times_y = [L::zero(); 4];
        let mut bent = L::zero();
        let mut place_sums = [L::zero(); 6];
        let stride = self.mean.width();
        for (local, y) in self.tiling.rows(self.stripe).enumerate() {
            // Row `local` of the stripe is row `local + 2` of the planes, column x of the region column x + 2 of the mean.
            let m = &self.mean.row(local + RADIUS)[x..x + EIGHT + 2 * RADIUS];
            let at = |row: usize| L::load(self.mean.data(), (local + row) * stride + x + RADIUS);
            let (above, below) = (at(1), at(3));
            let (left, middle, right) = (L::load(m, 1), L::load(m, 2), L::load(m, 3));
            let mut pixel = [
                near * (right - left) + far * (L::load(m, 4) - L::load(m, 0)),
                near * (below - above) + far * (at(4) - at(0)),
                middle,
                L::load(self.difference.row(local + RADIUS), x),
            ];
            let mut laplacian = ((left + right) + (above + below)) - four * middle;
            let place_y = L::splat(self.tiling.y(self.stripe, y));
            if COUNT == SOME_LANES {
                for value in &mut pixel {
                    *value = value.keep(lanes);
                }
                laplacian = laplacian.keep(lanes);
            }
            if COUNT == WEIGHTED
                && let Some(plane) = self.weight
            {
                let weight = L::load(plane.row(y), x).keep(lanes);
                for value in &mut pixel {
                    *value = *value * weight;
                }
                laplacian = laplacian * weight;
                let (wx, wy) = (weight * place_x, weight * place_y);
                place_sums[0] += weight;
                place_sums[1] += wx;
                place_sums[2] += wy;
                place_sums[3] += wx * place_x;
                place_sums[4] += wx * place_y;
                place_sums[5] += wy * place_y;
            }
            let mut next = 0;
            for i in 0..4 {
                for j in i..4 {
                    products[next] += pixel[i] * pixel[j];
                    next += 1;
                }
                plain[i] += pixel[i];
                times_y[i] += pixel[i] * place_y;
            }
            bent += laplacian * laplacian;
        }
        let column = ColumnSums {
            products,
            plain,
            times_y,
            place_sums,
            bent,
        };
        column.add_to::<COUNT>(&mut tile.sums, place_x);
    }
}

/// The sums over a column of lanes.
struct ColumnSums<L> {
    products: [L; 10],
    plain: [L; 4],
    times_y: [L; 4],
    place_sums: [L; 6],
    bent: L,
}

impl<L: Eight> ColumnSums<L> {
    #[inline(always)]
    fn add_to<const COUNT: u8>(self, sums: &mut [Packed; SUMS], place_x: L) {
        for i in 0..10 {
            add(&mut sums[PRODUCTS + i], self.products[i]);
        }
        for i in 0..4 {
            add(&mut sums[PLAIN + i], self.plain[i]);
            // A lane of a column has one x.
            add(&mut sums[TIMES_X + i], self.plain[i] * place_x);
            add(&mut sums[TIMES_Y + i], self.times_y[i]);
        }
        if COUNT == WEIGHTED {
            for i in 0..6 {
                add(&mut sums[WEIGHT + i], self.place_sums[i]);
            }
        }
        add(&mut sums[LAPLACIAN], self.bent);
    }
}

#[inline(always)]
fn add<L: Eight>(to: &mut Packed, more: L) {
    *to = (L::unpack(to) + more).pack();
}
