//! The other displacements that explain a point's window as well as the found one.

use super::evidence::Verdict;
use super::lags::{Half, MAX_LAGS};
use crate::track::options::TrackedPoint;
use crate::track::problem::{Problem, Workspace};

/// Share of a lag by which two displacements may differ that are the same.
pub(super) const SAME: f64 = 1.0 / 3.0;

/// What another displacement may leave in the window, as a share of what the found one leaves, and as one of the window's
/// own variance: the pixels between the samples differ a little from period to period.
const EXPLAINS_RATIO: f64 = 1.5;
const EXPLAINS_SHARE: f64 = 0.002;

/// Other displacements of one point: along each lag and against it.
pub(super) const MAX_OTHERS: usize = 2 * MAX_LAGS;

/// Another displacement that explains the window as well, from the found one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Other {
    pub(super) lag: [f64; 2],
    pub(super) verdict: Verdict,
    /// What the pixels around say that are not of the pattern.
    pub(super) rest: Verdict,
}

impl Other {
    pub(super) fn length(&self) -> f64 {
        self.lag[0].hypot(self.lag[1])
    }
}

/// All of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Others {
    pub(super) list: [Other; MAX_OTHERS],
    pub(super) count: usize,
}

impl Others {
    pub(super) const NONE: Self = Self {
        list: [Other {
            lag: [0.0; 2],
            verdict: Verdict::Open,
            rest: Verdict::Open,
        }; MAX_OTHERS],
        count: 0,
    };

    pub(super) fn list(&self) -> &[Other] {
        &self.list[..self.count]
    }

    pub(super) fn is_open(&self) -> bool {
        self.list()
            .iter()
            .any(|other| other.verdict == Verdict::Open)
    }

    /// Whether `lag`, to within `limit`, has this verdict.
    pub(super) fn has(&self, lag: [f64; 2], limit: f64, verdict: Verdict) -> bool {
        self.list().iter().any(|other| {
            other.verdict == verdict && (other.lag[0] - lag[0]).hypot(other.lag[1] - lag[1]) < limit
        })
    }

    pub(super) fn is_ambiguous(&self) -> bool {
        self.list()
            .iter()
            .any(|other| other.verdict != Verdict::Excluded)
    }
}

/// How much the surroundings of a point may differ from themselves a lag away where the found displacement leaves this
/// share of the window's variance: another one that explains the window as well is so near to it at most.
pub(super) fn alike(unexplained: f32) -> f32 {
    let other = EXPLAINS_RATIO as f32 * unexplained + EXPLAINS_SHARE as f32;
    let apart = unexplained.sqrt() + other.sqrt();
    0.5 * apart * apart
}

impl Problem<'_> {
    /// The displacements other than that of `track` that explain the window of `point` as well.
    pub(super) fn others(
        &self,
        point: [f32; 2],
        track: &TrackedPoint,
        workspace: &mut Workspace,
    ) -> Others {
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
                && left <= EXPLAINS_RATIO * residual * residual + EXPLAINS_SHARE * signal
                && !others.list().iter().any(near)
            {
                others.list[others.count].lag = lag;
                others.count += 1;
            }
        }
        others
    }
}
