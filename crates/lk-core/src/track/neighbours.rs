//! Points by the cell of a grid, to find those near a place.

use crate::error::Result;
use crate::memory::{reserve, resize};
use crate::track::options::POINTS;

/// Neighbours asked.
pub(super) const NEIGHBOURS: usize = 3;

/// Cells that neighbours are sought in, on each side.
const RINGS: usize = 4;

/// The index of no point: the end of a chain.
const NONE: u32 = u32::MAX;

/// Some of the points, about one a cell; memory is kept.
#[derive(Debug, Default)]
pub(super) struct Grid {
    cell: f32,
    columns: usize,
    rows: usize,
    /// The first point of each cell, and the next one after each point.
    heads: Vec<u32>,
    links: Vec<u32>,
}

impl Grid {
    /// Make room for so many points.
    pub(super) fn reserve(&mut self, points: usize) -> Result<()> {
        // About one cell a point; what is cut off at two borders makes it more.
        reserve(POINTS, &mut self.heads, 2 * points + 64)?;
        reserve(POINTS, &mut self.links, points)
    }

    /// Take the points for which `member` is true; they lie within `size`.
    pub(super) fn fill(
        &mut self,
        (width, height): (usize, usize),
        points: &[[f32; 2]],
        member: impl Fn(usize) -> bool,
    ) -> Result<()> {
        let found = (0..points.len()).filter(|index| member(*index)).count();
        self.cell = ((width * height) as f32 / found.max(1) as f32)
            .sqrt()
            .max(1.0);
        self.columns = (width as f32 / self.cell).ceil().max(1.0) as usize;
        self.rows = (height as f32 / self.cell).ceil().max(1.0) as usize;
        self.heads.clear();
        resize(POINTS, &mut self.heads, self.columns * self.rows, NONE)?;
        self.links.clear();
        resize(POINTS, &mut self.links, points.len(), NONE)?;
        for (index, point) in points.iter().enumerate() {
            if member(index) {
                let (column, row) = self.place(*point);
                let head = &mut self.heads[row * self.columns + column];
                self.links[index] = *head;
                *head = index as u32;
            }
        }
        Ok(())
    }

    fn place(&self, [x, y]: [f32; 2]) -> (usize, usize) {
        (
            ((x / self.cell) as usize).min(self.columns - 1),
            ((y / self.cell) as usize).min(self.rows - 1),
        )
    }

    /// The members nearest to `point`, and their squared distances; the nearest first.
    pub(super) fn nearest<const COUNT: usize>(
        &self,
        points: &[[f32; 2]],
        point: [f32; 2],
    ) -> impl Iterator<Item = (f32, usize)> + use<COUNT> {
        let mut nearest = [(f32::INFINITY, 0usize); COUNT];
        let (column, row) = self.place(point);
        for ring in 0..=RINGS {
            // Cells of this ring begin so far away.
            let gap = ring.saturating_sub(1) as f32 * self.cell;
            if nearest[COUNT - 1].0 <= gap * gap {
                break;
            }
            let (left, right) = (column.saturating_sub(ring), column + ring);
            let (top, bottom) = (row.saturating_sub(ring), row + ring);
            for y in top..(bottom + 1).min(self.rows) {
                let whole = ring == 0 || y + ring == row || y == bottom;
                let step = if whole { 1 } else { 2 * ring };
                let first = if whole || column >= ring { left } else { right };
                for x in (first..(right + 1).min(self.columns)).step_by(step) {
                    self.visit(points, point, y * self.columns + x, &mut nearest);
                }
            }
        }
        nearest
            .into_iter()
            .filter(|(distance, _)| distance.is_finite())
    }

    /// Take the points of a cell that are nearer than the last of `nearest`.
    fn visit(
        &self,
        points: &[[f32; 2]],
        point: [f32; 2],
        cell: usize,
        nearest: &mut [(f32, usize)],
    ) {
        let mut link = self.heads[cell];
        while link != NONE {
            let index = link as usize;
            let (dx, dy) = (points[index][0] - point[0], points[index][1] - point[1]);
            let distance = dx * dx + dy * dy;
            if nearest.last().is_some_and(|last| distance < last.0) {
                let place = nearest.partition_point(|entry| entry.0 <= distance);
                nearest[place..].rotate_right(1);
                nearest[place] = (distance, index);
            }
            link = self.links[index];
        }
    }
}
