//! What a coarse level says of the flow that was found.
//!
//! Where the finest level is drowned in noise, blurred or without texture of its own, larger windows may still tell whether
//! the flow is right: by how far they would move it, and how well they know that. Noise adds to the structure tensor and
//! makes steps short, as does damping: both are taken out before the steps are weighed and averaged.
//!
//! `docs/explanation/algorithms.md`, section "Confidence and validity".

use crate::error::Result;
use crate::frame::Plane;

use super::confidence::Judged;
use super::levels::CoarseToFine;
use super::padded_plane::{self, PAD, PaddedPlane};
use super::step::{self, StepOptions};
use super::windows::Views;
use super::workspace::Workspace;

/// The level: a quarter of the size of the frames.
const LEVEL: usize = 2;
/// Half its windows, in pixels of the level.
const RADIUS: usize = 3;
/// The flow is supported where the mean step around and its deviation together are less, in pixels of the level.
const AGREES: f32 = 0.25;
/// Half the square of windows whose steps are averaged; they stand two pixels apart.
const AROUND: usize = 2;
/// Mean squared differences that noise alone has, as a multiple of the smaller eigenvalue of its structure tensor.
const NOISE: f32 = 10.0;
/// The share of the smaller eigenvalue that must not come from noise.
const SIGNAL: f32 = 0.25;
/// The least eigenvalue that is texture, and the noise of the quietest pictures, in squared grey levels.
const TEXTURE: f32 = 0.02;
const QUIET: f32 = 0.02;
/// Pixels of a window that are independent of each other: the filter of the pyramid joins neighbours.
const INDEPENDENT: f32 = 25.0;
/// Half the middle of a window, in pixels of the level, and the mean squared slope there over the least eigenvalue of the window
/// below which it is empty: evenly textured windows have two and more.
const MIDDLE: usize = 1;
const EMPTY: f32 = 0.4;
/// No step is known better, in pixels of the level.
const FLOOR: f32 = 0.02;
/// Beside the support at pixel (x, y) lies that of the pixels of the grid of judgements from there on.
pub(super) const APART: usize = 1 << LEVEL;

impl CoarseToFine<'_> {
    /// Find where the flow of the finest level is supported. `memory.support.fit` is at least 0 there, for pixel (2x, 2y) of
    /// the level; of no size where the frames have no such level.
    pub(super) fn find_support(&mut self) -> Result<()> {
        let Some(plane) = self.prev.levels().get(LEVEL) else {
            return self.memory.support.resize(0, 0);
        };
        let (width, height) = (plane.width(), plane.height());
        let options = StepOptions {
            radius: RADIUS,
            max_step: 1.0,
            measures: true,
            ..self.step_options(LEVEL)
        };
        let Workspace {
            flow,
            halved,
            spare: [to_u, to_v],
            best,
            energy,
            support,
            weights,
            ..
        } = &mut *self.memory;
        for (from, to) in flow.iter().zip(&mut *best) {
            subsample(from, *halved, (width, height), to)?;
        }
        let [u, v] = &*best;
        let views = Views {
            prev: plane,
            next: &self.next.levels()[LEVEL],
            u,
            v,
            halved: None,
            weight: self.weighted.then(|| &weights[LEVEL]),
        };
        let to = (&mut *to_u, &mut *to_v, &mut *energy);
        step::sparse_step(views, &options, to, Some(&mut *support), self.execution)?;
        leave_out_empty(plane, support);
        weigh([u, v], [to_u, to_v], options.damping, support);
        sum_around(support, [to_u, to_v, energy]);
        for y in 0..support.fit.height() {
            let (weights, [u, v]) = (to_u.row(y), [to_v.row(y), energy.row(y)]);
            let row = support.fit.padded_mut(y);
            for x in 0..width.div_ceil(2) {
                let own = &mut row[PAD + x];
                *own = if *own > 0.0 {
                    AGREES - unsure_step(weights[x], [u[x], v[x]])
                } else {
                    -1.0
                };
            }
        }
        Ok(())
    }
}

/// Let windows say nothing whose middle is empty beside the rest: what they see is the edge of something else, and the middle may
/// move otherwise.
fn leave_out_empty(plane: &Plane, measured: &mut Judged) {
    let (width, height) = (plane.width(), plane.height());
    for y in 0..measured.fit.height() {
        let rows = (2 * y).saturating_sub(MIDDLE)..(2 * y + MIDDLE + 1).min(height);
        let texture = measured.bearable.row(y);
        let fit = measured.fit.padded_mut(y);
        for (x, texture) in texture.iter().enumerate() {
            let columns = (2 * x).saturating_sub(MIDDLE)..(2 * x + MIDDLE + 1).min(width);
            let mut squares = 0.0;
            for y in rows.clone() {
                let (above, below) = (y.saturating_sub(1), (y + 1).min(height - 1));
                for x in columns.clone() {
                    let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
                    let across = plane.row(y)[right] - plane.row(y)[left];
                    let down = plane.row(below)[x] - plane.row(above)[x];
                    squares += across * across + down * down;
                }
            }
            let count = (rows.len() * columns.len()) as f32;
            // Central differences are twice the slopes.
            if 0.25 * squares < EMPTY * texture * count {
                fit[PAD + x] = -1.0;
            }
        }
    }
}

