//! How much more things agree with an epipole than their directions would by chance.

use std::f64::consts::TAU;

use super::epipole::{ANGLE, Point, toward};
use super::things::{Cell, Things};
use super::travel::Travel;

/// An epipole is known to this distance, in units: near it directions tell less.
const POINT_STD: f64 = 0.05;
/// Directions to where the plane's own motion has the epipole differ by this angle, in radians: the camera turns too.
const BY_PLANE_ANGLE: f64 = 0.03;
/// Share of the things off the plane that are still in a scene with depth, and of those on the other side of the plane
/// where they are on one side.
const STILL: f64 = 0.6;
const OTHER_SIDE: f64 = 0.02;
/// What it costs, in logarithms of odds, that still things are on both sides of the plane, or behind it.
const BOTH_SIDES: f64 = 0.7;
const BEHIND: f64 = 2.5;
/// A still thing moves against the plane by at most this part of what the plane does by the camera's travel, both
/// along the line: its distance is a third of the plane's then. Behind the plane it is at most at infinity.
const NEAREST: f64 = 2.0;
/// Most things are not higher than two fifths of the plane's distance, or as far again behind it as twice that: beyond
/// that ratio depth is that much rarer.
const USUAL: f64 = 0.7;
const RARER: f64 = 0.2;
/// Of so many cells of a thing one errs by itself, and at most so many do. Beyond so many times its variance the angle
/// scatters more within a thing than depth explains.
const ALIKE_CELLS: f64 = 2.0;
const MOST_ALONE: f64 = 6.0;
const MOST_SCATTER: f64 = 3.0;
/// All of a thing's flow errs alike by this much, in pixels, in one frame.
const THING_STD_PX: f64 = 0.08;
/// What is compact, of less than this share of the picture, and lies before the plane is not behind it.
const COMPACT: f64 = 0.08;
/// Such a thing moves by itself: where it goes along the lines nonetheless, by this share of the plane's travel at least and
/// so many times as surely as by chance, others that move by themselves may go along them as well, as on a road that the camera
/// pans along. The share that does is from as many things as were seen to, and so many more of which this share does.
const LEAST_ALONG: f64 = 0.15;
const SURELY_ALONG: f64 = 8.0;
const FEW_ALONG: f64 = 1.0;
const SHARE_ALONG: f64 = 0.02;
/// A thing of fewer cells, and one that moves less than so many pixels against the plane, says less: where texture is weak
/// flow errs along the motion of the plane.
const WEAK_PX: f64 = 0.5;
const CELLS: f64 = 4.0;
/// Where the epipole may be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) point: Point,
    /// Whether it is from the plane's motion: then no thing was used up to find it.
    pub(super) by_plane: bool,
    /// Whether the scene is known to have depth: a camera that turns as well may hide its travel in a frame.
    pub(super) known: bool,
    /// How many things that no depth explains were seen to move along the lines of the frames before.
    pub(super) along: f64,
}

/// How things agree with an epipole.
#[derive(Debug)]
pub(super) struct Agreement {
    /// Logarithm of the odds of depth against things that move anyhow.
    pub(super) said: f64,
    /// Of each thing, whether it is more likely still.
    pub(super) agrees: Vec<bool>,
    /// The angle by which things that may be still turn from their lines, and its inverse variance.
    pub(super) turned: [f64; 2],
    /// How many things move along the lines as nothing does that is still.
    pub(super) along: f64,
}

impl Agreement {
    /// How many things that agree move away from a point, and towards it.
    pub(super) fn directions(&self, things: &Things, point: &Point) -> [f64; 2] {
        let mut along = vec![0.0; things.count];
        for cell in &things.cells {
            let [x, y] = toward(point, cell.place);
            along[cell.thing] += cell.motion[0] * x + cell.motion[1] * y;
        }
        let mut counts = [0.0; 2];
        for (along, _) in along
            .iter()
            .zip(&self.agrees)
            .filter(|(_, agrees)| **agrees)
        {
            counts[usize::from(*along > 0.0)] += 1.0;
        }
        counts
    }
}

/// Sums over the cells of a thing.
#[derive(Clone, Copy, Default)]
struct Sums {
    across: f64,
    turned: f64,
    length: f64,
    variance: f64,
    vague: f64,
    /// Variance, in units squared, of what all cells of a thing err alike.
    alike: f64,
    /// A motion of less than this, in units squared, says less.
    weak: f64,
    along: f64,
    travel: f64,
    cells: f64,
    /// Whether it is no more than the surroundings of another thing.
    surrounds: bool,
}

impl Sums {
    fn add(&mut self, cell: &Cell, point: &Point, travel: &[f64; 3]) {
        let [x, y] = toward(point, cell.place);
        let far = (x * x + y * y).max(1e-6);
        let [u, v] = cell.motion;
        let across = u * y - v * x;
        let square = u * u + v * v;
        self.across += across * across / far;
        self.turned += across / far.sqrt() * square.sqrt();
        self.length += square;
        self.variance += cell.variance;
        self.vague += square * POINT_STD * POINT_STD / far;
        self.along += (u * x + v * y) / far.sqrt();
        self.travel +=
            (travel[0] + travel[1] * cell.place[0] + travel[2] * cell.place[1]) * far.sqrt();
        self.cells += 1.0;
    }

    /// How far the thing goes against the plane by what the plane does by the camera's travel.
    fn ratio(&self) -> f64 {
        self.along / self.travel
    }

