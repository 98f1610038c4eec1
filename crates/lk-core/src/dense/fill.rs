//! Flow of windows that say nothing: that of what is around them.
//!
//! Steps leave windows without texture where they began, and smoothness fills them in slowly, as it takes the border of what
//! moves for an edge of motion. They take the flow of the nearest windows that say something, averaged over ever larger
//! squares until one does (push and pull; Gortler, Grzeszczuk, Szeliski and Cohen 1996), relative to the trend.
//!
//! `docs/explanation/algorithms.md`, section "Windows that say nothing".

use crate::error::Result;
use crate::memory::resize;

use super::padded_plane::{PAD, PaddedPlane, extend};
use super::sureness::Sureness;
use super::trend::Slopes;

/// Windows whose share is all but whole keep their flow.
const WHOLE: f32 = 0.99;

/// Ever coarser grids of a weight, 0 to 1, and the mean u and v.
#[derive(Debug, Default)]
pub(super) struct Fill {
    grids: Vec<Grid>,
}

#[derive(Debug, Default)]
struct Grid {
    width: usize,
    height: usize,
    cells: Vec<[f32; 3]>,
}

impl Fill {
    /// Fill in `flow` where `sureness`, on the same grid, is not whole; `slopes` are those of u and v from pixel to pixel.
    pub(super) fn spread(
        &mut self,
        flow: [&mut PaddedPlane; 2],
        sureness: &Sureness,
        slopes: Slopes,
    ) -> Result<()> {
        let [u, v] = flow;
        let (width, height) = (u.width(), u.height());
        let mut size = (width, height);
        let mut count = 1;
        while size != (1, 1) {
            size = (size.0.div_ceil(2), size.1.div_ceil(2));
            count += 1;
        }
        // Those of a larger level are kept.
        if self.grids.len() < count {
            self.grids.resize_with(count, Grid::default);
        }
        let plane = |axis: usize, x: usize, y: usize| {
            slopes[axis][0] * x as f32 + slopes[axis][1] * y as f32
        };
        let first = &mut self.grids[0];
        first.resize(width, height)?;
        for (y, (to, shares)) in first
            .cells
            .chunks_exact_mut(width)
            .zip(sureness.rows())
            .enumerate()
        {
            let (u, v) = (u.row(y), v.row(y));
            for (x, (to, share)) in to.iter_mut().zip(shares).enumerate() {
                *to = [*share, u[x] - plane(0, x, y), v[x] - plane(1, x, y)];
            }
        }
        for k in 1..count {
            let (finer, coarser) = self.grids.split_at_mut(k);
            coarser[0].gather(&finer[k - 1])?;
        }
        for k in (1..count).rev() {
            let (finer, coarser) = self.grids.split_at_mut(k);
            finer[k - 1].take(&coarser[0]);
        }
        for (y, cells) in self.grids[0].cells.chunks_exact(width).enumerate() {
            let (u, v) = (u.padded_mut(y), v.padded_mut(y));
            for (x, cell) in cells.iter().enumerate() {
                (u[PAD + x], v[PAD + x]) = (cell[1] + plane(0, x, y), cell[2] + plane(1, x, y));
            }
            extend(u, width);
            extend(v, width);
        }
        Ok(())
    }
}

impl Grid {
    fn resize(&mut self, width: usize, height: usize) -> Result<()> {
        (self.width, self.height) = (width, height);
        resize("cells of a flow", &mut self.cells, width * height, [0.0; 3])
    }

    /// Become half of `finer`: the weighted means of 2 x 2 cells.
    fn gather(&mut self, finer: &Self) -> Result<()> {
        self.resize(finer.width.div_ceil(2), finer.height.div_ceil(2))?;
        let pairs = finer.cells.chunks(2 * finer.width);
        for (to, rows) in self.cells.chunks_exact_mut(self.width).zip(pairs) {
            let (upper, lower) = rows.split_at(finer.width);
            for (x, to) in to.iter_mut().enumerate() {
                let mut sums = [0.0; 3];
                let columns = 2 * x..(2 * x + 2).min(finer.width);
                let lower = lower.get(columns.clone()).unwrap_or(&[]);
                for [weight, u, v] in upper[columns].iter().chain(lower) {
                    sums[0] += weight;
                    sums[1] += weight * u;
                    sums[2] += weight * v;
                }
                let scale = if sums[0] > 0.0 { 1.0 / sums[0] } else { 0.0 };
                *to = [sums[0].min(1.0), scale * sums[1], scale * sums[2]];
            }
        }
        Ok(())
    }

