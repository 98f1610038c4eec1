//! The least squares of one step: the normal equations of a template, and what their solution leaves.

use crate::track::affine::warp::{Warp, inverted, product};
use crate::track::normal::GAIN_RANGE;
use crate::track::patch::Light;

/// Unknowns: the displacement and the derivative of the warp along x and along y, an offset, a gain, the offset's slopes.
pub(super) const UNKNOWNS: usize = 10;

/// One step of the least squares.
pub(super) struct Step {
    /// The unknowns, over the gain.
    delta: [f64; UNKNOWNS],
    pub(super) gain: f64,
    /// Sum of squares that is left after it.
    pub(super) left: f64,
}

impl Step {
    pub(super) fn new(normal: &Factor, sums: &[f64; UNKNOWNS], squared: f64) -> Self {
        let found = normal.solve(sums);
        let explained: f64 = found.iter().zip(sums).map(|(a, b)| a * b).sum();
        let gain = 1.0 + found[7];
        let usable = gain.clamp(GAIN_RANGE.0, GAIN_RANGE.1);
        Self {
            delta: found.map(|unknown| unknown / usable),
            gain,
            left: (squared - explained).max(0.0),
        }
    }

    /// How far it moves the window's rim, in pixels.
    pub(super) fn size(&self) -> f64 {
        self.delta[..6]
            .iter()
            .map(|part| part * part)
            .sum::<f64>()
            .sqrt()
    }

    /// `warp` after the step, for a window of so many pixels from the centre to the rim.
    pub(super) fn apply(&self, warp: Warp, half: f64) -> Warp {
        let delta = &self.delta;
        let change = [
            [1.0 + delta[1] / half, delta[2] / half],
            [delta[4] / half, 1.0 + delta[5] / half],
        ];
        let matrix = product(warp.matrix, inverted(change));
        let moved = Warp { matrix, ..warp }.turn([delta[0], delta[3]]);
        Warp {
            shift: [warp.shift[0] - moved[0], warp.shift[1] - moved[1]],
            matrix,
        }
    }
}

/// Sum of the squares of the intensity without what an offset and its slopes explain, one after the other.
fn contrast(sums: &[[f64; UNKNOWNS]; UNKNOWNS]) -> f64 {
    let [one, level, along, down] = [6, 7, 8, 9];
    let of = |a: usize, b: usize| sums[a.min(b)][a.max(b)];
    let mut left = of(level, level);
    // Orthogonal to those before: the sum with the level, and its own square.
    let share = of(one, level) / of(one, one);
    left -= share * of(one, level);
    let mean = [along, down].map(|slope| of(one, slope) / of(one, one));
    let with_level =
        [0, 1].map(|axis| of([along, down][axis], level) - mean[axis] * of(one, level));
    let square = |i: usize, j: usize| {
        of([along, down][i], [along, down][j]) - mean[i] * of(one, [along, down][j])
    };
    let (xx, xy, yy) = (square(0, 0), square(0, 1), square(1, 1));
    if xx > 0.0 {
        left -= with_level[0] * with_level[0] / xx;
        let (rest, with) = (yy - xy * xy / xx, with_level[1] - xy / xx * with_level[0]);
        if rest > 1e-9 * yy {
            left -= with * with / rest;
        }
    }
    left.max(0.0)
}

/// The normal equations of a template, factored: U'U of the unknowns that the lighting model has.
pub(super) struct Factor {
    active: [bool; UNKNOWNS],
    upper: [[f64; UNKNOWNS]; UNKNOWNS],
    /// Sum of squares of the intensity without what the offset and its slopes explain.
    pub(super) contrast: f64,
}

/// Share of an unknown's energy that the unknowns before it must leave to it.
const LEAST_SHARE: f64 = 1e-6;

impl Factor {
    /// `None` if the window's texture does not fix the warp.
    pub(super) fn new(sums: &[[f64; UNKNOWNS]; UNKNOWNS], light: Light) -> Option<Self> {
        let mut active = [true; UNKNOWNS];
        active[6] = light.has_offset();
        active[7] = light.has_gain();
        active[8] = light.has_tilt();
        active[9] = light.has_tilt();
        let contrast = contrast(sums);
        let mut upper = [[0.0; UNKNOWNS]; UNKNOWNS];
        for row in 0..UNKNOWNS {
            if !active[row] {
                continue;
            }
            for column in row..UNKNOWNS {
                let mut value = sums[row][column];
                for above in &upper[..row] {
                    value -= above[row] * above[column];
                }
                if column == row {
                    if !(value > LEAST_SHARE * sums[row][row] && value.is_finite()) {
                        return None;
                    }
                    upper[row][row] = value.sqrt();
                } else if active[column] {
                    upper[row][column] = value / upper[row][row];
                }
            }
        }
        Some(Self {
            active,
            upper,
            contrast,
        })
    }

    /// The mean square that is left of so many pixels.
    pub(super) fn variance(&self, left: f64, area: f64) -> f64 {
        let unknowns = self.active.iter().filter(|active| **active).count();
        left / (area - unknowns as f64).max(1.0)
    }

    /// The unknowns for these sums; 0 for those that the model has not.
    fn solve(&self, sums: &[f64; UNKNOWNS]) -> [f64; UNKNOWNS] {
        let mut found = [0.0; UNKNOWNS];
        for row in 0..UNKNOWNS {
            if self.active[row] {
                let known: f64 = (0..row).map(|k| self.upper[k][row] * found[k]).sum();
                found[row] = (sums[row] - known) / self.upper[row][row];
            }
        }
        for row in (0..UNKNOWNS).rev() {
            if self.active[row] {
                let known: f64 = (row + 1..UNKNOWNS)
                    .map(|k| self.upper[row][k] * found[k])
                    .sum();
                found[row] = (found[row] - known) / self.upper[row][row];
            }
        }
        found
    }

    /// Covariance of the displacement in `next` for what is left with variance 1 a pixel: xx, xy, yy.
    pub(super) fn covariance(&self, warp: &Warp, gain: f64) -> [f64; 3] {
        let unit = |index: usize| {
            let mut sums = [0.0; UNKNOWNS];
            sums[index] = 1.0;
            self.solve(&sums)
        };
        let (x, y) = (unit(0), unit(3));
        let own = [[x[0], x[3]], [y[0], y[3]]];
        let [[a, b], [c, d]] = warp.matrix;
        let turned = product(product(warp.matrix, own), [[a, c], [b, d]]);
        let scale = 1.0 / (gain * gain);
        [
            turned[0][0] * scale,
            turned[0][1] * scale,
            turned[1][1] * scale,
        ]
    }
}
