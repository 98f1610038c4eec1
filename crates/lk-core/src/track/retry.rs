//! A second try for the points that the way down the levels has lost: from where their neighbours went, and from
//! where the frame or a tile of it went as a whole.
//!
//! A coarse window straddles motion and shadow edges, and takes in only so much motion. What a neighbour or a
//! correlation offers instead is only a start: the point is tracked from it, and judged like any other.

use crate::error::Result;
use crate::parallel::{RowsMut, for_each_band};
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::seeds::Seeds;
use crate::track::solve::{Problem, Workspace};

/// Rounds in which found points help their neighbours: each carries a motion on by a few points.
const ROUNDS: usize = 8;

/// Neighbours asked.
const NEIGHBOURS: usize = 3;

/// Candidates tried for one point.
pub(crate) const MAX_CANDIDATES: usize = 10;

/// Cells that neighbours are sought in, on each side.
const RINGS: usize = 4;

/// Share of the points that must be lost before the frame is correlated.
const SEED_SHARE: f32 = 0.1;

/// Points that one thread takes at least.
const MIN_POINTS: usize = 8;

const NONE: u32 = u32::MAX;

/// Memory that is kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Memory {
    pending: Vec<u32>,
    results: Vec<TrackedPoint>,
    heads: Vec<u32>,
    links: Vec<u32>,
    seeds: Seeds,
}

/// The tracked points by cell of a grid.
struct Grid<'a> {
    cell: f32,
    columns: usize,
    rows: usize,
    heads: &'a [u32],
    links: &'a [u32],
}

/// Whether another start could help.
fn is_hopeful(status: PointStatus) -> bool {
    matches!(
        status,
        PointStatus::OutOfFrame
            | PointStatus::NotConverged
            | PointStatus::HighResidual
            | PointStatus::ForwardBackward
    )
}

impl Memory {
    /// Try the lost ones of `tracks` again.
    pub(crate) fn retry(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) -> Result<()> {
        self.pending.clear();
        let mut found = 0usize;
        for (index, (track, point)) in tracks.iter().zip(points).enumerate() {
            found += usize::from(track.is_valid());
            if is_hopeful(track.status) && problem.holds(*point) {
                self.pending.push(index as u32);
            }
        }
        if self.pending.is_empty() {
            return Ok(());
        }
        let execution = &problem.options.execution;
        self.seeds.clear();
        let lost = self.pending.len() as f32;
        if lost >= SEED_SHARE * (lost + found as f32) {
            self.seeds = Seeds::find(problem.prev, problem.next, execution)?;
        }
        for round in 0..ROUNDS {
            let grid = Grid::new(problem, points, tracks, &mut self.heads, &mut self.links);
            let (pending, seeds) = (&self.pending, &self.seeds);
            let seen: &[TrackedPoint] = tracks;
            self.results.clear();
            self.results
                .resize(pending.len(), TrackedPoint::lost(PointStatus::HighResidual));
            for_each_band(
                execution,
                pending.len(),
                MIN_POINTS,
                RowsMut::new(&mut self.results, 1),
                |range, part| {
                    let mut workspace = Workspace::new();
                    for (result, entry) in part.data.iter_mut().zip(range) {
                        let index = pending[entry] as usize;
                        let point = points[index];
                        let mut candidates = Candidates::default();
                        grid.neighbours(points, seen, point, &mut candidates);
                        if round == 0 {
                            seeds.at(point).for_each(|seed| candidates.add(seed));
                        }
                        *result = problem.retrack(
                            point,
                            candidates.list(),
                            seeds.level(),
                            &mut workspace,
                        );
                    }
                },
            )?;
            let mut kept = 0;
            for entry in 0..self.pending.len() {
                let index = self.pending[entry];
                let result = self.results[entry];
                if result.is_valid() {
                    tracks[index as usize] = result;
                } else {
                    self.pending[kept] = index;
                    kept += 1;
                }
            }
            let new = self.pending.len() - kept;
            self.pending.truncate(kept);
            if new == 0 || kept == 0 {
                break;
            }
        }
        Ok(())
    }
}

/// Displacements to start from, without repetition.
#[derive(Debug, Default)]
struct Candidates {
    list: [[f64; 2]; MAX_CANDIDATES],
    count: usize,
}

impl Candidates {
    fn add(&mut self, [x, y]: [f64; 2]) {
        // Starts within a pixel of each other lead to the same place.
        let known = self
            .list()
            .iter()
            .any(|[other_x, other_y]| (x - other_x).abs() < 1.0 && (y - other_y).abs() < 1.0);
        if !known && self.count < MAX_CANDIDATES {
            self.list[self.count] = [x, y];
            self.count += 1;
        }
    }

    fn list(&self) -> &[[f64; 2]] {
        &self.list[..self.count]
    }
}

impl<'a> Grid<'a> {
    fn new(
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &[TrackedPoint],
        heads: &'a mut Vec<u32>,
        links: &'a mut Vec<u32>,
    ) -> Self {
        let (width, height) = problem.size();
        let found = tracks.iter().filter(|track| track.is_valid()).count();
        // About one point a cell.
        let cell = ((width * height) as f32 / found.max(1) as f32)
            .sqrt()
            .max(1.0);
        let columns = (width as f32 / cell).ceil().max(1.0) as usize;
        let rows = (height as f32 / cell).ceil().max(1.0) as usize;
        heads.clear();
        heads.resize(columns * rows, NONE);
        links.clear();
        links.resize(points.len(), NONE);
        for (index, track) in tracks.iter().enumerate() {
            if track.is_valid() {
                let [x, y] = points[index];
                let column = ((x / cell) as usize).min(columns - 1);
                let row = ((y / cell) as usize).min(rows - 1);
                let head = &mut heads[row * columns + column];
                links[index] = *head;
                *head = index as u32;
            }
        }
        Self {
            cell,
            columns,
            rows,
            heads,
            links,
        }
    }

    /// Add the displacements of the points nearest to `point`.
    fn neighbours(
        &self,
        points: &[[f32; 2]],
        tracks: &[TrackedPoint],
        point: [f32; 2],
        candidates: &mut Candidates,
    ) {
        let mut nearest = [(f32::INFINITY, 0usize); NEIGHBOURS];
        let column = ((point[0] / self.cell) as usize).min(self.columns - 1);
        let row = ((point[1] / self.cell) as usize).min(self.rows - 1);
        for y in row.saturating_sub(RINGS)..(row + RINGS + 1).min(self.rows) {
            for x in column.saturating_sub(RINGS)..(column + RINGS + 1).min(self.columns) {
                let mut link = self.heads[y * self.columns + x];
                while link != NONE {
                    let index = link as usize;
                    let (dx, dy) = (points[index][0] - point[0], points[index][1] - point[1]);
                    let distance = dx * dx + dy * dy;
                    if distance < nearest[NEIGHBOURS - 1].0 {
                        let place = nearest.partition_point(|entry| entry.0 <= distance);
                        nearest[place..].rotate_right(1);
                        nearest[place] = (distance, index);
                    }
                    link = self.links[index];
                }
            }
        }
        for (distance, index) in nearest {
            if distance.is_finite() {
                let (from, to) = (points[index], tracks[index].position);
                candidates.add([f64::from(to[0] - from[0]), f64::from(to[1] - from[1])]);
            }
        }
    }
}