    /// Take from `coarser`, of half the size, what the weights leave.
    fn take(&mut self, coarser: &Self) {
        for (y, cells) in self.cells.chunks_exact_mut(self.width).enumerate() {
            let (above, below, down) = between(y, coarser.height);
            let rows =
                [above, below].map(|row| &coarser.cells[row * coarser.width..][..coarser.width]);
            for (x, [weight, u, v]) in cells.iter_mut().enumerate() {
                if *weight >= WHOLE {
                    continue;
                }
                let (left, right, along) = between(x, coarser.width);
                let [upper, lower] = rows.map(|row| {
                    let ([_, u, v], [_, more_u, more_v]) = (row[left], row[right]);
                    [u + along * (more_u - u), v + along * (more_v - v)]
                });
                let [mean_u, mean_v] =
                    [0, 1].map(|axis| upper[axis] + down * (lower[axis] - upper[axis]));
                *u = mean_u + *weight * (*u - mean_u);
                *v = mean_v + *weight * (*v - mean_v);
            }
        }
    }
}

/// The two cells of a grid of `size`, half as many, between whose centres the centre of cell `at` lies, and how far along.
fn between(at: usize, size: usize) -> (usize, usize, f32) {
    let (first, second, share) = if at.is_multiple_of(2) {
        ((at / 2).saturating_sub(1), at / 2, 0.75)
    } else {
        (at / 2, at / 2 + 1, 0.25)
    };
    (first, second.min(size - 1), share)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid whose cells have a weight, and values of a plane where they have one.
    fn grid(width: usize, height: usize, weight: impl Fn(usize, usize) -> f32) -> Grid {
        let mut grid = Grid::default();
        grid.resize(width, height).unwrap();
        for y in 0..height {
            for x in 0..width {
                let weight = weight(x, y);
                let value = if weight > 0.0 { 3.0 } else { 99.0 };
                grid.cells[y * width + x] = [weight, value, -value];
            }
        }
        grid
    }

    fn filled(mut first: Grid) -> Grid {
        if (first.width, first.height) == (1, 1) {
            return first;
        }
        let mut half = Grid::default();
        half.gather(&first).unwrap();
        let half = filled(half);
        first.take(&half);
        first
    }

    #[test]
    fn what_says_nothing_takes_what_is_around() {
        for (width, height) in [(1, 7), (2, 2), (13, 8), (64, 37)] {
            let one = filled(grid(width, height, |x, y| f32::from(u8::from(x + y == 0))));
            let few = filled(grid(width, height, |x, y| {
                if (x + 2 * y) % 5 == 0 { 0.3 } else { 0.0 }
            }));
            for [_, u, v] in one.cells.iter().chain(&few.cells) {
                assert!(
                    (u - 3.0).abs() < 1e-5 && (v + 3.0).abs() < 1e-5,
                    "{width} {height}: {u} {v}"
                );
            }
        }
    }

    #[test]
    fn what_is_sure_stays() {
        let mut first = grid(9, 5, |_, _| 1.0);
        for (k, cell) in first.cells.iter_mut().enumerate() {
            cell[1] = k as f32;
        }
        let before = first.cells.clone();
        assert_eq!(filled(first).cells, before);
    }

    #[test]
    fn cells_lie_between_those_of_half_the_size() {
        // Centres of cells 0 to 5 in cells of half the size: -0.25, 0.25, 0.75, 1.25, 1.75, 2.25.
        let found = [0, 1, 2, 3, 4, 5].map(|at| between(at, 3));
        let want = [
            (0, 0, 0.75),
            (0, 1, 0.25),
            (0, 1, 0.75),
            (1, 2, 0.25),
            (1, 2, 0.75),
            (2, 2, 0.25),
        ];
        assert_eq!(found, want);
    }
}
