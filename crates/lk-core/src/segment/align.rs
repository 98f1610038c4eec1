//! Where a picture lies on the background: one least-squares step of a homography over all pixels where both show the same
//! still thing, in tiles.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Kernel, LANES, Simd, dispatch};

use super::morphology::Size;
use super::slopes::{gradient, rows_around};
use super::transform::{IDENTITY, Map};

/// Pixels of a tile along each axis.
const TILE: usize = 16;
const _: () = assert!(TILE == LANES);
/// What a tile tells: gradients squared xx, xy, yy, and times the difference, x and y.
const SUMS: usize = 5;
/// Before anything is seen the map is within so many pixels of the right one, at the border of the frame: by shift, by
/// linear parts, by perspective.
const PRIOR_PX: [f64; 3] = [1.0, 0.7, 0.3];
/// Neighbouring pixels share the errors of interpolation and of light: so many tell as much as one.
const ALIKE: f64 = 12.0;
/// Differences beyond so many standard deviations, and the share of the gradient that one pixel explains, are of things.
const REACH: f32 = 3.0;

/// A picture beside the background, in its light.
pub(crate) struct Pictures<'a> {
    pub(crate) size: Size,
    pub(crate) background: &'a [f32],
    pub(crate) picture: &'a [f32],
    /// 1 where both show the same still thing, as far as is known.
    pub(crate) still: &'a [u8],
    /// Standard deviation of their difference.
    pub(crate) noise: f32,
}

/// A row of pixels, added to the sums of its tiles: each pixel of a tile's width to a lane of its own.
struct TileRow<'a> {
    around: [&'a [f32]; 3],
    picture: &'a [f32],
    still: &'a [u8],
    /// Differences beyond this, and the gradient, do not count.
    reach: f32,
    slopes: [&'a mut [f32]; 2],
    sums: &'a mut [[[f32; LANES]; SUMS]],
}

impl Kernel for TileRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [gx, gy] = self.slopes;
        gradient(self.around, gx, gy);
        let (whole_x, rest_x) = gx.as_chunks::<TILE>();
        let (whole_y, rest_y) = gy.as_chunks::<TILE>();
        let (pictures, rest_picture) = self.picture.as_chunks::<TILE>();
        let (backgrounds, rest_background) = self.around[1].as_chunks::<TILE>();
        let (stills, rest_still) = self.still.as_chunks::<TILE>();
        let whole = whole_x.len();
        for tile in 0..whole {
            let slopes = [&whole_x[tile], &whole_y[tile]];
            let pictures = [&pictures[tile], &backgrounds[tile]];
            add(
                slopes,
                pictures,
                &stills[tile],
                self.reach,
                &mut self.sums[tile],
            );
        }
        if rest_still.is_empty() {
            return;
        }
        // What is missing of the last tile does not stand still.
        let count = rest_still.len();
        let (mut still, mut planes) = ([0; TILE], [[0.0; TILE]; 4]);
        still[..count].copy_from_slice(rest_still);
        for (plane, rest) in planes
            .iter_mut()
            .zip([rest_x, rest_y, rest_picture, rest_background])
        {
            plane[..count].copy_from_slice(rest);
        }
        let [x, y, picture, background] = &planes;
        add(
            [x, y],
            [picture, background],
            &still,
            self.reach,
            &mut self.sums[whole],
        );
    }
}

/// Add a row of one tile.
#[inline(always)]
fn add(
    [gx, gy]: [&[f32; TILE]; 2],
    [picture, background]: [&[f32; TILE]; 2],
    still: &[u8; TILE],
    reach: f32,
    sums: &mut [[f32; LANES]; SUMS],
) {
    let [xx, xy, yy, xd, yd] = sums;
    for k in 0..TILE {
        let d = picture[k] - background[k];
        let limit = reach + gx[k].abs() + gy[k].abs();
        let w = if d.abs() < limit {
            f32::from(still[k])
        } else {
            0.0
        };
        let (wx, wy) = (w * gx[k], w * gy[k]);
        xx[k] += wx * gx[k];
        xy[k] += wx * gy[k];
        yy[k] += wy * gy[k];
        xd[k] += wx * d;
        yd[k] += wy * d;
    }
}

