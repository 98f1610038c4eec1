//! What a camera that turns and moves over a plane sees: where a point of the plane is in two frames, exactly.

use super::lens::Lens;
use crate::error::Result;
use crate::options::expect_option;

/// Unknowns of a motion: the camera's way in units of its height, x, y, z, and what it turned more than was told.
pub(super) const UNKNOWNS: usize = 6;

/// Cosine of the angle from straight down beyond which a plane is too far away to be followed: 80 degrees.
const GRAZING: f64 = 0.17;

/// A motion: the way of the camera between two frames divided by its height over the plane at the second one, and a
/// rotation vector, in radians, that comes on top of [`PlaneInterval::turn`]; both in the camera's axes half-way.
pub type PlaneMotion = [f64; UNKNOWNS];

/// What is known of a camera over a plane between two frames.
///
/// ```
/// use lk_core::PlaneInterval;
///
/// // Level flight, nothing turns, and 15 ms from the first row to the last of frames that are 20 ms apart.
/// let interval = PlaneInterval::default().rolling_shutter(0.015 / 0.02);
/// assert!(interval.validate().is_ok());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PlaneInterval {
    /// Rotation vector of the camera from the first frame to the second, in its own axes, in radians.
    pub turn: [f64; 3],
    /// Unit vector from the camera straight to the plane, in its axes at the second frame.
    pub down: [f64; 3],
    /// Time from the first row of a frame to its last one, divided by that between the frames. The time of a frame is
    /// that of its middle row.
    pub readout: f64,
    /// How much the rotation grows from one interval to the next, in radians: it tells the turns between rows.
    pub growth: [f64; 3],
}

impl Default for PlaneInterval {
    fn default() -> Self {
        Self {
            turn: [0.0; 3],
            down: [0.0, 0.0, 1.0],
            readout: 0.0,
            growth: [0.0; 3],
        }
    }
}

impl PlaneInterval {
    /// The same with this known rotation vector, in radians.
    #[must_use]
    pub fn turn(mut self, turn: [f64; 3]) -> Self {
        self.turn = turn;
        self
    }

    /// The same with this unit vector straight to the plane.
    #[must_use]
    pub fn down(mut self, down: [f64; 3]) -> Self {
        self.down = down;
        self
    }

    /// The same with this time from first to last row, in intervals.
    #[must_use]
    pub fn rolling_shutter(mut self, readout: f64) -> Self {
        self.readout = readout;
        self
    }

    /// The same with a rotation that grows by this vector from one interval to the next, in radians.
    #[must_use]
    pub fn growth(mut self, growth: [f64; 3]) -> Self {
        self.growth = growth;
        self
    }

    /// Check every number.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option) if a number is not finite or `down` is no unit vector.
    pub fn validate(&self) -> Result<()> {
        for value in self.turn.into_iter().chain(self.growth) {
            expect_option(value.is_finite(), "turn", value, "finite angles in radians")?;
        }
        let length = norm(self.down);
        expect_option(
            (length - 1.0).abs() < 1e-6,
            "down",
            length,
            "a vector of length 1",
        )?;
        expect_option(
            self.readout.is_finite(),
            "readout",
            self.readout,
            "a finite number",
        )
    }
}

/// A motion over a plane, as a camera sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) lens: &'a Lens,
    pub(super) interval: &'a PlaneInterval,
    pub(super) rows: f64,
    way: [f64; 3],
    turn: [f64; 3],
    /// Straight down half-way.
    down: [f64; 3],
    /// Height half-way, in heights at the second frame.
    height: f64,
    /// Rotations from the axes half-way to those of either frame, where all rows are taken at once.
    whole: [[[f64; 3]; 3]; 2],
}

impl<'a> View<'a> {
    /// `rows`: of a frame.
    pub(super) fn new(
        lens: &'a Lens,
        interval: &'a PlaneInterval,
        rows: usize,
        motion: &PlaneMotion,
    ) -> Self {
        let [x, y, z, a, b, c] = *motion;
        let way = [x, y, z];
        let turn: [f64; 3] = std::array::from_fn(|k| interval.turn[k] + [a, b, c][k]);
        let down = rotate(&rotation(turn.map(|angle| 0.5 * angle)), interval.down);
        Self {
            lens,
            interval,
            rows: (rows.max(2) - 1) as f64,
            way,
            turn,
            down,
            height: 1.0 + 0.5 * dot(down, way),
            whole: [0.5, -0.5].map(|share| rotation(turn.map(|angle| share * angle))),
        }
    }

    /// Where the plane seen at pixel `middle` half-way between the frames is in either of them.
    pub(super) fn places(&self, middle: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        let ray = self.lens.ray(middle)?;
        let toward = dot(self.down, ray);
        if toward <= GRAZING * norm(ray) || self.height <= 0.0 {
            return None;
        }
        let depth = self.height / toward;
        let point = ray.map(|value| depth * value);
        let mut places = [[0.0; 2]; 2];
        for (which, place) in places.iter_mut().enumerate() {
            *place = self.seen(point, which)?;
        }
        Some(places)
    }

