//! A third try, for points whose surroundings turn, grow or shear too much for a displacement alone.
//!
//! A few of them are searched for under every rotation and scale; what they find leads to their neighbours, as an
//! affine motion that goes on beyond its window. Each point is judged by itself, and must agree with those around it.

use crate::error::Result;
use crate::memory::{replace, reserve, resize};
use crate::parallel::{RowsMut, for_each_band};
use crate::track::affine::align::Aligner;
use crate::track::affine::attempt::{Outcome, Starts};
use crate::track::affine::candidates::candidates;
use crate::track::affine::fit::Fit;
use crate::track::affine::search::{Search, SearchMemory};
use crate::track::affine::warp::Warp;
use crate::track::consensus::{AGREEING, WITNESSES, agrees};
use crate::track::neighbours::{Grid, NEIGHBOURS};
use crate::track::options::POINTS;
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::solve::Problem;

/// Rounds in which found points help their neighbours, and tries for one point.
const ROUNDS: usize = 48;
const MAX_TRIES: u8 = 3;

/// How far a motion leads beyond its window, in windows.
const REACH: f32 = 5.0;

/// Cells along x and y in which a point is searched for where most are open, and how often.
const CELLS: (usize, usize) = (6, 4);
const SEARCHES: usize = 2;

/// Of the points that are searched for, so many come first.
const FIRST_CELLS: usize = 4;

/// Neighbours whose motion is fitted by an affine one.
const FITTED: usize = 6;

/// How far, in pixels, a window that lies partly outside may be from where the points around lead.
const MAX_SEPARATION: f64 = 0.5;

/// The levels from which a neighbour's motion, and a point's own displacement, which is exact, are followed down.
const NEAR_LEVEL: usize = 1;
const OWN_LEVEL: usize = 0;

/// Points that one thread takes at least.
const MIN_POINTS: usize = 2;

const NONE: u32 = u32::MAX;

/// What is known of one point.
#[derive(Debug, Clone, Copy)]
struct State {
    /// How it moves, if it does.
    warp: Option<Warp>,
    /// Whether that is a deformation found here.
    deformed: bool,
    /// The track to go back to.
    before: TrackedPoint,
    tries: u8,
    /// Whether a neighbour's motion leads out of the frame.
    leaves: bool,
    /// Neighbours that were followed last.
    followed: [u32; NEIGHBOURS],
}

/// Memory that is kept from frame to frame.
#[derive(Debug, Default)]
pub(in crate::track) struct Deformed {
    states: Vec<State>,
    open: Vec<u32>,
    /// The open points while a few of them are searched for.
    waiting: Vec<u32>,
    /// Those that are searched for where the first are found.
    later: Vec<u32>,
    found: Vec<Attempt>,
    grid: Grid,
    search: SearchMemory,
}

/// A try for one point.
#[derive(Debug, Clone, Copy)]
struct Attempt {
    tried: bool,
    leaves: bool,
    followed: [u32; NEIGHBOURS],
    outcome: Outcome,
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

    /// Look again for the points of `tracks` that are lost or doubtful.
    pub(in crate::track) fn find(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) -> Result<()> {
        if !candidates(problem, points, tracks, &mut self.grid, &mut self.open)? {
            return Ok(());
        }
        let state = |(track, point): (&TrackedPoint, &[f32; 2])| State {
            warp: track
                .is_valid()
                .then(|| Warp::shift(track.displacement(*point))),
            deformed: false,
            before: *track,
            tries: 0,
            leaves: false,
            followed: [NONE; NEIGHBOURS],
        };
        let states = tracks.iter().zip(points).map(state);
        replace(POINTS, &mut self.states, states)?;
        // What is doubtful leads nowhere.
        for index in &self.open {
            self.states[*index as usize].warp = None;
        }
        let side = problem.options.window_side() as f32;
        let reach = (REACH * side) * (REACH * side);
        self.spread(problem, points, tracks, reach)?;
        let mut memory = std::mem::take(&mut self.search);
        let search = Search::new(
            &mut memory,
            problem.prev,
            problem.next,
            problem.options.max_displacement,
            problem.level,
        )?;
        for _ in 0..SEARCHES {
            if !self.search(problem, points, tracks, &search)? {
                break;
            }
            self.spread(problem, points, tracks, reach)?;
        }
        self.search = memory;
        self.confirm(problem, points, tracks)?;
        self.reject_partial(problem, points, tracks);
        Ok(())
    }

