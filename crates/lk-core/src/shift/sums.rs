//! The sums over tiles that the normal equations need: products of gradients, mean and difference of the frames, and of
//! these with a constant and with the place in the tile.

#![allow(clippy::needless_range_loop, reason = "lane and matrix indices")]

use std::ops::Range;

use super::refine::DERIVATIVE;
use crate::frame::Plane;
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

/// Sum up a stripe of tiles.
pub(super) struct StripeSums<'a> {
    /// The mean of both frames, with two columns of padding on the left and more on the right.
    pub(super) mean: &'a Plane,
    pub(super) difference: &'a Plane,
    pub(super) weight: Option<&'a Plane>,
    pub(super) tiling: &'a Tiling,
    pub(super) stripe: usize,
    pub(super) tiles: &'a mut [Tile],
}

impl Kernel for StripeSums<'_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let columns = &self.tiling.columns;
        let tiles = std::mem::take(&mut self.tiles);
        for (index, tile) in tiles.iter_mut().enumerate() {
            let mut x = columns[index];
            let end = columns[index + 1];
            while x < end {
                let inside = (end - x).min(LANES);
                let place: [f32; LANES] =
                    std::array::from_fn(|lane| self.tiling.x(index, x + lane));
                if self.weight.is_none() && inside == LANES {
                    self.column::<false>(&mut tile.sums, x, inside, &place);
                } else {
                    self.column::<true>(&mut tile.sums, x, inside, &place);
                }
                x += LANES;
            }
        }
    }
}

impl StripeSums<'_> {
    /// Add the lanes from column `x` on, of all rows of the stripe; `inside` of them are in the tile.
    #[inline(always)]
    fn column<const WEIGHTED: bool>(
        &self,
        total: &mut [[f32; LANES]; SUMS],
        x: usize,
        inside: usize,
        place: &[f32; LANES],
    ) {
        let height = self.mean.height() as isize;
        let row = |y: usize, by: isize| {
            self.mean
                .row((y as isize + by).clamp(0, height - 1) as usize)
        };
        let mut products = [[0.0f32; LANES]; 10];
        let mut plain = [[0.0f32; LANES]; 4];
        let mut times_y = [[0.0f32; LANES]; 4];
        let mut bent = [0.0f32; LANES];
        let mut place_sums = [[0.0f32; LANES]; 6];
        for y in self.tiling.rows(self.stripe) {
            // Column x of the region is column x + 2 of the padded mean.
            let (Some(m), Some(r), Some(a), Some(b), Some(c), Some(d)) = (
                row(y, 0)[x..].first_chunk::<{ LANES + 4 }>(),
                self.difference.row(y)[x..].first_chunk::<LANES>(),
                row(y, -2)[x + 2..].first_chunk::<LANES>(),
                row(y, -1)[x + 2..].first_chunk::<LANES>(),
                row(y, 1)[x + 2..].first_chunk::<LANES>(),
                row(y, 2)[x + 2..].first_chunk::<LANES>(),
            ) else {
                return;
            };
            let place_y = self.tiling.y(self.stripe, y);
            let mut pixel = [[0.0f32; LANES]; 4];
            let mut laplacian = [0.0f32; LANES];
            for k in 0..LANES {
                pixel[GX][k] =
                    DERIVATIVE[3] * (m[k + 3] - m[k + 1]) + DERIVATIVE[4] * (m[k + 4] - m[k]);
            }
            for k in 0..LANES {
                pixel[GY][k] = DERIVATIVE[3] * (c[k] - b[k]) + DERIVATIVE[4] * (d[k] - a[k]);
            }
            pixel[MEAN].copy_from_slice(&m[2..LANES + 2]);
            pixel[DIFFERENCE] = *r;
            for k in 0..LANES {
                laplacian[k] = ((m[k + 1] + m[k + 3]) + (b[k] + c[k])) - 4.0 * m[k + 2];
            }
            if WEIGHTED {
                let mut weight = [1.0f32; LANES];
                weight[inside..].fill(0.0);
                if let Some(plane) = self.weight {
                    for (w, other) in weight.iter_mut().zip(&plane.row(y)[x..]) {
                        *w *= other;
                    }
                }
                for k in 0..LANES {
                    for value in &mut pixel {
                        value[k] *= weight[k];
                    }
                    laplacian[k] *= weight[k];
                }
                for k in 0..LANES {
                    let w = weight[k];
                    let wx = w * place[k];
                    place_sums[0][k] += w;
                    place_sums[1][k] += wx;
                    place_sums[2][k] += w * place_y;
                    place_sums[3][k] += wx * place[k];
                    place_sums[4][k] += wx * place_y;
                    place_sums[5][k] += w * place_y * place_y;
                }
            }
            let mut next = 0;
            for i in 0..4 {
                for j in i..4 {
                    for k in 0..LANES {
                        products[next][k] += pixel[i][k] * pixel[j][k];
                    }
                    next += 1;
                }
            }
            for i in 0..4 {
                for k in 0..LANES {
                    plain[i][k] += pixel[i][k];
                }
                for k in 0..LANES {
                    times_y[i][k] += pixel[i][k] * place_y;
                }
            }
            for k in 0..LANES {
                bent[k] += laplacian[k] * laplacian[k];
            }
        }
        for k in 0..LANES {
            for i in 0..10 {
                total[PRODUCTS + i][k] += products[i][k];
            }
            for i in 0..4 {
                total[PLAIN + i][k] += plain[i][k];
                // A lane of a column has one x.
                total[TIMES_X + i][k] += plain[i][k] * place[k];
                total[TIMES_Y + i][k] += times_y[i][k];
            }
            for i in 0..6 {
                total[WEIGHT + i][k] += place_sums[i][k];
            }
            total[LAPLACIAN][k] += bent[k];
        }
    }
}