/// Replace what was measured of each window by the weight of its step, and that times the step along x and along y.
fn weigh(before: [&PaddedPlane; 2], after: [&PaddedPlane; 2], damping: f32, measured: &mut Judged) {
    let (width, height) = (measured.fit.width(), measured.fit.height());
    for y in 0..height {
        let [count, texture, energy] = [
            &mut measured.fit,
            &mut measured.bearable,
            &mut measured.misfit,
        ]
        .map(|grid| grid.padded_mut(y));
        let (before, after) = (
            before.map(|grid| grid.row(2 * y)),
            after.map(|grid| grid.row(y)),
        );
        for x in 0..width {
            let at = PAD + x;
            let energies = energy[at] + QUIET;
            let signal = texture[at] - energies / NOISE;
            let told = count[at] >= 0.0 && texture[at] >= TEXTURE && signal >= SIGNAL * texture[at];
            if !told {
                [count[at], texture[at], energy[at]] = [0.0; 3];
                continue;
            }
            let variance = energies * texture[at] / (INDEPENDENT * signal * signal);
            let weight = 1.0 / (variance + FLOOR * FLOOR);
            let longer = weight * (texture[at] + damping) / signal;
            let [u, v] = [0, 1].map(|axis| after[axis][x] - before[axis][2 * x]);
            [count[at], texture[at], energy[at]] = [weight, longer * u, longer * v];
        }
    }
}

/// Write the sums of the three grids over the squares around each window.
fn sum_around(weighed: &Judged, to: [&mut PaddedPlane; 3]) {
    let grids = [&weighed.fit, &weighed.bearable, &weighed.misfit];
    for (grid, to) in grids.into_iter().zip(to) {
        let (width, height) = (grid.width(), grid.height());
        for y in 0..height {
            let rows = y.saturating_sub(AROUND)..(y + AROUND + 1).min(height);
            let down = to.padded_mut(y);
            down.fill(0.0);
            for near in rows {
                for (sum, value) in down[PAD..PAD + width].iter_mut().zip(grid.row(near)) {
                    *sum += value;
                }
            }
            // Along the row each sum replaces one that is not needed any more: those ahead still are.
            let mut behind = [0.0; AROUND];
            for x in PAD..PAD + width {
                let here = down[x];
                let ahead: f32 = down[x + 1..=x + AROUND].iter().sum();
                down[x] = behind.iter().sum::<f32>() + here + ahead;
                behind.rotate_left(1);
                behind[AROUND - 1] = here;
            }
        }
    }
}

/// The length of a mean step and its deviation together, from the sums of the weights and of the weighted steps.
fn unsure_step(weight: f32, [u, v]: [f32; 2]) -> f32 {
    // Windows that overlap are not independent: the square holds fewer pixels than they do together.
    let (side, across) = (2 * RADIUS + 1, 2 * AROUND + 1);
    let square = (side + 2 * (across - 1)) as f32;
    let overlap = square * square / (side * side * across * across) as f32;
    if weight > 0.0 {
        (u * u + v * v).sqrt() / weight + 1.0 / (overlap * weight).sqrt()
    } else {
        f32::MAX
    }
}

/// Write the flow of the finest level, of half the size or not, at the pixels under those of the level into `to`.
fn subsample(
    from: &PaddedPlane,
    halved: Option<f32>,
    (width, height): (usize, usize),
    to: &mut PaddedPlane,
) -> Result<()> {
    to.resize(width, height)?;
    let step = if halved.is_some() { APART / 2 } else { APART };
    let scale = halved.unwrap_or(1.0) / APART as f32;
    for y in 0..height {
        let source = from.row(y * step);
        let row = to.padded_mut(y);
        for x in 0..width {
            row[padded_plane::PAD + x] = scale * source[x * step];
        }
        padded_plane::extend(row, width);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_squares_around() {
        for (width, height) in [(1, 1), (3, 9), (17, 6)] {
            let mut judged = Judged::default();
            judged.resize(2 * width, 2 * height).unwrap();
            let value = |x: usize, y: usize| (7 * x + 31 * y) as f32 % 13.0;
            for y in 0..height {
                for x in 0..width {
                    judged.misfit.padded_mut(y)[PAD + x] = value(x, y);
                }
            }
            let mut to: [PaddedPlane; 3] = Default::default();
            for grid in &mut to {
                grid.resize(width, height).unwrap();
            }
            sum_around(&judged, to.each_mut());
            for y in 0..height {
                for x in 0..width {
                    let rows = y.saturating_sub(AROUND)..(y + AROUND + 1).min(height);
                    let want: f32 = rows
                        .flat_map(|y| {
                            let columns = x.saturating_sub(AROUND)..(x + AROUND + 1).min(width);
                            columns.map(move |x| value(x, y))
                        })
                        .sum();
                    assert_eq!(to[2].row(y)[x], want, "{width} {height}: {x} {y}");
                }
            }
        }
    }

    #[test]
    fn a_mean_step_without_weight_is_unsure() {
        assert_eq!(unsure_step(0.0, [0.0; 2]), f32::MAX);
        assert!(unsure_step(1e6, [1e5, 0.0]) < AGREES);
        assert!(unsure_step(1e6, [3e5, 0.0]) > AGREES);
        assert!(unsure_step(1.0, [0.0; 2]) > AGREES);
    }
}