/// Memory that is kept.
#[derive(Debug, Default)]
pub(crate) struct Alignment {
    tiles: Vec<f64>,
}

impl Alignment {
    /// The map that takes what the picture has to where the background has it, and by how many pixels it moves the corners
    /// at most.
    ///
    /// # Errors
    ///
    /// Those of the execution; [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn step(&mut self, of: &Pictures<'_>, execution: &Execution) -> Result<(Map, f64)> {
        let (width, height) = of.size;
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let stride = columns * SUMS;
        self.tiles.clear();
        resize("tiles", &mut self.tiles, rows * stride, 0.0)?;
        let level = execution.simd_level();
        for_each_band(
            execution,
            rows,
            2,
            RowsMut::new(&mut self.tiles, stride),
            |band, mut part| {
                with_scratch(2 * width + columns * SUMS * LANES, |scratch| {
                    let (slopes, lanes) = scratch.split_at_mut(2 * width);
                    let (gx, gy) = slopes.split_at_mut(width);
                    let lanes = lanes.as_chunks_mut::<LANES>().0;
                    for (local, row) in band.enumerate() {
                        lanes.fill([0.0; LANES]);
                        for y in row * TILE..((row + 1) * TILE).min(height) {
                            let place = y * width..(y + 1) * width;
                            let kernel = TileRow {
                                around: rows_around(of.background, of.size, y),
                                picture: &of.picture[place.clone()],
                                still: &of.still[place],
                                reach: REACH * of.noise,
                                slopes: [&mut *gx, &mut *gy],
                                sums: lanes.as_chunks_mut::<SUMS>().0,
                            };
                            dispatch(level, kernel);
                        }
                        for (sum, lanes) in part.row_mut(local).iter_mut().zip(&*lanes) {
                            *sum = lanes.iter().map(|value| f64::from(*value)).sum();
                        }
                    }
                })
            },
        )?;
        Ok(self.solve(of.size, f64::from(of.noise)))
    }

    fn solve(&self, (width, height): Size, noise: f64) -> (Map, f64) {
        let columns = width.div_ceil(TILE);
        let unit = (width.max(height) as f64) / 2.0;
        let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
        let (mut normal, mut right) = ([[0.0; 8]; 8], [0.0; 8]);
        for (k, [xx, xy, yy, xd, yd]) in self.tiles.as_chunks::<SUMS>().0.iter().enumerate() {
            if xx + yy == 0.0 {
                continue;
            }
            let at = |k: usize, m: f64| ((k * TILE) as f64 + (TILE - 1) as f64 / 2.0 - m) / unit;
            let (x, y) = (at(k % columns, middle[0]), at(k / columns, middle[1]));
            let across = [1.0, x, y, 0.0, 0.0, 0.0, x * x, x * y];
            let down = [0.0, 0.0, 0.0, 1.0, x, y, x * y, y * y];
            for i in 0..8 {
                let (a, b) = (xx * across[i] + xy * down[i], xy * across[i] + yy * down[i]);
                for j in 0..8 {
                    normal[i][j] += a * across[j] + b * down[j];
                }
                right[i] += xd * across[i] + yd * down[i];
            }
        }
        let variance = noise * noise * ALIKE;
        let [shift, linear, perspective] = PRIOR_PX.map(|px| variance / (px * px));
        let prior = [
            shift,
            linear,
            linear,
            shift,
            linear,
            linear,
            perspective,
            perspective,
        ];
        for (k, prior) in prior.into_iter().enumerate() {
            normal[k][k] += prior;
        }
        let Some(p) = solved(normal, right) else {
            return (IDENTITY, 0.0);
        };
        let map = to_map(p, unit, middle);
        let mut most = 0.0f64;
        for corner in [
            [0.0, 0.0],
            [width as f64, 0.0],
            [0.0, height as f64],
            [width as f64, height as f64],
        ] {
            let [x, y] = super::transform::applied(&map, corner);
            most = most.max((x - corner[0]).hypot(y - corner[1]));
        }
        (map, most)
    }
}