    /// Where what is at `pixel` in the first frame is in the second.
    pub(super) fn carried(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let share = self.share(0, pixel[1]);
        let back = rotation(self.turned(0, share).map(|angle| -angle));
        let ray = rotate(&back, self.lens.ray(pixel)?);
        let toward = dot(self.down, ray);
        if toward <= 1e-6 {
            return None;
        }
        // The camera stood `share` of the way before the middle.
        let depth = (self.height + share * dot(self.down, self.way)) / toward;
        if depth <= 0.0 {
            return None;
        }
        let point = std::array::from_fn(|k| depth * ray[k] - share * self.way[k]);
        self.seen(point, 1)
    }

    /// Part of the motion between the row of frame `which` and the middle, before it or after it.
    fn share(&self, which: usize, row: f64) -> f64 {
        if self.interval.readout == 0.0 {
            return 0.5;
        }
        let late = self.interval.readout * (row / self.rows - 0.5);
        if which == 0 { 0.5 - late } else { 0.5 + late }
    }

    /// Rotation vector from the axes half-way to those of frame `which` at a row that is `share` of the motion away.
    fn turned(&self, which: usize, share: f64) -> [f64; 3] {
        let sign = if which == 0 { 1.0 } else { -1.0 };
        // The rate grows: what it adds is even in time, and none at the frame's own time.
        let bend = 0.5 * (share * share - 0.25);
        std::array::from_fn(|k| sign * share * self.turn[k] - bend * self.interval.growth[k])
    }

    /// The pixel of frame `which` that shows `point`, in axes and from the place half-way.
    fn seen(&self, point: [f64; 3], which: usize) -> Option<[f64; 2]> {
        let sign = if which == 0 { 1.0 } else { -1.0 };
        let at = |share: f64, rotation: &[[f64; 3]; 3]| {
            let from = std::array::from_fn(|k| point[k] + sign * share * self.way[k]);
            self.lens.project(rotate(rotation, from))
        };
        let mut place = at(0.5, &self.whole[which])?;
        if self.interval.readout != 0.0 {
            // The row decides the time, and the time the row.
            for _ in 0..4 {
                let share = self.share(which, place[1]);
                place = at(share, &rotation(self.turned(which, share)))?;
            }
        }
        Some(place)
    }
}

/// Rotation by |v| radians about v, right-handed (Rodrigues' formula).
pub(super) fn rotation(v: [f64; 3]) -> [[f64; 3]; 3] {
    let square = dot(v, v);
    let angle = square.sqrt();
    // sin a / a and (1 - cos a) / a^2.
    let (s, c) = if angle < 1e-4 {
        (1.0 - square / 6.0, 0.5 - square / 24.0)
    } else {
        (angle.sin() / angle, (1.0 - angle.cos()) / square)
    };
    let [x, y, z] = v;
    let cos = 1.0 - c * square;
    [
        [cos + c * x * x, c * x * y - s * z, c * x * z + s * y],
        [c * x * y + s * z, cos + c * y * y, c * y * z - s * x],
        [c * x * z - s * y, c * y * z + s * x, cos + c * z * z],
    ]
}