    /// Follow the motion of found points to their open neighbours, until nothing is found any more.
    fn spread(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
        reach: f32,
    ) -> Result<()> {
        for round in 0..ROUNDS {
            let states = &self.states;
            self.grid
                .fill(problem.size(), points, |index| states[index].warp.is_some())?;
            let take = |states: &[State], grid: &Grid, index: usize, aligner: &mut Aligner| {
                let (point, state) = (points[index], &states[index]);
                let mut starts = Starts::new();
                let mut followed = [NONE; NEIGHBOURS];
                let mut leaves = state.leaves;
                if state.tries < MAX_TRIES {
                    let mut fresh = false;
                    let mut nearest = None;
                    let mut fit = Fit::default();
                    let near = grid.nearest::<FITTED>(points, point);
                    for (place, (distance, near)) in near.enumerate() {
                        let Some(warp) = states[near].warp else {
                            continue;
                        };
                        if place < NEIGHBOURS {
                            followed[place] = near as u32;
                        }
                        if distance > reach {
                            continue;
                        }
                        fresh |= place < NEIGHBOURS && !state.followed.contains(&(near as u32));
                        let from = points[near];
                        let offset = [from[0] - point[0], from[1] - point[1]].map(f64::from);
                        fit.add(offset, warp.shift);
                        if nearest.is_none() {
                            let moved = warp.moved(offset.map(|part| -part));
                            nearest = Some((moved, states[near].deformed));
                        }
                    }
                    // What the points around say together leads further than what one of them does.
                    let mut guesses = [fit.warp(), nearest.map(|(warp, _)| warp)];
                    if nearest.is_some_and(|(_, deformed)| deformed) {
                        guesses.swap(0, 1);
                    }
                    for warp in guesses.into_iter().flatten().filter(|_| fresh) {
                        let [x, y] = warp.shift.map(|part| part as f32);
                        if problem.holds([point[0] + x, point[1] + y]) {
                            starts.add(warp, NEAR_LEVEL);
                        } else {
                            leaves = true;
                        }
                    }
                    if round == 0 && state.tries == 0 && state.before.is_valid() {
                        starts.add(Warp::shift(state.before.displacement(point)), OWN_LEVEL);
                    }
                }
                Ok(Attempt {
                    tried: !starts.list().is_empty(),
                    leaves,
                    followed,
                    outcome: problem.deform(point, &state.before, starts.list(), aligner),
                })
            };
            let new = self.run(problem, tracks, &take)?;
            if new == 0 {
                break;
            }
        }
        Ok(())
    }