/// x' = x + p0 + p1 x + p2 y + x (p6 x + p7 y) and likewise down, to first order, as a homography of pixels.
fn to_map(p: [f64; 8], unit: f64, [cx, cy]: [f64; 2]) -> Map {
    let [a, b, c, d, e, f, g, h] = p.map(|value| value / unit);
    let inner = [[1.0 + b, c, a], [e, 1.0 + f, d], [-g, -h, 1.0]];
    let to_unit = [
        [1.0 / unit, 0.0, -cx / unit],
        [0.0, 1.0 / unit, -cy / unit],
        [0.0, 0.0, 1.0],
    ];
    let to_pixels = [[unit, 0.0, cx], [0.0, unit, cy], [0.0, 0.0, 1.0]];
    super::transform::product(&to_pixels, &super::transform::product(&inner, &to_unit))
}

/// Cholesky's solution of a positive definite system.
fn solved(mut a: [[f64; 8]; 8], mut b: [f64; 8]) -> Option<[f64; 8]> {
    for i in 0..8 {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f64>();
            if i == j {
                if sum <= 0.0 || !sum.is_finite() {
                    return None;
                }
                a[i][i] = sum.sqrt();
            } else {
                a[i][j] = sum / a[j][j];
            }
        }
    }
    for i in 0..8 {
        b[i] = (b[i] - (0..i).map(|k| a[i][k] * b[k]).sum::<f64>()) / a[i][i];
    }
    for i in (0..8).rev() {
        b[i] = (b[i] - (i + 1..8).map(|k| a[k][i] * b[k]).sum::<f64>()) / a[i][i];
    }
    Some(b)
}

#[cfg(test)]
mod tests {
    use super::super::placed::Moved;
    use super::super::transform::{applied, inverse, product};
    use super::*;
    use crate::simd::SimdLevel;

    #[test]
    fn a_picture_is_brought_to_where_the_background_has_it() {
        let size = (200, 150);
        let background: Vec<f32> = (0..size.0 * size.1)
            .map(|k| ((k % size.0) as f32, (k / size.0) as f32))
            .map(|(x, y)| {
                100.0 + 40.0 * (0.21 * x + 0.05 * y).sin() + 30.0 * (0.17 * y - 0.03 * x).cos()
            })
            .collect();
        // The picture has at x what the background has at truth(x).
        let truth = [
            [1.004, -0.003, 0.3],
            [0.002, 0.997, -0.4],
            [1e-5, -8e-6, 1.0],
        ];
        let mut map = IDENTITY;
        let still = vec![1; background.len()];
        for _ in 0..4 {
            let seen = product(&truth, &inverse(&map).unwrap());
            let mut picture = vec![0.0; background.len()];
            let (mut inside, mut spare) = (vec![0; size.0], vec![0.0; 2 * size.0]);
            let moved = Moved {
                from: (&background, size),
                map: &seen,
            };
            for (y, row) in picture.chunks_exact_mut(size.0).enumerate() {
                moved.row(y, row, &mut inside, &mut spare, SimdLevel::detected());
            }
            let of = Pictures {
                size,
                background: &background,
                picture: &picture,
                still: &still,
                noise: 1.0,
            };
            let (step, _) = Alignment::default()
                .step(&of, &Execution::default())
                .unwrap();
            map = product(&step, &map);
        }
        for place in [[10.0, 10.0], [190.0, 20.0], [100.0, 140.0]] {
            let (got, want) = (applied(&map, place), applied(&truth, place));
            assert!(
                (got[0] - want[0]).hypot(got[1] - want[1]) < 0.03,
                "{got:?} {want:?}"
            );
        }
    }
}
