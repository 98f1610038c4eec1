//! Parallax: what a scene with depth does when the camera travels, told from things that move.
//!
//! Against the motion of a plane, everything that stands still moves along lines through one point, the epipole (M.
//! Irani and P. Anandan, "A unified approach to moving object detection in 2D and 3D scenes", PAMI 1998). Two things
//! that move by themselves always have such a point as well, and vectors that are barely off the plane agree with many:
//! what counts is by how much more things agree than their directions would by chance, whether the plane's own motion
//! says that the camera travelled that way and as far, and that this goes on.

use super::MotionVector;
use super::agreement::{Agreement, Candidate, agreement};
use super::camera::{CameraModel, CameraMotion};
use super::epipole::{Line, Point, crossing, dot, nearest, normalised, toward};
use super::things::Things;
use super::travel::Travel;

/// A camera whose picture moves less than this, in pixels, does not travel.
const LEAST_TRAVEL_PX: f64 = 0.3;
/// How much of what one frame says is taken over into the belief, and the most that one frame can say.
const GAIN: f64 = 0.5;
const MOST_SAID: f64 = 4.0;
/// What fades of a belief in a frame that says nothing.
const FADING: f64 = 0.98;
/// Logarithms of the odds at which depth begins and ceases to be believed.
const BELIEVED: f64 = 1.5;
const DOUBTED: f64 = 0.3;
/// Which way still things move is remembered for about ten frames; it is known from so many things, where at most this
/// share as many moved the other way.
const MEMORY: f64 = 0.9;
const SIGN_THINGS: f64 = 3.0;
const SIGN_SHARE: f64 = 0.34;
/// The largest things whose lines are crossed for candidates.
const CROSSED: usize = 14;
/// Standard deviations of a refined epipole, as an angle, around where the plane's motion and the frame before have it.
const BY_PLANE_STD: f64 = 0.1;
const BEFORE_STD: f64 = 0.05;

/// What is believed of the parallax of a scene. Give it back with the next frame: the belief grows and fades over frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parallax {
    /// The epipole in `next`, homogeneous and of unit length. `epipole.xy - epipole.w * place` points towards it.
    pub epipole: [f64; 3],
    /// Which way still things move against the plane: 1 away from the epipole, -1 towards it; none where both were seen
    /// or too few.
    pub sign: Option<f64>,
    /// Logarithm of the odds that the scene has depth, over the frames so far.
    pub belief: f64,
    /// Whether it is believed for this frame: else nothing is to be explained by depth.
    pub believed: bool,
    /// Things seen lately that moved away from the epipole, and towards it.
    pub seen: [f64; 2],
}

impl Parallax {
    /// The part of a residual motion, `next` against the plane, at a place of `next` that depth cannot explain: what is
    /// across the line to the epipole, and all of it where it is along the line in the impossible direction.
    #[must_use]
    #[inline]
    pub fn unexplained(&self, place: [f64; 2], residual: [f64; 2]) -> [f64; 2] {
        if !self.believed {
            return residual;
        }
        let toward = toward(&self.epipole, place);
        let square = toward[0] * toward[0] + toward[1] * toward[1];
        if square < 1e-18 {
            return [0.0; 2];
        }
        let along = (residual[0] * toward[0] + residual[1] * toward[1]) / square;
        if self.sign.is_some_and(|sign| sign * along > 0.0) {
            return residual;
        }
        [
            residual[0] - along * toward[0],
            residual[1] - along * toward[1],
        ]
    }

    /// The same belief, a little less, of a frame that says nothing.
    fn faded(mut self, believed: bool) -> Self {
        self.belief *= FADING;
        self.believed = believed;
        self
    }
}

