//! Points on texture that repeats: where another displacement explains the window as well, and nothing around it tells
//! which one it was, nobody can.
//!
//! Where `prev` is like itself around a point says which other displacements there may be; each is tried on the finest
//! level. Of those that explain the window as well, pixels further away that only one of two explains decide: the border
//! of a board, a stain on a wall. What they say of one point holds for its neighbours on the same pattern too, as long as
//! none says otherwise. A point is ambiguous unless all other displacements are excluded.

mod evidence;
mod lags;

use crate::error::Result;
use crate::memory::{replace, reserve, resize};
use crate::parallel::{RowsMut, for_each_band};
use crate::track::POINTS;
use crate::track::neighbours::Grid;
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::solve::{Problem, Workspace};
use evidence::Verdict;
use lags::{Half, MAX_LAGS};

/// One point of so many is asked first whether any texture repeats, and one in each square of so many windows a side.
const SAMPLE: usize = 10;
const SQUARE: f32 = 2.5;

/// What another displacement may leave in the window, as a share of what the found one leaves, and as one of the window's
/// own variance: the pixels between the samples differ a little from period to period.
const AS_WELL: f64 = 1.5;
const AS_WELL_SHARE: f64 = 0.002;

/// Share of a lag by which two displacements may differ that are the same.
const SAME: f64 = 1.0 / 3.0;

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

/// Other displacements of one point: along each lag and against it.
const MAX_OTHERS: usize = 2 * MAX_LAGS;

/// Another displacement that explains the window as well, from the found one.
#[derive(Debug, Clone, Copy)]
struct Other {
    lag: [f64; 2],
    verdict: Verdict,
    /// What the pixels around say that are not of the pattern.
    rest: Verdict,
}

impl Other {
    fn length(&self) -> f64 {
        self.lag[0].hypot(self.lag[1])
    }
}

/// All of them.
#[derive(Debug, Clone, Copy)]
struct Others {
    list: [Other; MAX_OTHERS],
    count: usize,
}

impl Others {
    const NONE: Self = Self {
        list: [Other {
            lag: [0.0; 2],
            verdict: Verdict::Open,
            rest: Verdict::Open,
        }; MAX_OTHERS],
        count: 0,
    };

    fn list(&self) -> &[Other] {
        &self.list[..self.count]
    }

    fn is_open(&self) -> bool {
        self.list()
            .iter()
            .any(|other| other.verdict == Verdict::Open)
    }

    /// Whether `lag`, to within `limit`, has this verdict.
    fn has(&self, lag: [f64; 2], limit: f64, verdict: Verdict) -> bool {
        self.list().iter().any(|other| {
            other.verdict == verdict && (other.lag[0] - lag[0]).hypot(other.lag[1] - lag[1]) < limit
        })
    }

    fn is_ambiguous(&self) -> bool {
        self.list()
            .iter()
            .any(|other| other.verdict != Verdict::Excluded)
    }
}

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
        self.look(problem, points, tracks)?;
        if !self.others.iter().any(|others| others.count > 0) {
            return Ok(());
        }
        while self.ask_near(problem, points, grid)? {
            self.look(problem, points, tracks)?;
        }
        for _ in 0..MOVES {
            self.pass_on(problem, points, tracks, grid)?;
            if self.ask_rest() {
                self.pass_on(problem, points, tracks, grid)?;
            }
            if !self.follow(problem, points, tracks)? {
                break;
            }
            self.look(problem, points, tracks)?;
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

    /// Choose which points are asked first: some of them, in as many parts of the frame as there are.
    fn choose_first(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &[TrackedPoint],
    ) -> Result<()> {
        let side = SQUARE * problem.options.window_side() as f32;
        let (width, height) = problem.size();
        let [columns, rows] = [width, height].map(|length| (length as f32 / side) as usize + 1);
        self.taken.clear();
        resize(POINTS, &mut self.taken, columns * rows, false)?;
        let taken = &mut self.taken;
        let mut due = SAMPLE - 1;
        let states = tracks.iter().zip(points).map(|(track, [x, y])| {
            if !track.is_valid() {
                return State::Known;
            }
            due += 1;
            let taken = &mut taken[(y / side) as usize * columns + (x / side) as usize];
            if due < SAMPLE || *taken {
                return State::Unasked;
            }
            *taken = true;
            due -= SAMPLE;
            State::First
        });
        replace(POINTS, &mut self.states, states)
    }

    /// Ask the points near those on texture that repeats; whether there are any that were not asked.
    fn ask_near(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        grid: &mut Grid,
    ) -> Result<bool> {
        let others = &self.others;
        grid.fill(problem.size(), points, |index| others[index].count > 0)?;
        let reach = BESIDE * problem.options.window_side() as f32;
        let mut any = false;
        for (state, point) in self.states.iter_mut().zip(points) {
            if *state == State::Unasked {
                let mut near = grid.nearest::<1>(points, *point);
                if near.any(|(distance, _)| distance < reach * reach) {
                    *state = State::Unknown;
                    any = true;
                }
            }
        }
        Ok(any)
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
    fn look(
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

/// How much the surroundings of a point may differ from themselves a lag away where the found displacement leaves this
/// share of the window's variance: another one that explains the window as well is so near to it at most.
fn alike(unexplained: f32) -> f32 {
    let other = AS_WELL as f32 * unexplained + AS_WELL_SHARE as f32;
    let apart = unexplained.sqrt() + other.sqrt();
    0.5 * apart * apart
}

impl Problem<'_> {
    /// The displacements other than that of `track` that explain the window of `point` as well.
    fn others(&self, point: [f32; 2], track: &TrackedPoint, workspace: &mut Workspace) -> Others {
        let mut others = Others::NONE;
        let lags = self.lags(point, alike(track.unexplained), Half::Both);
        if lags.list().is_empty() {
            return others;
        }
        let own = track.displacement(point);
        let residual = f64::from(track.residual);
        let longest = self
            .options
            .max_displacement
            .map_or(f64::INFINITY, f64::from);
        let both = lags
            .list()
            .iter()
            .flat_map(|lag| [*lag, lag.map(|part| -part)]);
        for lag in both {
            let length = lag[0].hypot(lag[1]);
            let start = [own[0] + lag[0], own[1] + lag[1]];
            if start[0].hypot(start[1]) > longest + SAME * length {
                continue;
            }
            let Some((other, left, signal)) = self.explains(point, start, workspace) else {
                continue;
            };
            let apart = (other[0] - start[0]).hypot(other[1] - start[1]);
            let lag = [other[0] - own[0], other[1] - own[1]];
            let near = |other: &Other| {
                (other.lag[0] - lag[0]).hypot(other.lag[1] - lag[1]) < SAME * length
            };
            if apart < SAME * length
                && other[0].hypot(other[1]) <= longest
                && left <= AS_WELL * residual * residual + AS_WELL_SHARE * signal
                && !others.list().iter().any(near)
            {
                others.list[others.count].lag = lag;
                others.count += 1;
            }
        }
        others
    }
}
