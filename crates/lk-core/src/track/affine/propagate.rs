//! A third try, for points whose surroundings turn, grow or shear too much for a displacement alone.
//!
//! A few of them are searched for under every rotation and scale; what they find leads to their neighbours, as an
//! affine motion that goes on beyond its window. Each point is judged by itself, and must agree with those around it.

use crate::error::Result;
use crate::memory::replace;
use crate::track::affine::align::Aligner;
use crate::track::affine::attempt::Starts;
use crate::track::affine::candidates::candidates;
use crate::track::affine::deformed::{Attempt, CELLS, Deformed, FITTED, MAX_TRIES, NONE, State};
use crate::track::affine::fit::Fit;
use crate::track::affine::search::Search;
use crate::track::affine::warp::Warp;
use crate::track::neighbours::{Grid, NEIGHBOURS};
use crate::track::options::{POINTS, TrackedPoint};
use crate::track::problem::Problem;

/// Rounds in which found points help their neighbours.
const ROUNDS: usize = 48;

/// How far a motion leads beyond its window, in windows.
const REACH: f32 = 5.0;

/// How often a point is searched for in each cell.
const SEARCHES: usize = 2;

/// Of the points that are searched for, so many come first.
const FIRST_CELLS: usize = 4;

/// The levels from which a neighbour's motion, and a point's own displacement, which is exact, are followed down.
const NEAR_LEVEL: usize = 1;
const OWN_LEVEL: usize = 0;

impl Deformed {
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
        self.follow(problem, points, tracks, reach)?;
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
            self.follow(problem, points, tracks, reach)?;
        }
        self.search = memory;
        self.confirm(problem, points, tracks)?;
        self.reject_partial(problem, points, tracks);
        Ok(())
    }

    /// Follow the motion of found points to their open neighbours, until nothing is found any more.
    fn follow(
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

    /// Leave open only a point of each cell whose points are mostly open: the one nearest to its middle that was tried
    /// least. The others wait.
    fn choose_searched(&mut self, (width, height): (usize, usize), points: &[[f32; 2]]) {
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
    }

    /// Search for a point of each cell whose points are mostly open; whether any was found.
    fn search(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
        search: &Search<'_>,
    ) -> Result<bool> {
        self.choose_searched(problem.size(), points);
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
}
