//! Points on texture that repeats: where another displacement explains the window as well, nobody can tell which it was.

use crate::error::Result;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};
use crate::simd::{Kernel, dispatch};
use crate::track::POINTS;
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::solve::{Problem, Workspace};

/// One point of so many is asked first whether any texture repeats.
const SAMPLE: usize = 8;

/// A displacement is told from another that is at least so many times as long: of a motion below a third of the period
/// the others are, on a board too, whose fields repeat along the diagonals.
const LONGER: f64 = 1.5;

/// Side of the patch that is compared with its surroundings, and how far from its place, in pixels of a level.
const SIDE: usize = 13;
const REACH: usize = 16;
const LAGS: usize = 2 * REACH + 1;

/// The shortest period that is looked for, in pixels of the level.
const LEAST_LAG: isize = 3;

/// Mean square difference of two patches, as a share of twice their variance, below which one may be the other.
const LEAST_ALIKE: f32 = 0.25;

/// Places looked at more closely.
const PLACES: usize = 3;

/// What another displacement may leave in the window, as a share of what the found one leaves, and as one of the window's
/// own variance: the pixels between the samples differ a little from period to period.
const AS_WELL: f64 = 1.5;
const AS_WELL_SHARE: f64 = 0.002;

/// Points that one thread takes at least.
const MIN_POINTS: usize = 4;

/// Take back the points that may have gone elsewhere as well.
pub(super) fn reject_ambiguous(
    problem: &Problem<'_>,
    points: &[[f32; 2]],
    tracks: &mut [TrackedPoint],
    found: &mut Vec<bool>,
) -> Result<()> {
    let mut valid = 0usize;
    let seen = &*tracks;
    let sampled = |index: &usize| {
        let take = seen[*index].is_valid() && valid.is_multiple_of(SAMPLE);
        valid += usize::from(seen[*index].is_valid());
        take
    };
    let repeats = Workspace::with(|workspace| {
        (0..points.len())
            .filter(sampled)
            .any(|index| problem.is_ambiguous(points[index], &seen[index], workspace))
    });
    if !repeats {
        return Ok(());
    }
    found.clear();
    resize(POINTS, found, points.len(), false)?;
    for_each_band(
        &problem.options.execution,
        points.len(),
        MIN_POINTS,
        RowsMut::new(found, 1),
        |range, part| {
            Workspace::with(|workspace| {
                for (found, index) in part.data.iter_mut().zip(range) {
                    *found = seen[index].is_valid()
                        && problem.is_ambiguous(points[index], &seen[index], workspace);
                }
            });
        },
    )?;
    for (track, _) in tracks.iter_mut().zip(found).filter(|(_, found)| **found) {
        *track = TrackedPoint {
            residual: track.residual,
            forward_backward: track.forward_backward,
            ..TrackedPoint::lost(PointStatus::Ambiguous)
        };
    }
    Ok(())
}

