//! How far the flow of each pixel may be off.
//!
//! Two things are known of that. A window of the last step or round says what noise does: its mean squared difference over
//! its structure tensor. And the flow itself says the rest: what smoothness has spread over tens of pixels, and what a blur,
//! a change of light or weak texture bends, shows in second differences of the flow that are far apart, which are 0 for any
//! affine motion. Of those along both axes the geometric mean is taken, as an edge of motion shows along one alone. The
//! constants are fitted to photographs under 18 kinds of motion, light and noise
//! (`docs/records/dense_flow_record.md`).
//!
//! All of it is found in cells of 4 x 4 and blocks of 8 x 8 pixels.
//!
//! `docs/explanation/algorithms.md`, section "Covariance of dense flow".

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};

use super::box_mean::{box_mean, carry};
use super::confidence::Judged;
use super::field::FlowField;

/// Pixels along each side of a cell.
const CELL: usize = 4;
/// Pixels along each side of a block, in which second differences are found: a few cells.
const BLOCK: usize = 2 * CELL;
/// Blocks between the places of a second difference.
const APART: usize = 4;
/// Half the square over which second differences are averaged, in blocks, and that of what windows say, in cells.
const AROUND: usize = 2;
const WINDOWS: usize = 1;

/// Mean squared differences that no residual shows, in squared grey levels: what rounding leaves.
const UNSEEN: f32 = 0.01;
/// Texture that smoothness stands for, in squared grey levels.
const SMOOTHNESS: f32 = 0.3;
/// What the variance of a flow is made of, as fitted to a preset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shares {
    /// Over the mean squared difference of a window and the inverse of its mean structure tensor: one over the pixels that
    /// smoothness makes one.
    pub(crate) noise: f32,
    /// Over a sixth of the mean squared second difference.
    pub(crate) roughness: f32,
}

/// The variance where no second difference is known, in squared pixels: frames of two blocks have errors like that.
const UNKNOWN: f32 = 0.0225;
/// The least variance, in squared pixels: interpolation errs by that, and alike everywhere, where the whole picture moves by the
/// same part of a pixel.
const LEAST: f32 = 7.5e-6;
/// Flow that is interpolated from the level of half the size is off by more than it shows: how many times the variance is
/// what it seems, and what is added to it, in squared pixels.
const INTERPOLATED: [f32; 2] = [1.5, 2e-4];

/// Memory, of the cells and blocks of a frame.
#[derive(Debug, Default)]
pub(super) struct Cells {
    /// Mean squared difference, and the structure tensor: xx, xy, yy.
    said: [Vec<f32>; 4],
    /// Of the blocks, as the rest.
    flow: [Vec<f32>; 2],
    /// Mean squared second differences of u along x and y, and of v.
    rough: [Vec<f32>; 4],
    spare: Vec<f32>,
    /// Of the cells: of u, of u and v, of v.
    variances: Vec<[f32; 3]>,
}

/// Write the covariance of `field`, which has room for it and of whose pixels `valid` is known, from `prev` and what was said of its windows; `finest` is
/// the finest level that was measured.
pub(super) fn write(
    field: &mut FlowField,
    (judged, prev): (&Judged, &Plane),
    (finest, shares): (usize, Shares),
    cells: &mut Cells,
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (field.width, field.height);
    cells.measure(field, (judged, prev), shares)?;
    if finest > 0 {
        let [times, more] = INTERPOLATED;
        for [xx, xy, yy] in &mut cells.variances {
            (*xx, *xy, *yy) = (times * *xx + more, times * *xy, times * *yy + more);
        }
    }
    let columns = width.div_ceil(CELL);
    let (uv, valid, variances) = (&field.uv, &field.valid, &cells.variances);
    let min_rows = even_bands(execution, height, [16_384 / width, 4_096 / width]);
    let output = RowsMut::new(&mut field.covariance, 4 * width);
    for_each_band(execution, height, min_rows, output, |rows, mut part| {
        for (local, y) in rows.enumerate() {
            let (row, _) = part.row_mut(local).as_chunks_mut::<4>();
            let of_cells = &variances[y / CELL * columns..][..columns];
            for ((group, valid), [xx, xy, yy]) in row
                .chunks_mut(CELL)
                .zip(valid[y * width..][..width].chunks(CELL))
                .zip(of_cells)
            {
                for (to, valid) in group.iter_mut().zip(valid) {
                    *to = if *valid {
                        [*xx, *xy, *xy, *yy]
                    } else {
                        [f32::INFINITY, 0.0, 0.0, f32::INFINITY]
                    };
                }
            }
            for (to, flow) in row.iter_mut().zip(uv[2 * y * width..].chunks_exact(2)) {
                if flow[0].is_nan() {
                    *to = [f32::NAN; 4];
                }
            }
        }
    })
}

