//! What one tile says of its displacement, and how surely.
//!
//! `docs/explanation/algorithms.md`, section "Tiles of a plane".

use super::motion::UNKNOWNS;
use super::tile::Solved;

/// What is left in a tile is correlated between neighbouring pixels, as both frames were smoothed: so much less do they
/// tell than if each stood for itself.
const SHARED: f64 = 2.6;
/// Standard deviation of a tile's displacement, in pixels of its level, that the residual does not show.
const FLOOR_PX: f64 = 0.0015;
/// Mean square of a gradient of what is noise in the difference, as part of the mean square of that.
const NOISE_GRADIENT: f64 = 0.19;
/// Least part of a tile's gradients that must not be noise.
const LEAST_TRUE: f64 = 0.05;
/// A step is made longer by at most so much where gradients are noise.
const MOST_LONGER: f64 = 4.0;
/// Correlation of both frames above which a tile shows the same in both.
const MATCHED: f64 = 0.35;
/// So does one that is left with no more than this much of what noise leaves.
const AS_NOISE: f64 = 2.0;

/// One tile at the end of a round.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen {
    /// Half-way between its places in both frames, in pixels of the frame.
    pub(super) middle: [f64; 2],
    /// At which it was sampled.
    pub(super) displacement: [f64; 2],
    /// What the motion says, on average over the tile.
    pub(super) predicted: [f64; 2],
    pub(super) slopes: [[f64; UNKNOWNS]; 2],
    /// Whether it is within both frames.
    pub(super) inside: bool,
    pub(super) solved: Option<Solved>,
    /// Correlation of both frames, motion and light taken out.
    pub(super) correlation: f64,
}

impl Seen {
    /// Whether both frames show the same there, as far as noise lets it be seen.
    pub(super) fn is_matched(&self, noise: f64) -> bool {
        let quiet = |solved: &Solved| solved.left < AS_NOISE * noise;
        self.correlation >= MATCHED || self.solved.as_ref().is_some_and(quiet)
    }

    pub(super) fn measured(&self) -> Option<[f64; 2]> {
        let solved = self.solved?;
        Some(std::array::from_fn(|k| {
            self.displacement[k] + solved.step[k]
        }))
    }
}

/// Correlation of both frames over a tile, from what is left of its texture: 1 where they show the same, 0 where they
/// have nothing in common.
pub(super) fn correlation(solved: &Solved) -> f64 {
    let (texture, left) = (solved.texture, 0.25 * solved.left);
    if texture + left > 0.0 {
        ((texture - left) / (texture + left)).max(-1.0)
    } else {
        0.0
    }
}

/// Inverse covariance of a tile's displacement, in its own pixels: xx, xy, yy, and its step; none where its gradients are
/// noise.
pub(super) fn freed_of_noise(solved: &Solved, noise: f64) -> Option<([f64; 3], [f64; 2])> {
    let [xx, xy, yy] = solved.structure;
    // Gradients of noise raise the sums, but say nothing of the displacement.
    let false_part = NOISE_GRADIENT * noise.min(solved.left) * solved.count;
    let [a, b, c] = [xx - false_part, xy, yy - false_part];
    let (trace, determinant) = (a + c, a * c - b * b);
    let whole = xx + yy;
    if trace < 2.0 * LEAST_TRUE * whole || determinant <= 0.0 || a <= 0.0 {
        return None;
    }
    // The displacement is where the sums of gradients times differences vanish: these have the noise of all gradients,
    // and the slope of the true ones.
    let left = SHARED * solved.left.max(noise) + 1e-4;
    let inverse = [c / determinant, -b / determinant, a / determinant];
    let times = |[a, b, c]: [f64; 3], [x, y]: [f64; 2]| [a * x + b * y, b * x + c * y];
    let column = |unit: [f64; 2]| {
        let spread = times(inverse, unit);
        times(inverse, times([xx, xy, yy], spread))
    };
    let ([vx, vxy], [_, vy]) = (column([1.0, 0.0]), column([0.0, 1.0]));
    let floor = FLOOR_PX * FLOOR_PX;
    let (vx, vxy, vy) = (left * vx + floor, left * vxy, left * vy + floor);
    let determinant = vx * vy - vxy * vxy;
    if determinant <= 0.0 {
        return None;
    }
    let information = [vy / determinant, -vxy / determinant, vx / determinant];
    // Sums that noise raises make steps too short.
    let step = times(inverse, times([xx, xy, yy], solved.step));
    let length = |[x, y]: [f64; 2]| x.hypot(y);
    let most = MOST_LONGER * length(solved.step);
    let shorter = if length(step) > most {
        most / length(step)
    } else {
        1.0
    };
    Some((information, step.map(|value| shorter * value)))
}
