//! What a coarse level says of the flow that was found.
//!
//! Where the finest level is drowned in noise, blurred or without texture of its own, larger windows may still tell whether
//! the flow is right: they would hardly move it.

use crate::error::Result;

use super::coarse_to_fine::{CoarseToFine, Memory};
use super::padded_plane::{self, PaddedPlane};
use super::step::{self, StepOptions};
use super::windows::Views;

/// The level: a quarter of the size of the frames.
const LEVEL: usize = 2;
/// Half its windows, in pixels of the level.
const RADIUS: usize = 3;
/// The flow is supported where they would move it by less, in pixels of the level.
const AGREES: f32 = 0.15;
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
            ..self.step_options(LEVEL)
        };
        let Memory {
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
        let to = (&mut *to_u, &mut *to_v, energy);
        step::sparse_step(views, &options, to, Some(&mut *support), self.execution)?;
        for y in 0..support.fit.height() {
            let row = support.fit.padded_mut(y);
            let (before, after) = ([u.row(2 * y), v.row(2 * y)], [to_u.row(y), to_v.row(y)]);
            for x in 0..width.div_ceil(2) {
                let [du, dv] = [0, 1].map(|axis| after[axis][x] - before[axis][2 * x]);
                let fit = &mut row[padded_plane::PAD + x];
                *fit = fit.min(AGREES * AGREES - (du * du + dv * dv));
            }
        }
        Ok(())
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
