//! The motion of the plane itself: how far, and how much of it is travel towards a point.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::camera::CameraMotion;
use super::epipole::{Line, Point, solved, toward};
use super::things::Things;

/// The plane's motion that is a turn rather than travel costs this much, as a share of the places, so that travel
/// explains what both could; and a plane that is not upright to the view.
const TURN: f64 = 0.01;
const TILT: f64 = 1e-4;

/// The motion of the plane itself, at places of the next frame, in units.
pub(super) struct Travel {
    pub(super) lines: Vec<Line>,
    pub(super) length_px: f64,
}

impl Travel {
    pub(super) fn of(camera: &CameraMotion, things: &Things) -> Self {
        const SIDE: i32 = 5;
        let mut lines = Vec::with_capacity((SIDE * SIDE) as usize);
        let mut sum = 0.0;
        for row in 0..SIDE {
            for column in 0..SIDE {
                let part = |k: i32| 2.0 * f64::from(k) / f64::from(SIDE - 1) - 1.0;
                let place = [part(column) * things.reach[0], part(row) * things.reach[1]];
                let from = [0, 1].map(|k: usize| place[k] * things.size + things.centre[k]);
                let to = camera.applied(from[0], from[1]);
                let motion = [0, 1].map(|k: usize| (to[k] - from[k]) / things.size);
                let square = motion[0] * motion[0] + motion[1] * motion[1];
                sum += square;
                lines.push(Line {
                    place: [place[0] + motion[0], place[1] + motion[1]],
                    motion,
                    // Long motions tell a direction.
                    weight: square,
                });
            }
        }
        let length_px = (sum / lines.len() as f64).sqrt() * things.size;
        let whole = sum.max(1e-18);
        for line in &mut lines {
            line.weight /= whole;
        }
        Self { lines, length_px }
    }

    /// The plane's motion along the lines to a point, as a share of the way there that is linear over the picture: what is
    /// left beside a shift and a turn of the picture. That is the inverse distance of the plane in units of the travel.
    pub(super) fn toward(&self, point: &Point) -> [f64; 3] {
        const NUMBERS: usize = 6;
        let mut normal = [[0.0; NUMBERS]; NUMBERS];
        let mut right = [0.0; NUMBERS];
        for line in &self.lines {
            let [x, y] = line.place;
            let [tx, ty] = toward(point, line.place);
            let slopes = [
                [tx, tx * x, tx * y, 1.0, 0.0, -y],
                [ty, ty * x, ty * y, 0.0, 1.0, x],
            ];
            for (slopes, motion) in slopes.iter().zip(line.motion) {
                for i in 0..NUMBERS {
                    right[i] += slopes[i] * motion;
                    for j in 0..NUMBERS {
                        normal[i][j] += slopes[i] * slopes[j];
                    }
                }
            }
        }
        let count = self.lines.len() as f64;
        for (k, row) in normal.iter_mut().enumerate() {
            row[k] += count * if k >= 3 { TURN } else { TILT };
        }
        solved(normal, right).map_or([0.0; 3], |solved| [solved[0], solved[1], solved[2]])
    }

    /// A point the way round that the plane moves towards it.
    pub(super) fn oriented(&self, point: Point) -> Point {
        let along = |line: &Line| {
            let [x, y] = toward(&point, line.place);
            line.motion[0] * x + line.motion[1] * y
        };
        if self.lines.iter().map(along).sum::<f64>() < 0.0 {
            point.map(|part| -part)
        } else {
            point
        }
    }
}