pub(super) fn rotate(by: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    by.map(|row| dot(row, v))
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn norm(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane::lens::Distortion;

    fn lens() -> Lens {
        let mut bent = [0.0; 12];
        (bent[0], bent[1], bent[2]) = (-0.25, 0.06, 0.001);
        Lens::new([290.0, 295.0], [160.2, 118.9], Distortion::Brown(bent)).unwrap()
    }

    /// The pixel of a point of the world (plane z = 0, z down) from a camera that stands at `at` and whose axes are the
    /// columns of `axes`: written without any of the module's formulas of motion.
    fn pictured(lens: &Lens, axes: &[[f64; 3]; 3], at: [f64; 3], point: [f64; 3]) -> [f64; 2] {
        let from: [f64; 3] = std::array::from_fn(|k| point[k] - at[k]);
        let ray = std::array::from_fn(|k| (0..3).map(|j| axes[j][k] * from[j]).sum());
        lens.project(ray).unwrap()
    }

    fn times(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
        std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
    }

    #[test]
    fn a_motion_over_a_tilted_plane_is_that_of_two_poses() {
        let lens = lens();
        let first = times(&rotation([0.12, 0.0, 0.0]), &rotation([0.0, -0.2, 0.0]));
        let turn = [0.02, -0.015, 0.05];
        let velocity = [0.03, -0.05, 0.04];
        let middle = times(&first, &rotation(turn.map(|a| 0.5 * a)));
        let second = times(&first, &rotation(turn));
        let from = [0.1, 0.2, -0.6];
        let way = rotate(&middle, velocity);
        let to: [f64; 3] = std::array::from_fn(|k| from[k] + way[k]);
        let height = -to[2];
        let interval = PlaneInterval::default()
            .turn([turn[0] - 0.004, turn[1], turn[2] + 0.01])
            .down(second[2]);
        let motion = [
            velocity[0] / height,
            velocity[1] / height,
            velocity[2] / height,
            0.004,
            0.0,
            -0.01,
        ];
        let view = View::new(&lens, &interval, 240, &motion);
        for point in [[0.1, 0.1, 0.0], [0.25, 0.3, 0.0], [-0.05, 0.25, 0.0]] {
            let prev = pictured(&lens, &first, from, point);
            let next = pictured(&lens, &second, to, point);
            let carried = view.carried(prev).unwrap();
            assert!((carried[0] - next[0]).hypot(carried[1] - next[1]) < 1e-7);
            let half: [f64; 3] = std::array::from_fn(|k| 0.5 * (from[k] + to[k]));
            let places = view.places(pictured(&lens, &middle, half, point)).unwrap();
            for (place, want) in places.iter().zip([prev, next]) {
                assert!((place[0] - want[0]).hypot(place[1] - want[1]) < 1e-7);
            }
        }
    }

    #[test]
    fn rows_are_taken_at_their_own_times() {
        let lens = lens();
        let (turn, velocity, readout) = ([0.03, 0.01, -0.02], [0.04, 0.06, -0.02], 0.8);
        let first = rotation([0.05, 0.0, 0.0]);
        let middle = times(&first, &rotation(turn.map(|a| 0.5 * a)));
        let way = rotate(&middle, velocity);
        // The pose at a time in intervals from the first frame.
        let pose = |t: f64| {
            let at: [f64; 3] = std::array::from_fn(|k| [0.0, 0.0, -1.0][k] + t * way[k]);
            (times(&first, &rotation(turn.map(|a| t * a))), at)
        };
        let row_at = |point: [f64; 3], frame: f64| {
            let mut row = 119.5;
            for _ in 0..60 {
                let (axes, at) = pose(frame + readout * (row / 239.0 - 0.5));
                row = pictured(&lens, &axes, at, point)[1];
            }
            let (axes, at) = pose(frame + readout * (row / 239.0 - 0.5));
            pictured(&lens, &axes, at, point)
        };
        let (second, to) = pose(1.0);
        let interval = PlaneInterval::default()
            .turn(turn)
            .down(second[2])
            .rolling_shutter(readout);
        let height = -to[2];
        let motion = [
            velocity[0] / height,
            velocity[1] / height,
            velocity[2] / height,
            0.0,
            0.0,
            0.0,
        ];
        let view = View::new(&lens, &interval, 240, &motion);
        for point in [[0.1, 0.3, 0.0], [-0.2, -0.25, 0.0], [0.3, 0.0, 0.0]] {
            let carried = view.carried(row_at(point, 0.0)).unwrap();
            let want = row_at(point, 1.0);
            let off = (carried[0] - want[0]).hypot(carried[1] - want[1]);
            assert!(off < 2e-4, "{off}");
        }
    }

    #[test]
    fn a_rotation_that_grows_is_told_between_the_rows() {
        let lens = lens();
        let (turn, growth, readout) = ([0.02, 0.01, 0.0], [0.006, -0.004, 0.003], 0.9);
        // Attitude at a time in intervals from the first frame: the rate grows linearly.
        let axes = |t: f64| {
            let angle: [f64; 3] =
                std::array::from_fn(|k| turn[k] * t + 0.5 * growth[k] * (t * t - t));
            rotation(angle)
        };
        let row_at = |point: [f64; 3], frame: f64| {
            let mut row = 119.5;
            for _ in 0..60 {
                let time = frame + readout * (row / 239.0 - 0.5);
                row = pictured(&lens, &axes(time), [0.0, 0.0, -1.0], point)[1];
            }
            let time = frame + readout * (row / 239.0 - 0.5);
            pictured(&lens, &axes(time), [0.0, 0.0, -1.0], point)
        };
        let interval = PlaneInterval::default()
            .turn(turn)
            .down(axes(1.0)[2])
            .rolling_shutter(readout)
            .growth(growth);
        let view = View::new(&lens, &interval, 240, &[0.0; 6]);
        for point in [[0.1, 0.3, 0.0], [-0.2, -0.25, 0.0], [0.3, 0.0, 0.0]] {
            let carried = view.carried(row_at(point, 0.0)).unwrap();
            let want = row_at(point, 1.0);
            let off = (carried[0] - want[0]).hypot(carried[1] - want[1]);
            assert!(off < 0.02, "{off}");
        }
    }
}
