//! What is known of points whose surroundings turn, grow or shear, and one round of tries for those that are open.

use crate::error::Result;
use crate::memory::{reserve, resize};
use crate::parallel::{RowsMut, for_each_band};
use crate::track::affine::align::Aligner;
use crate::track::affine::attempt::Outcome;
use crate::track::affine::search;
use crate::track::affine::warp::Warp;
use crate::track::neighbours::{Grid, NEIGHBOURS};
use crate::track::options::{POINTS, TrackedPoint};
use crate::track::problem::Problem;

/// Tries for one point.
pub(super) const MAX_TRIES: u8 = 3;

/// Cells along x and y in which a point is searched for where most are open.
pub(super) const CELLS: (usize, usize) = (6, 4);

/// Neighbours whose motion is fitted by an affine one.
pub(super) const FITTED: usize = 6;

/// Points that one thread takes at least.
const MIN_POINTS: usize = 2;

/// The index of no point.
pub(super) const NONE: u32 = u32::MAX;

/// What is known of one point.
#[derive(Debug, Clone, Copy)]
pub(super) struct State {
    /// How it moves, if it does.
    pub(super) warp: Option<Warp>,
    /// Whether that is a deformation found here.
    pub(super) deformed: bool,
    /// The track to go back to.
    pub(super) before: TrackedPoint,
    pub(super) tries: u8,
    /// Whether a neighbour's motion leads out of the frame.
    pub(super) leaves: bool,
    /// Neighbours that were followed last.
    pub(super) followed: [u32; NEIGHBOURS],
}

/// Memory that is kept from frame to frame.
#[derive(Debug, Default)]
pub(in crate::track) struct Deformed {
    pub(super) states: Vec<State>,
    pub(super) open: Vec<u32>,
    /// The open points while a few of them are searched for.
    pub(super) waiting: Vec<u32>,
    /// Those that are searched for where the first are found.
    pub(super) later: Vec<u32>,
    pub(super) found: Vec<Attempt>,
    pub(super) grid: Grid,
    pub(super) search: search::Workspace,
}

/// A try for one point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attempt {
    pub(super) tried: bool,
    pub(super) leaves: bool,
    pub(super) followed: [u32; NEIGHBOURS],
    pub(super) outcome: Outcome,
}

impl Deformed {
    /// Make room for so many points.
    pub(in crate::track) fn reserve(&mut self, points: usize) -> Result<()> {
        reserve(POINTS, &mut self.states, points)?;
        reserve(POINTS, &mut self.open, points)?;
        reserve(POINTS, &mut self.waiting, points)?;
        reserve(POINTS, &mut self.later, CELLS.0 * CELLS.1)?;
        reserve(POINTS, &mut self.found, points)?;
        self.grid.reserve(points)?;
        self.search.reserve()?;
        Aligner::with(|_| ());
        Ok(())
    }

    /// Try every open point and take what is found; how many were.
    pub(super) fn run(
        &mut self,
        problem: &Problem<'_>,
        tracks: &mut [TrackedPoint],
        take: &(impl Fn(&[State], &Grid, usize, &mut Aligner) -> Result<Attempt> + Sync),
    ) -> Result<usize> {
        let (open, states, grid) = (&self.open, &self.states, &self.grid);
        self.found.clear();
        let none = Attempt {
            tried: false,
            leaves: false,
            followed: [NONE; NEIGHBOURS],
            outcome: Outcome::Nothing,
        };
        resize(POINTS, &mut self.found, open.len(), none)?;
        for_each_band(
            &problem.options.execution,
            open.len(),
            MIN_POINTS,
            RowsMut::new(&mut self.found, 1),
            |range, part| {
                Aligner::with(|aligner| {
                    for (attempt, entry) in part.data.iter_mut().zip(range) {
                        *attempt = take(states, grid, open[entry] as usize, aligner)?;
                    }
                    Ok(())
                })
            },
        )?;
        let mut kept = 0;
        for entry in 0..self.open.len() {
            let index = self.open[entry];
            let attempt = self.found[entry];
            let state = &mut self.states[index as usize];
            state.tries = match attempt.outcome {
                Outcome::Settled => MAX_TRIES,
                _ => (state.tries + u8::from(attempt.tried)).min(MAX_TRIES),
            };
            state.leaves = attempt.leaves;
            state.followed = attempt.followed;
            if let Outcome::Found(found) = attempt.outcome {
                state.warp = Some(found.warp);
                state.deformed = true;
                tracks[index as usize] = found.track;
            } else {
                self.open[kept] = index;
                kept += 1;
            }
        }
        let new = self.open.len() - kept;
        self.open.truncate(kept);
        Ok(new)
    }
}