impl Problem<'_> {
    /// Whether a displacement that is not much longer than that of `track` explains the window of `point` as well.
    fn is_ambiguous(
        &self,
        point: [f32; 2],
        track: &TrackedPoint,
        workspace: &mut Workspace,
    ) -> bool {
        let own = track.displacement(point);
        let length = own[0].hypot(own[1]);
        // Another one of that length is at most so far away.
        let reach = (1.0 + LONGER) * length;
        let longest = self
            .options
            .max_displacement
            .map_or(f64::INFINITY, f64::from);
        if reach < LEAST_LAG as f64 {
            return false;
        }
        let Some(level) =
            (0..self.prev.len()).find(|level| reach / f64::from(1u32 << *level) <= REACH as f64)
        else {
            return false;
        };
        let factor = f64::from(1u32 << level);
        let centre = point.map(|coordinate| (f64::from(coordinate) / factor).round() as isize);
        let plane = &self.prev[level];
        let half = (SIDE / 2) as isize;
        let fits = |x: isize, y: isize| {
            x >= half
                && y >= half
                && x + half < plane.width() as isize
                && y + half < plane.height() as isize
        };
        if !fits(centre[0], centre[1]) {
            return false;
        }
        let reach = ((reach / factor).ceil() as isize).min(REACH as isize);
        let surface = dispatch(
            self.level,
            Differences {
                pixels: plane.data(),
                width: plane.width(),
                height: plane.height(),
                centre,
                reach,
            },
        );
        let Some(surface) = surface else { return false };
        let at = |dx: isize, dy: isize| {
            surface[(dy + REACH as isize) as usize][(dx + REACH as isize) as usize]
        };
        let mut places = [(f32::INFINITY, [0isize; 2]); PLACES];
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let value = at(dx, dy);
                let other = [own[0] + factor * dx as f64, own[1] + factor * dy as f64];
                let far = other[0].hypot(other[1]);
                let near = (-1..=1isize).flat_map(|y| (-1..=1isize).map(move |x| (dx + x, dy + y)));
                if value < places[PLACES - 1].0
                    && dx.abs().max(dy.abs()) >= LEAST_LAG
                    && far <= LONGER * length + factor
                    && near
                        .filter(|(x, y)| x.abs() <= reach && y.abs() <= reach)
                        .all(|(x, y)| at(x, y) >= value)
                {
                    let place = places.partition_point(|(other, _)| *other <= value);
                    places[place..].rotate_right(1);
                    places[place] = (value, [dx, dy]);
                }
            }
        }
        places
            .iter()
            .filter(|(value, _)| *value < LEAST_ALIKE)
            .any(|(_, lag)| {
                let start = [0, 1].map(|axis: usize| own[axis] + factor * lag[axis] as f64);
                let Some((other, left, signal)) = self.explains(point, start, workspace) else {
                    return false;
                };
                let residual = f64::from(track.residual);
                let far = other[0].hypot(other[1]);
                let apart = (other[0] - own[0]).hypot(other[1] - own[1]);
                apart >= 0.5 * LEAST_LAG as f64 * factor
                    && far < LONGER * length
                    && far <= longest
                    && left <= AS_WELL * residual * residual + AS_WELL_SHARE * signal
            })
    }
}

/// For each lag the mean square difference of the patch around `centre` and the one there, as a share of twice the patch's
/// variance.
struct Differences<'a> {
    pixels: &'a [f32],
    width: usize,
    height: usize,
    centre: [isize; 2],
    reach: isize,
}

impl Kernel for Differences<'_> {
    type Output = Option<[[f32; LAGS]; LAGS]>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let half = (SIDE / 2) as isize;
        let [x, y] = self.centre;
        let row = |y: isize| &self.pixels[y as usize * self.width..][..self.width];
        let (mut sum, mut squares) = (0.0f32, 0.0f32);
        let middle = row(y)[x as usize];
        for line in y - half..=y + half {
            for value in &row(line)[(x - half) as usize..=(x + half) as usize] {
                let value = value - middle;
                sum += value;
                squares += value * value;
            }
        }
        let energy = squares - sum * sum / (SIDE * SIDE) as f32;
        if !(energy.is_finite() && energy > 0.0) {
            return None;
        }
        let scale = 0.5 / energy;
        // Lags whose patch leaves the frame are none.
        let first = (-self.reach).max(half - x);
        let last = self.reach.min(self.width as isize - 1 - half - x);
        let mut surface = [[f32::INFINITY; LAGS]; LAGS];
        if last < first {
            return None;
        }
        let count = (last - first + 1) as usize;
        for dy in -self.reach..=self.reach {
            if y + dy < half || y + dy + half >= self.height as isize {
                continue;
            }
            let mut sums = [0.0f32; LAGS];
            for line in -half..=half {
                let own = &row(y + line)[(x - half) as usize..][..SIDE];
                let other = &row(y + dy + line)[(x - half + first) as usize..][..count + SIDE - 1];
                for (tap, own) in own.iter().enumerate() {
                    for (sum, other) in sums[..count].iter_mut().zip(&other[tap..]) {
                        let difference = other - own;
                        *sum += difference * difference;
                    }
                }
            }
            let start = (first + REACH as isize) as usize;
            let to = &mut surface[(dy + REACH as isize) as usize][start..][..count];
            for (to, sum) in to.iter_mut().zip(sums) {
                *to = sum * scale;
            }
        }
        Some(surface)
    }
}
