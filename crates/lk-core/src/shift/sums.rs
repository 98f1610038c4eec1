//! The sums over tiles that the normal equations need: products of gradients, mean and difference of the frames, and of
//! these with a constant and with the place in the tile.

#![allow(clippy::needless_range_loop, reason = "lane and matrix indices")]

use std::ops::Range;

use super::refine::DERIVATIVE;
use crate::illumination::Illumination;
use crate::simd::Kernel;

/// Pixels that are summed side by side; fixed, so that no level changes the order of a sum.
pub(super) const LANES: usize = 8;

/// What varies from pixel to pixel, in this order.
const GX: usize = 0;
const GY: usize = 1;
const MEAN: usize = 2;
const DIFFERENCE: usize = 3;
/// What is summed of each pixel: ten products of the four; each of them; each times x; each times y; the weight times
/// 1, x, y, xx, xy, yy; the squared Laplacian.
const PRODUCTS: usize = 0;
const PLAIN: usize = 10;
const TIMES_X: usize = 14;
const TIMES_Y: usize = 18;
const WEIGHT: usize = 22;
const LAPLACIAN: usize = 28;
const SUMS: usize = 29;

/// Features of the normal equations: gradients, the light's regressors, and the difference.
pub(super) const F_GX: usize = 0;
pub(super) const F_GY: usize = 1;
pub(super) const F_ONE: usize = 2;
pub(super) const F_X: usize = 3;
pub(super) const F_Y: usize = 4;
pub(super) const F_MEAN: usize = 5;
pub(super) const F_DIFFERENCE: usize = 6;
pub(super) const FEATURES: usize = 7;

/// The sums of products of all features over one tile.
pub(super) type Gram = [[f64; FEATURES]; FEATURES];

/// The sums of one tile, by lane.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tile {
    sums: [[f32; LANES]; SUMS],
}

/// Which features light takes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Light {
    /// An offset that varies linearly over the tile.
    pub(super) offset: bool,
    /// A gain.
    pub(super) gain: bool,
}

impl Light {
    pub(super) fn new(illumination: Illumination) -> Self {
        Self {
            offset: illumination != Illumination::None,
            gain: illumination == Illumination::GainOffset,
        }
    }
}

/// How a region is cut into tiles.
#[derive(Debug)]
pub(super) struct Tiling {
    columns: Vec<usize>,
    rows: Vec<usize>,
    size: f32,
}

impl Tiling {
    /// Tiles of about `size` pixels along a side, a multiple of the lanes wide except at the end.
    pub(super) fn new(width: usize, height: usize, size: usize) -> Self {
        let cut = |length: usize| {
            let count = ((length + size / 2) / size).max(1);
            (0..=count)
                .map(|index| if index == count { length } else { index * size })
                .collect()
        };
        Self {
            columns: cut(width),
            rows: cut(height),
            size: size as f32,
        }
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
        let total = |sum: usize| {
            let l = &self.sums[sum];
            f64::from(((l[0] + l[4]) + (l[1] + l[5])) + ((l[2] + l[6]) + (l[3] + l[7])))
        };
        const PIXEL: [usize; 4] = [F_GX, F_GY, F_MEAN, F_DIFFERENCE];
        let mut gram = [[0.0; FEATURES]; FEATURES];
        let mut next = PRODUCTS;
        for i in 0..4 {
            for j in i..4 {
                gram[PIXEL[i]][PIXEL[j]] = total(next);
                next += 1;
            }
            gram[PIXEL[i]][F_ONE] = total(PLAIN + i);
            gram[PIXEL[i]][F_X] = total(TIMES_X + i);
            gram[PIXEL[i]][F_Y] = total(TIMES_Y + i);
        }
        let place = if weighted {
            std::array::from_fn(|k| total(WEIGHT + k))
        } else {
            tiling.place(index)
        };
        gram[F_ONE][F_ONE] = place[0];
        gram[F_ONE][F_X] = place[1];
        gram[F_ONE][F_Y] = place[2];
        gram[F_X][F_X] = place[3];
        gram[F_X][F_Y] = place[4];
        gram[F_Y][F_Y] = place[5];
        // Each product stands once, above or below the diagonal.
        for i in 0..FEATURES {
            for j in 0..i {
                let sum = gram[i][j] + gram[j][i];
                gram[i][j] = sum;
                gram[j][i] = sum;
            }
        }
        (gram, total(LAPLACIAN))
    }
}

