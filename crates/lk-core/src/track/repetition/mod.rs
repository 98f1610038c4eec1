//! Points on texture that repeats: where another displacement explains the window as well, and nothing around it tells
//! which one it was, nobody can.
//!
//! Where `prev` is like itself around a point says which other displacements there may be; each is tried on the finest
//! level. Of those that explain the window as well, pixels further away that only one of two explains decide: the border
//! of a board, a stain on a wall. What they say of one point holds for its neighbours on the same pattern too, as long as
//! none says otherwise. A point is ambiguous unless all other displacements are excluded.
//!
//! `docs/explanation/algorithms.md`, section "Repetition".

mod asking;
mod evidence;
mod lags;
mod others;

use crate::error::Result;
use crate::memory::{replace, reserve, resize};
use crate::parallel::{RowsMut, for_each_band};
use crate::track::neighbours::Grid;
use crate::track::options::POINTS;
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::problem::{Problem, Workspace};
use evidence::Verdict;
use lags::Half;
use others::{MAX_OTHERS, Other, Others, SAME, alike};

/// Neighbours asked, how far away at most, in windows, and how often what they say is passed on.
const NEIGHBOURS: usize = 12;
const REACH: f32 = 4.0;
const ROUNDS: usize = 64;

/// Neighbours that must say the same, and none the opposite: what one of them says may be chance.
const SAYING: usize = 2;

/// How far away, in windows, a neighbour is on whose pattern a point stands.
const BESIDE: f32 = 2.0;

/// How often a point is taken to a displacement that is favoured over the last one.
const MOVES: usize = 4;

/// Points that one thread takes at least.
const MIN_POINTS: usize = 4;

/// What is known of one point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Nothing, and nobody asks.
    Unasked,
    /// Nothing: it is one of those that are asked first.
    First,
    /// Nothing: where it was found is new.
    Unknown,
    /// What else explains its window, if it was tracked at all.
    Known,
    /// That it cannot be where it seems to be, nor tracked elsewhere.
    Stuck,
}

/// Memory that is kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Repetition {
    others: Vec<Others>,
    before: Vec<Others>,
    states: Vec<State>,
    /// Squares of the frame in which a point is asked first.
    taken: Vec<bool>,
    moved: Vec<Option<TrackedPoint>>,
}

impl Repetition {
    /// Make room for so many points.
    pub(super) fn reserve(&mut self, points: usize) -> Result<()> {
        reserve(POINTS, &mut self.others, points)?;
        reserve(POINTS, &mut self.before, points)?;
        reserve(POINTS, &mut self.states, points)?;
        reserve(POINTS, &mut self.moved, points)
    }

    /// Take back the points that may have gone elsewhere as well.
    pub(super) fn reject_ambiguous(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
        grid: &mut Grid,
    ) -> Result<()> {
        self.others.clear();
        resize(POINTS, &mut self.others, points.len(), Others::NONE)?;
        self.choose_first(problem, points, tracks)?;
        self.find_others(problem, points, tracks)?;
        if !self.others.iter().any(|others| others.count > 0) {
            return Ok(());
        }
        while self.ask_near(problem, points, grid)? {
            self.find_others(problem, points, tracks)?;
        }
        for _ in 0..MOVES {
            self.pass_on(problem, points, tracks, grid)?;
            if self.ask_rest() {
                self.pass_on(problem, points, tracks, grid)?;
            }
            if !self.follow(problem, points, tracks)? {
                break;
            }
            self.find_others(problem, points, tracks)?;
        }
        let mut rejected = std::mem::take(&mut self.moved);
        let ends = (0..points.len()).map(|index| {
            let track = &tracks[index];
            let reject = track.is_valid()
                && (self.others[index].is_ambiguous()
                    || self.slips(problem, points, tracks, grid, index));
            reject.then_some(TrackedPoint {
                residual: track.residual,
                forward_backward: track.forward_backward,
                ..TrackedPoint::lost(PointStatus::Ambiguous)
            })
        });
        replace(POINTS, &mut rejected, ends)?;
        for (track, end) in tracks.iter_mut().zip(&rejected) {
            if let Some(end) = end {
                *track = *end;
            }
        }
        self.moved = rejected;
        Ok(())
    }

    /// Whether a point moves like its neighbours on a pattern but for some of their lags: at the end of a pattern, what is
    /// beside it in the window makes one of several displacements look better than the others.
    fn slips(
        &self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &[TrackedPoint],
        grid: &Grid,
        index: usize,
    ) -> bool {
        let reach = BESIDE * problem.options.window_side() as f32;
        let own = tracks[index].displacement(points[index]);
        let (mut like, mut unlike) = (0, 0);
        for (distance, near) in grid.nearest::<NEIGHBOURS>(points, points[index]) {
            let others = &self.others[near];
            let tells = near != index && tracks[near].is_valid() && !others.is_ambiguous();
            if !tells || distance > reach * reach {
                continue;
            }
            let there = tracks[near].displacement(points[near]);
            let lags = others.list().iter().map(|other| other.lag);
            let least = lags
                .clone()
                .map(|[x, y]| x.hypot(y))
                .fold(f64::INFINITY, f64::min);
            let from = |[x, y]: [f64; 2]| (own[0] - there[0] - x).hypot(own[1] - there[1] - y);
            if from([0.0; 2]) < SAME * least {
                like += 1;
            } else if lags.clone().any(|lag| {
                let twice = lags
                    .clone()
                    .map(|other| [lag[0] + other[0], lag[1] + other[1]]);
                from(lag) < SAME * least || twice.into_iter().any(|lag| from(lag) < SAME * least)
            }) {
                unlike += 1;
            }
        }
        unlike > like
    }

