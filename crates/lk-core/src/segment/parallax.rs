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
/// A still thing moves against the plane by at most this part of what the plane does by the camera's travel, where the
/// flow is exact: it is at a quarter of the plane's distance then. Behind the plane it is at most at infinity, at -1.
const NEAREST_TOLD: f64 = 3.0;
const BEYOND: f64 = -1.3;
/// How much of a frame's travel is taken over.
const TRAVEL_GAIN: f64 = 0.3;
/// Angles of frames before are worth so much less with each frame.
const TURN_MEMORY: f64 = 0.85;
/// How much of what one frame says is taken over into the belief, and the most that one frame can say.
const GAIN: f64 = 0.5;
const MOST_SAID: f64 = 4.0;
/// What fades of a belief in a frame that says nothing.
const FADING: f64 = 0.98;
/// Logarithms of the odds at which depth begins and ceases to be believed.
const BELIEVED: f64 = 1.5;
const DOUBTED: f64 = 0.3;
/// What must have been believed already after the frame before: one frame alone is not enough.
const BEGINS: f64 = 0.5;
/// Which way still things move is remembered for about ten frames; it is known from so many things, where at most this
/// share as many moved the other way.
const MEMORY: f64 = 0.9;
const SIGN_THINGS: f64 = 3.0;
const SIGN_SHARE: f64 = 0.34;
/// Two epipoles are the same where the cosine between them, about a picture of unit size, is more than this.
const SAME: f64 = 0.85;
/// Things that were seen to move by themselves along the lines count so much of that in the frame after.
const ALONG_MEMORY: f64 = 0.97;
/// The largest things whose lines are crossed for candidates.
const CROSSED: usize = 14;
/// Standard deviations of a refined epipole, as an angle, around where the plane's motion and the frame before have it.
const BY_PLANE_STD: f64 = 0.04;
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
    /// Whether the scene is believed to have depth.
    pub depth: bool,
    /// Whether that tells in this frame, in which the camera travelled: else nothing is to be explained by depth.
    pub believed: bool,
    /// Things seen lately that moved away from the epipole, and towards it.
    pub seen: [f64; 2],
    /// The angle in radians by which things turned lately from where the plane's motion has the epipole, and its inverse
    /// variance.
    pub turned: [f64; 2],
    /// How many things were seen lately to move by themselves along the lines: others may as well.
    pub along: f64,
    /// The plane's own motion by the camera's travel at (x, y) of `next`, as a share of the way to the epipole:
    /// `travel[0] + travel[1] * x + travel[2] * y` times `epipole.xy - epipole.w * (x, y)`, in pixels.
    pub travel: [f64; 3],
}

impl Parallax {
    /// The part of a residual motion, `next` against the plane, at a place of `next` that depth cannot explain: what is
    /// across the line to the epipole, and all of it where it is along the line in the impossible direction, or further
    /// than if it were at a quarter of the plane's distance or beyond infinity.
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
        let length = square.sqrt();
        let travel = self.travel[0] + self.travel[1] * place[0] + self.travel[2] * place[1];
        // Where the plane itself hardly moves by the travel, errors of both decide.
        let travel = travel.signum() * (travel.abs() * length).max(LEAST_TRAVEL_PX);
        let ratio = along * length / travel;
        if !(BEYOND..NEAREST_TOLD).contains(&ratio) {
            return residual;
        }
        [
            residual[0] - along * toward[0],
            residual[1] - along * toward[1],
        ]
    }

    /// The belief after a frame in which the camera rested and things moved: these are not still.
    fn rested(self) -> Self {
        let mut now = self.faded(false);
        now.belief += GAIN * (-1.0 - now.belief).min(0.0);
        now.depth &= now.belief > DOUBTED;
        now
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
    let was = before.is_some_and(|before| before.depth);
    if things.count == 0 {
        return before.map(|before| before.faded(was && travel.length_px > LEAST_TRAVEL_PX));
    }
    if travel.length_px < LEAST_TRAVEL_PX {
        return before.map(|before| before.rested());
    }
    let known = before.and_then(|before| to_unit(&before.epipole, &things));
    let Told {
        turned,
        along,
        best,
    } = told(&things, &travel, before, known.as_ref());
    let Some((candidate, found)) = best else {
        return before.map(|before| before.faded(was));
    };
    // What is said against depth says nothing of where its epipole is.
    let point = match &known {
        Some(known) if was && found.said < DOUBTED => *known,
        _ => refined(&things, &candidate, &found, known.as_ref().filter(|_| was)),
    };
    // The same way round as before; a point elsewhere has not been seen from.
    let near = known.map_or(0.0, |known| dot(&known, &point));
    let point = if near < 0.0 {
        point.map(|part| -part)
    } else {
        point
    };
    let same = near.abs() > SAME;
    // A belief is in one epipole: in favour of another it says nothing.
    let old = before.map_or(0.0, |before| before.belief);
    let old = if same { old } else { old.min(0.0) };
    let belief = old + GAIN * (found.said.clamp(-MOST_SAID, MOST_SAID) - old);
    let depth = if was {
        belief > DOUBTED
    } else {
        belief > BELIEVED && old > BEGINS
    };
    let keeps = if same { MEMORY } else { 0.0 };
    let mut seen = before.map_or([0.0; 2], |before| before.seen.map(|sum| keeps * sum));
    if found.said > 0.0 {
        let sums = found.directions(&things, &point);
        seen = [seen[0] + sums[0], seen[1] + sums[1]];
    }
    let (epipole, mut by_distance) = to_pixels(&point, &travel.toward(&point), &things)?;
    if let Some(before) = before.filter(|before| before.depth && same) {
        // A camera that turns as well may hide its travel in a frame.
        for (now, old) in by_distance.iter_mut().zip(before.travel) {
            *now = old + TRAVEL_GAIN * (*now - old);
        }
    }
    Some(Parallax {
        epipole,
        sign: sign_of(seen),
        belief,
        depth,
        believed: depth,
        seen,
        turned,
        along,
        travel: by_distance,
    })
}