/// Add one row to the tiles that it crosses.
pub(super) struct RowSums<'a> {
    /// Rows y - 2 to y + 2 of the mean of both frames, with two columns of padding on each side.
    pub(super) mean: [&'a [f32]; 5],
    pub(super) difference: &'a [f32],
    pub(super) weight: Option<&'a [f32]>,
    pub(super) tiling: &'a Tiling,
    pub(super) y: f32,
    pub(super) tiles: &'a mut [Tile],
}

impl Kernel for RowSums<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let columns = &self.tiling.columns;
        for (index, tile) in self.tiles.iter_mut().enumerate() {
            let mut x = columns[index];
            let end = columns[index + 1];
            let mut sums = tile.sums;
            let mut place = [0.0f32; LANES];
            let start = self.tiling.x(index, x);
            let step = self.tiling.x(index, x + 1) - start;
            for (lane, value) in place.iter_mut().enumerate() {
                *value = start + step * lane as f32;
            }
            while x < end {
                let mut weight = [1.0f32; LANES];
                let inside = (end - x).min(LANES);
                weight[inside..].fill(0.0);
                if let Some(row) = self.weight {
                    for (w, other) in weight.iter_mut().zip(&row[x..]) {
                        *w *= other;
                    }
                }
                if self.weight.is_none() && inside == LANES {
                    chunk::<false>(
                        &mut sums,
                        self.mean,
                        self.difference,
                        x,
                        &weight,
                        &place,
                        self.y,
                    );
                } else {
                    chunk::<true>(
                        &mut sums,
                        self.mean,
                        self.difference,
                        x,
                        &weight,
                        &place,
                        self.y,
                    );
                }
                x += LANES;
                for value in &mut place {
                    *value += step * LANES as f32;
                }
            }
            tile.sums = sums;
        }
    }
}

#[inline(always)]
fn chunk<const WEIGHTED: bool>(
    sums: &mut [[f32; LANES]; SUMS],
    mean: [&[f32]; 5],
    difference: &[f32],
    x: usize,
    weight: &[f32; LANES],
    place: &[f32; LANES],
    y: f32,
) {
    // Column x of the region is column x + 2 of the padded mean.
    let (Some(row), Some(r)) = (
        mean[2][x..].first_chunk::<{ LANES + 4 }>(),
        difference[x..].first_chunk::<LANES>(),
    ) else {
        return;
    };
    let (Some(a), Some(b), Some(c), Some(d)) = (
        mean[0][x + 2..].first_chunk::<LANES>(),
        mean[1][x + 2..].first_chunk::<LANES>(),
        mean[3][x + 2..].first_chunk::<LANES>(),
        mean[4][x + 2..].first_chunk::<LANES>(),
    ) else {
        return;
    };
    let mut pixel = [[0.0f32; LANES]; 4];
    let mut laplacian = [0.0f32; LANES];
    for k in 0..LANES {
        pixel[GX][k] =
            DERIVATIVE[3] * (row[k + 3] - row[k + 1]) + DERIVATIVE[4] * (row[k + 4] - row[k]);
        pixel[GY][k] = DERIVATIVE[3] * (c[k] - b[k]) + DERIVATIVE[4] * (d[k] - a[k]);
        pixel[MEAN][k] = row[k + 2];
        pixel[DIFFERENCE][k] = r[k];
        laplacian[k] = ((row[k + 1] + row[k + 3]) + (b[k] + c[k])) - 4.0 * row[k + 2];
    }
    if WEIGHTED {
        for k in 0..LANES {
            for value in &mut pixel {
                value[k] *= weight[k];
            }
            laplacian[k] *= weight[k];
        }
    }
    let mut next = PRODUCTS;
    for i in 0..4 {
        for j in i..4 {
            for k in 0..LANES {
                sums[next][k] += pixel[i][k] * pixel[j][k];
            }
            next += 1;
        }
    }
    for i in 0..4 {
        for k in 0..LANES {
            sums[PLAIN + i][k] += pixel[i][k];
            sums[TIMES_X + i][k] += pixel[i][k] * place[k];
            sums[TIMES_Y + i][k] += pixel[i][k] * y;
        }
    }
    for k in 0..LANES {
        sums[LAPLACIAN][k] += laplacian[k] * laplacian[k];
    }
    if WEIGHTED {
        for k in 0..LANES {
            let w = weight[k];
            let wx = w * place[k];
            sums[WEIGHT][k] += w;
            sums[WEIGHT + 1][k] += wx;
            sums[WEIGHT + 2][k] += w * y;
            sums[WEIGHT + 3][k] += wx * place[k];
            sums[WEIGHT + 4][k] += wx * y;
            sums[WEIGHT + 5][k] += w * y * y;
        }
    }
}