    /// Find what else explains the windows of which that is unknown, and what the pixels around say of it.
    fn find_others(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &[TrackedPoint],
    ) -> Result<()> {
        let states = &self.states;
        for_each_band(
            &problem.options.execution,
            points.len(),
            MIN_POINTS,
            RowsMut::new(&mut self.others, 1),
            |range, part| {
                Workspace::with(|workspace| {
                    for (others, index) in part.data.iter_mut().zip(range) {
                        let (point, track) = (points[index], &tracks[index]);
                        let repeats = || {
                            let alike = alike(track.unexplained);
                            !problem.lags(point, alike, Half::Lower).list().is_empty()
                        };
                        match states[index] {
                            State::Unknown => {}
                            State::First if repeats() => {}
                            _ => continue,
                        }
                        *others = problem.others(point, track, workspace);
                        let found = track.displacement(point);
                        let there = *others;
                        let lags = there.list().iter().map(|other| other.lag);
                        problem.decide(point, found, lags, |place, evidence| {
                            let other = &mut others.list[place];
                            (other.verdict, other.rest) = (evidence.pattern, evidence.rest);
                        });
                    }
                });
            },
        )?;
        for state in &mut self.states {
            if matches!(state, State::Unknown | State::First) {
                *state = State::Known;
            }
        }
        Ok(())
    }

    /// Take points to the displacement that is favoured over theirs; whether any was taken.
    fn follow(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) -> Result<bool> {
        let (others, seen) = (&self.others, &*tracks);
        self.moved.clear();
        resize(POINTS, &mut self.moved, points.len(), None)?;
        let states = &self.states;
        for_each_band(
            &problem.options.execution,
            points.len(),
            MIN_POINTS,
            RowsMut::new(&mut self.moved, 1),
            |range, part| {
                Workspace::with(|workspace| {
                    for (moved, index) in part.data.iter_mut().zip(range) {
                        if states[index] == State::Stuck {
                            continue;
                        }
                        let favoured = others[index].list().iter();
                        let favoured = favoured.filter(|other| other.verdict == Verdict::Favoured);
                        let shorter = |a: &&Other, b: &&Other| a.length().total_cmp(&b.length());
                        let Some(Other { lag, .. }) = favoured.min_by(shorter) else {
                            continue;
                        };
                        let point = points[index];
                        let found = seen[index].displacement(point);
                        let start = [found[0] + lag[0], found[1] + lag[1]];
                        *moved = Some(problem.take(point, start, workspace));
                    }
                });
            },
        )?;
        let mut any = false;
        for ((state, track), moved) in self.states.iter_mut().zip(tracks).zip(&self.moved) {
            *state = match moved {
                Some(moved) if moved.is_valid() => {
                    any = true;
                    *track = *moved;
                    State::Unknown
                }
                Some(_) => State::Stuck,
                None => *state,
            };
        }
        Ok(any)
    }

    /// Where the pattern says nothing, what is around it does; whether that says anything.
    fn ask_rest(&mut self) -> bool {
        let mut says = false;
        for others in &mut self.others {
            let count = others.count;
            for other in &mut others.list[..count] {
                if other.verdict == Verdict::Open && other.rest != Verdict::Open {
                    other.verdict = other.rest;
                    says = true;
                }
            }
        }
        says
    }

    /// Let points tell their neighbours on the same pattern what is excluded and what is favoured.
    fn pass_on(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &[TrackedPoint],
        grid: &mut Grid,
    ) -> Result<()> {
        let others = &self.others;
        grid.fill(problem.size(), points, |index| others[index].count > 0)?;
        let reach = REACH * problem.options.window_side() as f32;
        for _ in 0..ROUNDS {
            replace(POINTS, &mut self.before, self.others.iter().copied())?;
            let before = &self.before;
            let mut changed = false;
            for (index, own) in self.others.iter_mut().enumerate() {
                if !own.is_open() {
                    continue;
                }
                let point = points[index];
                let found = tracks[index].displacement(point);
                let mut said = [[0usize; 2]; MAX_OTHERS];
                for (distance, near) in grid.nearest::<NEIGHBOURS>(points, point) {
                    if near == index || distance > reach * reach {
                        continue;
                    }
                    let there = tracks[near].displacement(points[near]);
                    let apart = [there[0] - found[0], there[1] - found[1]];
                    for (Other { lag, .. }, said) in own.list().iter().zip(&mut said) {
                        let limit = SAME * lag[0].hypot(lag[1]);
                        let same = |[x, y]: [f64; 2]| x.hypot(y) < limit;
                        if same(apart) {
                            let there = &before[near];
                            said[0] += usize::from(there.has(*lag, limit, Verdict::Excluded));
                            said[1] += usize::from(there.has(*lag, limit, Verdict::Favoured));
                        }
                    }
                }
                let count = own.count;
                for (other, said) in own.list[..count].iter_mut().zip(said) {
                    let clear = said[0].min(said[1]) == 0 && said[0].max(said[1]) >= SAYING;
                    if other.verdict == Verdict::Open && clear {
                        changed = true;
                        other.verdict = if said[0] > 0 {
                            Verdict::Excluded
                        } else {
                            Verdict::Favoured
                        };
                    }
                }
            }
            if !changed {
                break;
            }
        }
        Ok(())
    }
}