    /// The angle by which it turns from its line, and the inverse variance of that.
    fn turn(&self) -> [f64; 2] {
        // Flow errs alike in neighbouring cells.
        let alone = (self.cells / ALIKE_CELLS).clamp(1.0, MOST_ALONE);
        let single = (self.variance + self.vague) / self.length;
        let alike = self.alike * self.cells / self.length;
        [self.turned / self.length, 1.0 / (single / alone + alike)]
    }

    /// Whether it may be still and nearer than the plane, as far as its angle tells.
    fn may_be_still(&self, angle: f64) -> bool {
        let [turned, weight] = self.turn();
        let ratio = self.ratio();
        ratio > 0.0 && ratio < USUAL && turned * turned < 9.0 * (1.0 / weight + angle * angle)
    }

    /// How many times as dense its angle to its line is as one that is like everywhere on the circle.
    fn density(&self, angle: f64, before: [f64; 2]) -> f64 {
        let [mut turned, mut weight] = self.turn();
        if self.may_be_still(angle) {
            // Errors of one frame are not those of another: over frames the angle is surer.
            turned = (weight * turned + before[1] * before[0]) / (weight + before[1]);
            weight += before[1];
        }
        let variance = 1.0 / weight + angle * angle;
        let single = (self.variance + self.vague) / self.length;
        let scatter = self.across / self.length / (single + angle * angle);
        let error = turned * turned / variance + (scatter - MOST_SCATTER).max(0.0);
        TAU / (TAU * variance).sqrt() * (-0.5 * error).exp()
    }

    /// How much of a thing's say it has.
    fn say(&self) -> f64 {
        if self.surrounds {
            return 0.0;
        }
        (self.cells / CELLS).min(1.0) * (self.length / self.cells / self.weak).min(1.0)
    }

    /// Whether it lies before the plane and moves as if it were behind: nothing that is still does.
    fn crosses(&self, compact: f64) -> bool {
        self.ratio() < -LEAST_ALONG && self.cells < compact
    }

    /// Logarithms of the odds that the thing is still, where still things are nearer, behind, and both.
    fn odds(&self, dense: f64, known: bool, crosses: bool, along: f64) -> [f64; 3] {
        let ratio = self.ratio();
        let density = match ratio {
            _ if crosses => 0.0,
            ratio if ratio > -USUAL && ratio < USUAL => dense,
            ratio if known || (ratio > -1.0 && ratio < NEAREST) => RARER * dense,
            _ => 0.0,
        };
        // What moves by itself goes anywhere, or along the lines either way.
        let moves = 1.0 - along + along * dense / 2.0;
        let nearer = ratio > 0.0;
        let one_side = |this: bool| if this { STILL } else { OTHER_SIDE };
        let shares = [one_side(nearer), one_side(!nearer), STILL / 2.0];
        shares.map(|share| self.say() * (share * density / moves + 1.0 - STILL).ln())
    }
}

/// How things agree with a candidate.
///
/// `before` is the angle by which things turned from their lines in frames before, and its inverse variance; it counts
/// for the point that the plane's motion tells.
pub(super) fn agreement(
    things: &Things,
    travel: &Travel,
    candidate: &Candidate,
    before: [f64; 2],
) -> Agreement {
    let point = &candidate.point;
    let by_distance = travel.toward(point);
    let none = Sums {
        alike: (THING_STD_PX / things.size).powi(2),
        weak: (WEAK_PX / things.size).powi(2),
        ..Sums::default()
    };
    let mut sums = vec![none; things.count];
    for (sums, surrounds) in sums.iter_mut().zip(&things.surrounds) {
        sums.surrounds = *surrounds;
    }
    for cell in &things.cells {
        sums[cell.thing].add(cell, point, &by_distance);
    }
    let angle = if candidate.by_plane {
        ANGLE.hypot(BY_PLANE_ANGLE)
    } else {
        ANGLE
    };
    let before = if candidate.by_plane { before } else { [0.0; 2] };
    let compact = COMPACT * things.all_cells as f64;
    let dense: Vec<(&Sums, f64, bool)> = sums
        .iter()
        .map(|sums| (sums, sums.density(angle, before), sums.crosses(compact)))
        .collect();
    let seen = dense
        .iter()
        .filter(|(_, dense, crosses)| *crosses && *dense > SURELY_ALONG);
    let along: f64 = seen.map(|(sums, ..)| sums.say()).sum();
    let all = along.max(candidate.along);
    let share = (FEW_ALONG * SHARE_ALONG + all) / (FEW_ALONG + all);
    let odds: Vec<[f64; 3]> = dense
        .iter()
        .map(|(sums, dense, crosses)| sums.odds(*dense, candidate.known, *crosses, share))
        .collect();
    let turns = sums
        .iter()
        .filter(|sums| sums.may_be_still(angle))
        .map(Sums::turn);
    let [turned, weight] = turns.fold([0.0; 2], |sum, [turned, weight]| {
        [sum[0] + weight * turned, sum[1] + weight]
    });
    let mut best = Agreement {
        said: f64::NEG_INFINITY,
        agrees: Vec::new(),
        turned: [turned / weight.max(1e-12), weight],
        along,
    };
    for (side, cost) in [0.0, BEHIND, BOTH_SIDES].into_iter().enumerate() {
        let mut said: f64 = odds.iter().map(|odds| odds[side]).sum::<f64>() - cost;
        if !candidate.by_plane {
            // Any two things have a point of their own.
            let (mut first, mut second) = (0.0, 0.0);
            for odds in &odds {
                if odds[side] > first {
                    (first, second) = (odds[side], first);
                } else if odds[side] > second {
                    second = odds[side];
                }
            }
            said -= first + second;
        }
        if said > best.said {
            best.said = said;
            best.agrees = odds.iter().map(|odds| odds[side] > 0.0).collect();
        }
    }
    best
}