/// What a frame tells beside those before.
struct Told {
    /// As in `Parallax`.
    turned: [f64; 2],
    along: f64,
    /// The candidate that says most for depth.
    best: Option<Judged>,
}

fn told(
    things: &Things,
    travel: &Travel,
    before: Option<&Parallax>,
    known: Option<&Point>,
) -> Told {
    let was = before.is_some_and(|before| before.depth);
    let [angle, weight] = before.map_or([0.0; 2], |b| [b.turned[0], TURN_MEMORY * b.turned[1]]);
    let along = before.map_or(0.0, |before| ALONG_MEMORY * before.along);
    let candidate = |point, by_plane| Candidate {
        point,
        by_plane,
        known: was,
        along,
    };
    let by_plane = nearest(travel.lines.iter(), None, None)
        .map(|point| candidate(travel.oriented(point), true))
        .map(|candidate| judged(things, travel, candidate, [angle, weight]));
    let (turned, now) = by_plane
        .as_ref()
        .map_or(([0.0; 2], 0.0), |(_, found)| (found.turned, found.along));
    let sum = weight + turned[1];
    let others = best(things, travel, known, |point| candidate(point, false));
    let of = |judged: &Judged| judged.1.said;
    let both = [by_plane, others].into_iter().flatten();
    Told {
        turned: [
            (angle * weight + turned[0] * turned[1]) / sum.max(1e-12),
            sum,
        ],
        along: along.max(now),
        best: both.max_by(|a, b| of(a).total_cmp(&of(b))),
    }
}

fn sign_of(seen: [f64; 2]) -> Option<f64> {
    match seen {
        [away, to] if away >= SIGN_THINGS && to <= SIGN_SHARE * away => Some(1.0),
        [away, to] if to >= SIGN_THINGS && away <= SIGN_SHARE * to => Some(-1.0),
        _ => None,
    }
}

type Judged = (Candidate, Agreement);

fn judged(things: &Things, travel: &Travel, candidate: Candidate, turned: [f64; 2]) -> Judged {
    let found = agreement(things, travel, &candidate, turned);
    (candidate, found)
}

/// The candidate that explains most among those that things tell, and what it explains.
fn best(
    things: &Things,
    travel: &Travel,
    known: Option<&Point>,
    candidate: impl Fn(Point) -> Candidate,
) -> Option<Judged> {
    let lines = mean_lines(things);
    let all: Vec<Line> = things.cells.iter().map(Line::of).collect();
    let mut points: Vec<Point> = known.copied().into_iter().collect();
    points.extend(nearest(all.iter(), None, None));
    for (i, a) in lines.iter().enumerate() {
        points.extend(lines[..i].iter().filter_map(|b| crossing(a, b)));
    }
    points
        .into_iter()
        .map(|point| judged(things, travel, candidate(point), [0.0; 2]))
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

/// A point in pixels, and the travel towards it for that.
fn to_pixels(
    point: &Point,
    [at, by_x, by_y]: &[f64; 3],
    things: &Things,
) -> Option<(Point, [f64; 3])> {
    let ([x, y, w], [cx, cy], size) = (*point, things.centre, things.size);
    let whole = [x * size + cx * w, y * size + cy * w, w];
    let length = dot(&whole, &whole).sqrt();
    let [by_x, by_y] = [by_x / size, by_y / size];
    let travel = [at - by_x * cx - by_y * cy, by_x, by_y].map(|part| part * length);
    normalised(whole).map(|point| (point, travel))
}