impl Cells {
    fn measure(
        &mut self,
        field: &FlowField,
        (judged, prev): (&Judged, &Plane),
        shares: Shares,
    ) -> Result<()> {
        let size = (field.width.div_ceil(CELL), field.height.div_ceil(CELL));
        self.read_windows(judged, prev, size)?;
        for cells in &mut self.said {
            box_mean(cells, &mut self.spare, size, WINDOWS)?;
        }
        let blocks = (field.width.div_ceil(BLOCK), field.height.div_ceil(BLOCK));
        self.read_flow(field, blocks)?;
        for (k, rough) in self.rough.iter_mut().enumerate() {
            second_differences(&self.flow[k / 2], blocks, k % 2, rough)?;
            if rough.iter().any(|square| square.is_nan()) {
                carry(rough, blocks.0);
            }
            box_mean(rough, &mut self.spare, blocks, AROUND)?;
        }
        resize("variances", &mut self.variances, size.0 * size.1, [0.0; 3])?;
        let [energy, xx, xy, yy] = self.said.each_ref();
        let [ux, uy, vx, vy] = self.rough.each_ref();
        for (k, variances) in self.variances.iter_mut().enumerate() {
            let (xx, xy, yy) = (xx[k] + SMOOTHNESS, xy[k], yy[k] + SMOOTHNESS);
            let noise = shares.noise * (energy[k] + UNSEEN) / (xx * yy - xy * xy);
            let block = k / size.0 * CELL / BLOCK * blocks.0 + k % size.0 * CELL / BLOCK;
            let [u, v] = [[ux[block], uy[block]], [vx[block], vy[block]]]
                .map(|[x, y]| shares.roughness * both_axes(x, y) + LEAST);
            *variances = [noise * yy + u, -noise * xy, noise * xx + v];
            if !variances.iter().all(|variance| variance.is_finite()) {
                *variances = [f32::INFINITY, 0.0, f32::INFINITY];
            }
        }
        Ok(())
    }

    /// The mean squared difference and the structure tensor of each cell, from one pixel in each 2 x 2.
    fn read_windows(
        &mut self,
        judged: &Judged,
        prev: &Plane,
        (columns, rows): (usize, usize),
    ) -> Result<()> {
        for cells in &mut self.said {
            resize("structure tensors", cells, columns * rows, 0.0)?;
            cells.fill(0.0);
        }
        let (width, height) = (prev.width(), prev.height());
        for (cell_y, row_of_cells) in (0..rows).map(|y| (y, y * columns)) {
            let [energies, all_xx, all_xy, all_yy] = self
                .said
                .each_mut()
                .map(|cells| &mut cells[row_of_cells..][..columns]);
            for y in (CELL * cell_y..height).step_by(2).take(CELL / 2) {
                let (above, row) = (prev.row(y.saturating_sub(1)), prev.row(y));
                let below = prev.row((y + 1).min(height - 1));
                let misfits = judged.misfit.row((y / 2).min(judged.misfit.height() - 1));
                for x in (0..width).step_by(2) {
                    let cell = x / CELL;
                    let along = row[(x + 1).min(width - 1)] - row[x.saturating_sub(1)];
                    let down = below[x] - above[x];
                    let misfit = misfits[x / 2];
                    energies[cell] += misfit * misfit;
                    all_xx[cell] += along * along;
                    all_xy[cell] += along * down;
                    all_yy[cell] += down * down;
                }
            }
            // Pixels in each 2 x 2 of a cell; those at the border may hold fewer.
            let down = (height - CELL * cell_y).min(CELL).div_ceil(2);
            for cell in 0..columns {
                let across = (width - CELL * cell).min(CELL).div_ceil(2);
                let share = ((down * across) as f32).recip();
                energies[cell] *= share;
                for products in [&mut *all_xx, &mut *all_xy, &mut *all_yy] {
                    // Of differences of pixels that are two apart.
                    products[cell] *= 0.25 * share;
                }
            }
        }
        Ok(())
    }

