//! Light that has changed: what it did is found on coarse levels, and all levels of `prev` are brought to it.

use crate::error::Result;
use crate::frame::Plane;

use super::coarse_to_fine::{CoarseToFine, Memory};
use super::light::Light;
use super::options::DenseHints;
use super::padded_plane::PaddedPlane;
use super::weights;
use super::windows::Views;

/// Half the windows of its trend over the picture, and of what differs locally, in pixels of those levels. Where light
/// has changed, all are tried: on coarse levels a wrong guess can lead the flow astray.
const LIGHT_RADII: [(usize, usize); 4] = [(3, 8), (2, 8), (5, 12), (3, 6)];
/// Whether it has changed is looked at closely where the logarithm of the gain exceeds this.
const SUSPICIOUS: f64 = 0.05;
/// Light is taken to have changed where that leaves less than this share of the misfit.
const CHANGED: f64 = 0.9;
/// Below this share of the frame pixels at its limits are the extremes of any frame, not those of a sensor.
const FEW_CLIPPED: f32 = 0.001;
/// No other guess is tried where one leaves less than this share of the misfit.
const SURE: f64 = 0.3;

impl CoarseToFine<'_> {
    /// Find what the light did, on level `first` and coarser ones, bring all levels of `prev` to it, and measure those
    /// levels again; `first`, or `None` and nothing has happened where no change of light fits.
    pub(super) fn relight(&mut self, first: usize, hints: DenseHints<'_>) -> Result<Option<usize>> {
        let before = self.memory.misfit();
        let mut least = CHANGED * before;
        let mut lit = None;
        let mut best_short = false;
        self.memory.keep_flow();
        let levels = &self.prev.levels()[first..];
        self.memory.coarse.resize_with(levels.len(), Plane::default);
        for (kept, plane) in self.memory.coarse.iter_mut().zip(levels) {
            kept.copy_of(plane)?;
        }
        let starts: &[bool] = if hints.initial.is_none() {
            &[false, true]
        } else {
            &[false]
        };
        'guesses: for radii in &LIGHT_RADII[..self.options.recipe.lights] {
            for short in starts {
                self.short = *short;
                self.coarse(first, hints, Some(*radii))?;
                let levels = &mut self.prev.levels_mut()[first..];
                for (kept, plane) in self.memory.coarse.iter().zip(levels) {
                    plane.copy_of(kept)?;
                }
                let misfit = self.memory.misfit();
                if misfit < least {
                    least = misfit;
                    lit = Some(first);
                    best_short = *short;
                    self.memory.keep_flow();
                    let Memory {
                        light, best_light, ..
                    } = &mut *self.memory;
                    std::mem::swap(light, best_light);
                }
                if least < SURE * before {
                    break 'guesses;
                }
            }
            if lit.is_none() {
                break;
            }
        }
        self.memory.take_best_flow();
        let Memory {
            light, best_light, ..
        } = &mut *self.memory;
        std::mem::swap(light, best_light);
        if lit.is_some() {
            self.short = best_short;
            self.relight_all(first)?;
            self.coarse(first, hints, None)?;
        }
        self.short = false;
        Ok(lit)
    }

    /// Give `prev` the light of `next` on all levels, as level `from` has seen it. A sensor clips what is beyond its range,
    /// which says nothing of motion: pixels at the limits of either frame weigh nothing from here on.
    fn relight_all(&mut self, from: usize) -> Result<()> {
        let Memory {
            flow: [u, v],
            light,
            weights,
            unclipped,
            ..
        } = &mut *self.memory;
        let finest = &mut self.prev.levels_mut()[0];
        unclipped.resize(finest.width(), finest.height())?;
        light.apply_clipped(finest, from, self.ranges, unclipped, self.execution)?;
        if let Some(range) = self.ranges[1] {
            drop_clipped(unclipped, &self.next.levels()[0], [u, v], from, range);
        }
        self.prev.reduce_again(self.execution)?;
        let clipped = unclipped
            .data()
            .iter()
            .filter(|weight| **weight == 0.0)
            .count();
        if (clipped as f32) < FEW_CLIPPED * unclipped.data().len() as f32 {
            return Ok(());
        }
        if self.weighted {
            for (to, given) in unclipped.data_mut().iter_mut().zip(weights[0].data()) {
                *to *= given;
            }
        }
        self.weighted = true;
        weights::pyramid(unclipped, self.prev, weights)
    }

    /// Give `prev` the light of `next`, as the flow so far sees it.
    pub(super) fn relight_level(&mut self, level: usize, radii: (usize, usize)) -> Result<()> {
        let Memory {
            flow: [u, v],
            light,
            weights,
            ..
        } = &mut *self.memory;
        let weight = self.weighted.then(|| &weights[level]);
        let (prev, next) = (&self.prev.levels()[level], &self.next.levels()[level]);
        let simd = self.execution.simd_level();
        light.estimate(
            Views {
                prev,
                next,
                u,
                v,
                halved: None,
                weight,
            },
            radii.0,
            radii.1,
            simd,
        )?;
        light.apply(&mut self.prev.levels_mut()[level]);
        Ok(())
    }
}

/// Set the weight of pixels to 0 that the flow of level `from` leads to what is at the limits of `next`: where the light is
/// not found that bright or dark, it still says nothing.
fn drop_clipped(
    unclipped: &mut Plane,
    next: &Plane,
    [u, v]: [&PaddedPlane; 2],
    from: usize,
    [low, high]: [f32; 2],
) {
    let (width, height) = (next.width(), next.height());
    let (scale, step) = ((1usize << from) as f32, 1usize << from);
    // What rounding leaves of a limit.
    let margin = 1e-3 * (high - low);
    let (low, high) = (low + margin, high - margin);
    for y in 0..height {
        let coarse = (y >> from).min(u.height() - 1);
        let (row_u, row_v) = (u.row(coarse), v.row(coarse));
        let weights = unclipped.row_mut(y);
        for (cell, (du, dv)) in row_u.iter().zip(row_v).enumerate() {
            let [du, dv] = [du, dv].map(|value| (value * scale).round() as isize);
            let Some(row) = y.checked_add_signed(dv).filter(|row| *row < height) else {
                continue;
            };
            // Smoothing has spread what was clipped by a pixel.
            let rows =
                [row.saturating_sub(1), row, (row + 1).min(height - 1)].map(|row| next.row(row));
            let clipped = |x: usize| {
                let near = x.saturating_sub(1)..(x + 2).min(width);
                rows.iter().any(|row| {
                    let near = row.get(near.clone()).unwrap_or_default();
                    near.iter().any(|value| *value <= low || *value >= high)
                })
            };
            let columns = (cell * step).min(width)..((cell + 1) * step).min(width);
            for (x, weight) in columns.clone().zip(&mut weights[columns]) {
                let place = x.checked_add_signed(du).filter(|x| *x < width);
                if place.is_some_and(clipped) {
                    *weight = 0.0;
                }
            }
        }
    }
}

/// Whether the light may have changed by more than an offset from `prev` to `next`, a coarse level of both.
pub(super) fn gain_matters(
    memory: &mut Light,
    prev: &Plane,
    next: &Plane,
    weight: Option<&Plane>,
) -> Result<bool> {
    let [trend, beyond] = memory.change(prev, next, weight, LIGHT_RADII[0].1)?;
    Ok(trend > SUSPICIOUS || beyond > 2.0 * SUSPICIOUS)
}