    /// Search for a point of each cell whose points are mostly open; whether any was found.
    fn search(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
        search: &Search<'_>,
    ) -> Result<bool> {
        let (width, height) = problem.size();
        let cell_of = |[x, y]: [f32; 2]| {
            let column = ((x / width as f32 * CELLS.0 as f32) as usize).min(CELLS.0 - 1);
            let row = ((y / height as f32 * CELLS.1 as f32) as usize).min(CELLS.1 - 1);
            row * CELLS.0 + column
        };
        let mut counts = [(0usize, 0usize); CELLS.0 * CELLS.1];
        for (state, point) in self.states.iter().zip(points) {
            if state.warp.is_some() {
                counts[cell_of(*point)].0 += 1;
            }
        }
        // The open point nearest to the middle of its cell that was tried least.
        let mut chosen = [(u8::MAX, f32::INFINITY, NONE); CELLS.0 * CELLS.1];
        for index in &self.open {
            let State { tries, leaves, .. } = self.states[*index as usize];
            if leaves {
                continue;
            }
            let point = points[*index as usize];
            let cell = cell_of(point);
            counts[cell].1 += 1;
            let middle = [
                ((cell % CELLS.0) as f32 + 0.5) * width as f32 / CELLS.0 as f32,
                ((cell / CELLS.0) as f32 + 0.5) * height as f32 / CELLS.1 as f32,
            ];
            let distance = (point[0] - middle[0]).hypot(point[1] - middle[1]);
            if (tries, distance) < (chosen[cell].0, chosen[cell].1) {
                chosen[cell] = (tries, distance, *index);
            }
        }
        std::mem::swap(&mut self.open, &mut self.waiting);
        self.open.clear();
        self.open.extend(
            chosen
                .iter()
                .zip(&counts)
                .filter(|((.., index), (known, open))| *index != NONE && open >= known)
                .map(|((.., index), _)| *index),
        );
        let take = |states: &[State], _: &Grid, index: usize, aligner: &mut Aligner| {
            let point = points[index];
            let mut starts = Starts::new();
            search.find(point, &mut aligner.copied, |warp| {
                starts.add(warp, search.level());
            })?;
            let state = &states[index];
            Ok(Attempt {
                tried: true,
                leaves: state.leaves,
                followed: state.followed,
                outcome: problem.deform(point, &state.before, starts.list(), aligner),
            })
        };
        let mut new = 0;
        if self.open.len() > FIRST_CELLS {
            // Some of them first, in all parts of the frame: where none is found, the others are not sought.
            self.later.clear();
            let step = self.open.len().div_ceil(FIRST_CELLS);
            let mut entry = 0;
            let later = &mut self.later;
            self.open.retain(|index| {
                entry += 1;
                let first = (entry - 1) % step == 0;
                if !first {
                    later.push(*index);
                }
                first
            });
            new += self.run(problem, tracks, &take)?;
            self.open.clear();
            if new > 0 {
                std::mem::swap(&mut self.open, &mut self.later);
            }
        }
        new += self.run(problem, tracks, &take)?;
        let states = &self.states;
        std::mem::swap(&mut self.open, &mut self.waiting);
        self.open
            .retain(|index| states[*index as usize].warp.is_none());
        Ok(new > 0)
    }

    /// Try every open point and take what is found; how many were.
    fn run(
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

    /// Take back what the points around do not confirm.
    fn confirm(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) -> Result<()> {
        let states = &self.states;
        self.grid
            .fill(problem.size(), points, |index| states[index].warp.is_some())?;
        for (index, point) in points.iter().enumerate() {
            let State { warp, deformed, .. } = self.states[index];
            let Some(warp) = warp.filter(|_| deformed) else {
                continue;
            };
            let agrees = |near: usize| {
                let from = points[near];
                let offset = [from[0] - point[0], from[1] - point[1]].map(f64::from);
                let expected = warp.displacement(offset);
                // The point itself is no witness.
                near != index
                    && self.states[near]
                        .warp
                        .is_some_and(|seen| agrees(expected, seen.shift, offset))
            };
            let near = self.grid.nearest::<WITNESSES>(points, *point);
            if near.filter(|(_, near)| agrees(*near)).count() < AGREEING {
                tracks[index] = self.states[index].before;
            }
        }
        Ok(())
    }

    /// Take back displacements of windows that lie partly outside, where the points around turn, grow or shear: they are
    /// those of the middle of what is left, not of the point.
    fn reject_partial(
        &self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) {
        let half = 0.5 * problem.options.window_side() as f32 + 1.0;
        let (width, height) = problem.size();
        let last = [width as f32 - 1.0, height as f32 - 1.0];
        let partial = |at: [f32; 2]| {
            (0..2).any(|axis: usize| at[axis] < half || at[axis] > last[axis] - half)
        };
        for (index, point) in points.iter().enumerate() {
            let track = &tracks[index];
            let plain = track.is_valid() && !self.states[index].deformed;
            if !plain || !(partial(*point) || partial(track.position)) {
                continue;
            }
            let mut fit = Fit::default();
            for (_, near) in self.grid.nearest::<FITTED>(points, *point) {
                let State { warp, deformed, .. } = self.states[near];
                if let Some(warp) = warp.filter(|_| deformed) {
                    let from = points[near];
                    fit.add(
                        [from[0] - point[0], from[1] - point[1]].map(f64::from),
                        warp.shift,
                    );
                }
            }
            let own = track.displacement(*point);
            let differs = |warp: Warp| {
                (warp.shift[0] - own[0]).hypot(warp.shift[1] - own[1]) > MAX_SEPARATION
            };
            if fit.warp().is_some_and(differs) {
                tracks[index] = TrackedPoint {
                    residual: track.residual,
                    forward_backward: track.forward_backward,
                    ..TrackedPoint::lost(PointStatus::HighResidual)
                };
            }
        }
    }
}
