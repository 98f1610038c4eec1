//! A second try for the points that the way down the levels has lost: from where their neighbours went, and from
//! where the frame or a tile of it went as a whole.
//!
//! A coarse window straddles motion and shadow edges, and takes in only so much motion. What a neighbour or a
//! correlation offers instead is only a start: the point is tracked from it, and judged like any other.
//!
//! `docs/explanation/algorithms.md`, section "A second try".

use crate::displacement_hypotheses::Hypotheses;
use crate::error::Result;
use crate::memory::{replace, reserve, resize};
use crate::parallel::{RowsMut, for_each_band};
use crate::track::affine::Deformed;
use crate::track::neighbours::{Grid, NEIGHBOURS};
use crate::track::options::POINTS;
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::problem::{self, Problem};
use crate::track::repetition::Repetition;

/// Rounds in which found points help their neighbours: each carries a motion on by a few points.
const ROUNDS: usize = 8;

/// Candidates tried for one point.
pub(crate) const MAX_CANDIDATES: usize = 10;

/// Share of the points that must be lost before the frame is correlated.
const HYPOTHESES_SHARE: f32 = 0.1;

/// Where so many are lost, one of so many is tried first; one of so many of those must be found.
const SAMPLE: usize = 8;
const LEAST_FOUND: usize = 64;

/// Points that one thread takes at least.
const MIN_POINTS: usize = 8;

/// Memory that is kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    pending: Vec<u32>,
    /// All that are pending while some of them are tried.
    waiting: Vec<u32>,
    results: Vec<TrackedPoint>,
    /// Whether the last round has found each point.
    fresh: Vec<bool>,
    pub(super) grid: Grid,
    pub(super) repetition: Repetition,
    hypotheses: Hypotheses,
    pub(super) deformed: Deformed,
}

impl Workspace {
    /// Make room for so many points.
    pub(crate) fn reserve(&mut self, points: usize) -> Result<()> {
        reserve(POINTS, &mut self.pending, points)?;
        reserve(POINTS, &mut self.waiting, points)?;
        reserve(POINTS, &mut self.results, points)?;
        reserve(POINTS, &mut self.fresh, points)?;
        self.repetition.reserve(points)?;
        self.grid.reserve(points)?;
        self.deformed.reserve(points)
    }

    /// Try the lost ones of `tracks` again.
    pub(crate) fn retry(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) -> Result<()> {
        self.pending.clear();
        reserve(POINTS, &mut self.pending, points.len())?;
        let mut found = 0usize;
        for (index, (track, point)) in tracks.iter().zip(points).enumerate() {
            found += usize::from(track.is_valid());
            if track.status.is_retryable() && problem.holds(*point) {
                self.pending.push(index as u32);
            }
        }
        if self.pending.is_empty() {
            return Ok(());
        }
        let execution = &problem.options.execution;
        self.hypotheses.clear();
        let lost = self.pending.len() as f32;
        if lost >= HYPOTHESES_SHARE * (lost + found as f32) {
            self.hypotheses = Hypotheses::find(problem.prev, problem.next, execution)?;
        }
        if lost >= HYPOTHESES_SHARE * (lost + found as f32)
            && !self.is_promising(problem, points, tracks)?
        {
            return Ok(());
        }
        for round in 0..ROUNDS {
            let new = self.round(problem, points, tracks, round == 0)?;
            if new == 0 || self.pending.is_empty() {
                break;
            }
        }
        Ok(())
    }

    /// Try some of the many that are lost; whether so many are found that the others are worth it. Between frames that
    /// have nothing in common, or where the light changes more than the model knows, all tries would be in vain.
    fn is_promising(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) -> Result<bool> {
        if self.pending.len() < SAMPLE * SAMPLE {
            return Ok(true);
        }
        std::mem::swap(&mut self.pending, &mut self.waiting);
        let some = self.waiting.iter().step_by(SAMPLE).copied();
        replace(POINTS, &mut self.pending, some)?;
        let tried = self.pending.len();
        let new = self.round(problem, points, tracks, true)?;
        std::mem::swap(&mut self.pending, &mut self.waiting);
        self.pending
            .retain(|index| !tracks[*index as usize].is_valid());
        Ok(new * LEAST_FOUND >= tried)
    }

    /// Try each pending point from where its neighbours went and, in the first round, where the displacement hypotheses
    /// point; in later ones only points of which a neighbour was found last. How many were found.
    fn round(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
        first: bool,
    ) -> Result<usize> {
        let seen: &[TrackedPoint] = tracks;
        self.grid
            .fill(problem.size(), points, |index| seen[index].is_valid())?;
        let (pending, hypotheses, grid) = (&self.pending, &self.hypotheses, &self.grid);
        let fresh = &self.fresh;
        self.results.clear();
        let lost = TrackedPoint::lost(PointStatus::HighResidual);
        resize(POINTS, &mut self.results, pending.len(), lost)?;
        for_each_band(
            &problem.options.execution,
            pending.len(),
            MIN_POINTS,
            RowsMut::new(&mut self.results, 1),
            |range, part| {
                problem::Workspace::with(|workspace| {
                    for (result, entry) in part.data.iter_mut().zip(range) {
                        let index = pending[entry] as usize;
                        let point = points[index];
                        let mut candidates = Candidates::default();
                        let mut new = first;
                        for (_, near) in grid.nearest::<NEIGHBOURS>(points, point) {
                            new = new || fresh[near];
                            let (from, to) = (points[near], seen[near].position);
                            candidates
                                .add([f64::from(to[0] - from[0]), f64::from(to[1] - from[1])]);
                        }
                        // What it was tried from before leads nowhere again.
                        if !new {
                            continue;
                        }
                        if first {
                            hypotheses.at(point).for_each(|start| candidates.add(start));
                        }
                        *result = problem.retrack(
                            point,
                            candidates.list(),
                            hypotheses.level(),
                            workspace,
                        );
                    }
                });
            },
        )?;
        self.fresh.clear();
        resize(POINTS, &mut self.fresh, points.len(), false)?;
        let mut kept = 0;
        for entry in 0..self.pending.len() {
            let index = self.pending[entry];
            let result = self.results[entry];
            if result.is_valid() {
                tracks[index as usize] = result;
                self.fresh[index as usize] = true;
            } else {
                self.pending[kept] = index;
                kept += 1;
            }
        }
        let new = self.pending.len() - kept;
        self.pending.truncate(kept);
        Ok(new)
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