    /// The flow of the first pixel of each block that has one.
    fn read_flow(&mut self, field: &FlowField, (columns, rows): (usize, usize)) -> Result<()> {
        for (axis, flow) in self.flow.iter_mut().enumerate() {
            resize("a flow", flow, columns * rows, 0.0)?;
            for (y, flow) in flow.chunks_exact_mut(columns).enumerate() {
                let from = &field.uv[2 * y * BLOCK * field.width..][..2 * field.width];
                for (flow, pixels) in flow.iter_mut().zip(from.chunks(2 * BLOCK)) {
                    let mut known = pixels[axis..].iter().step_by(2);
                    *flow = known
                        .find(|value| !value.is_nan())
                        .copied()
                        .unwrap_or(f32::NAN);
                }
            }
        }
        Ok(())
    }
}

/// A sixth of the squared second difference of each block along an axis, 0 for x, at the border that of the nearest block
/// that has both others. Where the frame or what counts of it does not reach [`APART`] blocks, blocks that are nearer are
/// taken: less shows there, and counts for more. NaN where there are none.
fn second_differences(
    flow: &[f32],
    (columns, rows): (usize, usize),
    axis: usize,
    squares: &mut Vec<f32>,
) -> Result<()> {
    resize("second differences", squares, columns * rows, 0.0)?;
    let (size, step) = if axis == 0 {
        (columns, 1)
    } else {
        (rows, columns)
    };
    let farthest = APART.min((size - 1) / 2);
    for (index, square) in squares[..columns * rows].iter_mut().enumerate() {
        let place = index / step % size;
        *square = (1..=farthest)
            .rev()
            .map(|apart| {
                let inside = place.clamp(apart, size - 1 - apart);
                let at = index + inside * step - place * step;
                let second = flow[at + apart * step] + flow[at - apart * step] - 2.0 * flow[at];
                // Errors of three places that do not depend on each other have 6 times the variance of one.
                second * second / 6.0 * (APART / apart) as f32
            })
            .find(|square| square.is_finite())
            .unwrap_or(f32::NAN);
    }
    Ok(())
}

/// The mean of both axes in such a way that what shows along one alone, an edge, counts little; where one is not known the
/// other, where neither is a guess.
fn both_axes(x: f32, y: f32) -> f32 {
    match (x.is_nan(), y.is_nan()) {
        (false, false) => (x * y).sqrt(),
        (true, false) => y,
        (false, true) => x,
        (true, true) => UNKNOWN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_affine_flow_has_no_second_differences_and_an_edge_has_them_along_one_axis() {
        let (columns, rows) = (40, 30);
        let affine: Vec<f32> = (0..columns * rows)
            .map(|k| 0.5 * (k % columns) as f32 - 0.25 * (k / columns) as f32)
            .collect();
        let edge: Vec<f32> = (0..columns * rows)
            .map(|k| if k % columns < 17 { 0.0 } else { 3.0 })
            .collect();
        let mut squares = Vec::new();
        let mut holed = affine.clone();
        for index in (0..columns * rows).filter(|k| k % columns % 3 == 0) {
            holed[index] = f32::NAN;
        }
        for axis in [0, 1] {
            // Blocks that are 4 apart are not all known anywhere, those that are 3 apart are.
            second_differences(&holed, (columns, rows), axis, &mut squares).unwrap();
            let known = squares.iter().filter(|square| !square.is_nan());
            assert!(known.clone().count() > columns * rows / 2);
            assert!(known.into_iter().all(|square| *square < 1e-9));
            second_differences(&affine, (columns, rows), axis, &mut squares).unwrap();
            assert!(squares.iter().all(|square| *square < 1e-9));
            second_differences(&edge, (columns, rows), axis, &mut squares).unwrap();
            assert_eq!(squares.iter().any(|square| *square > 1.0), axis == 0);
        }
    }

    #[test]
    fn two_blocks_do_not_tell() {
        let mut squares = Vec::new();
        second_differences(&[1.0, 2.0], (2, 1), 0, &mut squares).unwrap();
        assert!(squares.iter().all(|square| square.is_nan()));
        assert_eq!(both_axes(f32::NAN, f32::NAN), UNKNOWN);
        assert_eq!(
            [
                both_axes(4.0, 9.0),
                both_axes(f32::NAN, 9.0),
                both_axes(4.0, f32::NAN)
            ],
            [6.0, 9.0, 4.0]
        );
    }
}