/// Look for parallax among vectors that a camera's motion does not explain; none before there was anything to tell.
#[must_use]
pub fn find_parallax(
    vectors: &[MotionVector],
    camera: &CameraMotion,
    before: Option<&Parallax>,
) -> Option<Parallax> {
    if camera.model == CameraModel::None || !vectors.iter().any(MotionVector::usable) {
        return before.map(|before| before.faded(false));
    }
    let things = Things::of(vectors, camera);
    let travel = Travel::of(camera, &things);
    let was = before.is_some_and(|before| before.believed || before.belief > BELIEVED);
    if things.count == 0 {
        return before.map(|before| before.faded(was && travel.length_px > LEAST_TRAVEL_PX));
    }
    if travel.length_px < LEAST_TRAVEL_PX {
        // What moves now is not still.
        return before.map(|before| {
            let mut now = before.faded(false);
            now.belief += GAIN * (-1.0 - now.belief).min(0.0);
            now
        });
    }
    let known = before.and_then(|before| to_unit(&before.epipole, &things));
    let best = best(&things, &travel, known.as_ref());
    let belief = before.map_or(0.0, |before| before.belief);
    let (Some((candidate, found)), said) = (&best, best.as_ref().map_or(-1.0, |b| b.1.said)) else {
        return before.map(|before| before.faded(was));
    };
    let belief = belief + GAIN * (said.clamp(-MOST_SAID, MOST_SAID) - belief);
    let believed = belief > if was { DOUBTED } else { BELIEVED };
    // What is said against depth says nothing of where its epipole is.
    let keeps = was && said < DOUBTED;
    let mut point = match (&known, keeps) {
        (Some(known), true) => *known,
        _ => refined(&things, candidate, found, known.as_ref().filter(|_| was)),
    };
    let mut seen = before.map_or([0.0; 2], |before| before.seen.map(|sum| MEMORY * sum));
    if let Some(known) = &known
        && dot(known, &point) < 0.0
    {
        point = point.map(|part| -part);
    }
    if said > 0.0 {
        let sums = found.directions(&things, &point);
        seen = [seen[0] + sums[0], seen[1] + sums[1]];
    }
    let sign = match seen {
        [away, to] if away >= SIGN_THINGS && to <= SIGN_SHARE * away => Some(1.0),
        [away, to] if to >= SIGN_THINGS && away <= SIGN_SHARE * to => Some(-1.0),
        _ => None,
    };
    Some(Parallax {
        epipole: to_pixels(&point, &things)?,
        sign,
        belief,
        believed,
        seen,
    })
}

/// The candidate that explains most, and what it explains.
fn best(things: &Things, travel: &Travel, known: Option<&Point>) -> Option<(Candidate, Agreement)> {
    let mut candidates: Vec<Candidate> = Vec::new();
    let mut add = |point: Option<Point>, by_plane: bool| {
        candidates.extend(point.map(|point| Candidate { point, by_plane }));
    };
    add(nearest(travel.lines.iter(), None, None), true);
    add(known.copied(), false);
    let lines = mean_lines(things);
    for (i, a) in lines.iter().enumerate() {
        for b in &lines[..i] {
            add(crossing(a, b), false);
        }
    }
    let all: Vec<Line> = things.cells.iter().map(Line::of).collect();
    add(nearest(all.iter(), None, None), false);
    candidates
        .into_iter()
        .map(|candidate| (candidate, agreement(things, travel, &candidate)))
        .max_by(|a, b| a.1.said.total_cmp(&b.1.said))
}

/// One line for each of the largest things.
fn mean_lines(things: &Things) -> Vec<Line> {
    let mut sums: Vec<([f64; 2], [f64; 2], f64)> = vec![([0.0; 2], [0.0; 2], 0.0); things.count];
    for cell in &things.cells {
        let (place, motion, count) = &mut sums[cell.thing];
        for axis in 0..2 {
            place[axis] += cell.place[axis];
            motion[axis] += cell.motion[axis];
        }
        *count += 1.0;
    }
    sums.sort_by(|a, b| b.2.total_cmp(&a.2));
    sums.truncate(CROSSED);
    sums.into_iter()
        .map(|(place, motion, count)| Line {
            place: place.map(|sum| sum / count),
            motion: motion.map(|sum| sum / count),
            weight: 1.0,
        })
        .collect()
}

/// The epipole from all cells of the things that agree, beside what was known.
fn refined(
    things: &Things,
    candidate: &Candidate,
    found: &Agreement,
    known: Option<&Point>,
) -> Point {
    let lines: Vec<Line> = things
        .cells
        .iter()
        .filter(|cell| found.agrees[cell.thing])
        .map(Line::of)
        .collect();
    let prior = match known {
        Some(known) => Some((known, BEFORE_STD.powi(-2))),
        None if candidate.by_plane => Some((&candidate.point, BY_PLANE_STD.powi(-2))),
        None => None,
    };
    nearest(lines.iter(), Some(&candidate.point), prior).unwrap_or(candidate.point)
}

fn to_unit(point: &Point, things: &Things) -> Option<Point> {
    let [x, y, w] = *point;
    normalised([
        (x - things.centre[0] * w) / things.size,
        (y - things.centre[1] * w) / things.size,
        w,
    ])
}

fn to_pixels(point: &Point, things: &Things) -> Option<Point> {
    let [x, y, w] = *point;
    normalised([
        x * things.size + things.centre[0] * w,
        y * things.size + things.centre[1] * w,
        w,
    ])
}
