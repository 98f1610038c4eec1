//! Light that has changed: what it did is found on coarse levels, and all levels of `prev` are brought to it.

use ndarray::ArrayView2;

use crate::error::Result;
use crate::frame::Plane;
use crate::memory::resize;

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
/// No other guess is tried where the first ones leave more than this share of it.
const HOPELESS: f64 = 0.97;
/// No other guess is tried where one leaves less than this share of the misfit.
const SURE: f64 = 0.3;

impl CoarseToFine<'_> {
    /// Find what the light did, on level `first` and coarser ones, bring all levels of `prev` to it, and measure those
    /// levels again; `first`, or `None` and nothing has happened where no change of light fits. `before` is the misfit of
    /// the flow so far.
    pub(super) fn relight(
        &mut self,
        first: usize,
        hints: DenseHints<'_>,
        before: f64,
    ) -> Result<Option<usize>> {
        let mut least = CHANGED * before;
        let mut lit = None;
        let mut best_short = false;
        let mut tried = f64::MAX;
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
                tried = tried.min(misfit);
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
            if lit.is_none() && tried > HOPELESS * before {
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
            near,
            ..
        } = &mut *self.memory;
        let finest = &mut self.prev.levels_mut()[0];
        unclipped.resize(finest.width(), finest.height())?;
        light.apply_clipped(finest, from, self.ranges, unclipped, self.execution)?;
        self.prev.reduce_again(self.execution)?;
        let most = FEW_CLIPPED * unclipped.data().len() as f32;
        let few = |clipped: usize| (clipped as f32) < most;
        let mut clipped = zeros(unclipped);
        if let Some([low, high]) = self.ranges[1] {
            // What rounding leaves of a limit.
            let margin = 1e-3 * (high - low);
            let (next, limits) = (&self.next.levels()[0], [low + margin, high - margin]);
            // Nine pixels are beside each.
            if few(clipped + 9 * at_limits(next, limits)) {
                return Ok(());
            }
            near_limits(next, limits, near)?;
            drop_clipped(unclipped, near, [u, v], from);
            clipped = zeros(unclipped);
        }
        if few(clipped) {
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

    /// Let the pixels count for nothing that the flow of level `from` leads to what is masked in `next`, or beside it.
    pub(super) fn drop_masked(&mut self, mask: ArrayView2<'_, bool>, from: usize) -> Result<()> {
        let Memory {
            flow: [u, v],
            weights,
            unclipped,
            near,
            ..
        } = &mut *self.memory;
        let plane = &self.prev.levels()[0];
        let width = plane.width();
        near.clear();
        resize("masked pixels", near, width * plane.height(), 0)?;
        for (y, row) in near.chunks_exact_mut(width).enumerate() {
            for (x, near) in row.iter_mut().enumerate() {
                *near = u8::from(!mask[(y, x)]);
            }
        }
        widen(near, width);
        if self.weighted {
            unclipped.copy_of(&weights[0])?;
        } else {
            unclipped.resize(width, plane.height())?;
            unclipped.data_mut().fill(1.0);
        }
        drop_clipped(unclipped, near, [u, v], from);
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

/// Pixels that weigh nothing.
fn zeros(weights: &Plane) -> usize {
    let nothing = |weight: &f32| u32::from(*weight == 0.0);
    let of_row = |y| weights.row(y).iter().map(nothing).sum::<u32>() as usize;
    (0..weights.height()).map(of_row).sum()
}

/// Pixels of `next` at its limits.
fn at_limits(next: &Plane, [low, high]: [f32; 2]) -> usize {
    let beyond = |value: &f32| u32::from(*value <= low) | u32::from(*value >= high);
    let of_row = |y| next.row(y).iter().map(beyond).sum::<u32>() as usize;
    (0..next.height()).map(of_row).sum()
}

/// Write which pixels of `next` are at its limits, or beside one that is: smoothing has spread what was clipped by a pixel.
fn near_limits(next: &Plane, [low, high]: [f32; 2], near: &mut Vec<u8>) -> Result<()> {
    let width = next.width();
    near.clear();
    resize("pixels at the limits", near, width * next.height(), 0)?;
    for y in 0..next.height() {
        let row = &mut near[y * width..][..width];
        for (near, value) in row.iter_mut().zip(next.row(y)) {
            *near = u8::from(*value <= low) | u8::from(*value >= high);
        }
    }
    widen(near, width);
    Ok(())
}

/// Mark what lies beside a marked pixel, in rows of `width`.
fn widen(near: &mut [u8], width: usize) {
    for row in near.chunks_exact_mut(width) {
        let mut before = 0;
        for x in 0..width {
            let here = row[x];
            row[x] |= before | row.get(x + 1).unwrap_or(&0);
            before = here;
        }
    }
    // Each row takes what the one above was, and the one below is.
    for y in 1..near.len() / width {
        let (above, here) = near[(y - 1) * width..][..2 * width].split_at_mut(width);
        for (above, here) in above.iter_mut().zip(here) {
            let own = *above & 1;
            *above |= *here & 1;
            *here |= own << 1;
        }
    }
}

/// Set the weight of pixels to 0 that the flow of level `from` leads to what is `near` limits of `next` or masked there: where
/// the light is not found that bright or dark, it still says nothing.
fn drop_clipped(unclipped: &mut Plane, near: &[u8], [u, v]: [&PaddedPlane; 2], from: usize) {
    let (width, height) = (unclipped.width(), unclipped.height());
    let (scale, step) = ((1usize << from) as f32, 1usize << from);
    for y in 0..height {
        let coarse = (y >> from).min(u.height() - 1);
        let (row_u, row_v) = (u.row(coarse), v.row(coarse));
        let weights = unclipped.row_mut(y);
        for (cell, (du, dv)) in row_u.iter().zip(row_v).enumerate() {
            let [du, dv] = [du, dv].map(|value| (value * scale).round() as isize);
            let Some(row) = y.checked_add_signed(dv).filter(|row| *row < height) else {
                continue;
            };
            let columns = (cell * step).min(width)..((cell + 1) * step).min(width);
            // Those that stay within the row.
            let first = columns.start.max(0usize.saturating_add_signed(-du));
            let last = columns.end.min(width.saturating_add_signed(-du));
            let Some(to) = first.checked_add_signed(du).filter(|_| first < last) else {
                continue;
            };
            let near = &near[row * width + to..];
            for (weight, near) in weights[first..last].iter_mut().zip(near) {
                if *near != 0 {
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::padded_plane::{PAD, extend};
    use super::*;

    proptest! {
        #[test]
        fn what_leads_to_clipped_pixels_or_beside_them_weighs_nothing(
            width in 1usize..40, height in 1usize..20, seed in any::<u32>(), from in 0usize..3
        ) {
            let value = |k: usize| (k as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) >> 16;
            let mut next = Plane::new(width, height).unwrap();
            for y in 0..height {
                for x in 0..width {
                    next.row_mut(y)[x] = (value(y * width + x) % 30) as f32;
                }
            }
            let size = (width.div_ceil(1 << from), height.div_ceil(1 << from));
            let flow = [1, 2].map(|axis| {
                let mut grid = PaddedPlane::default();
                grid.resize(size.0, size.1).unwrap();
                for y in 0..size.1 {
                    let row = grid.padded_mut(y);
                    for x in 0..size.0 {
                        row[PAD + x] = (value(axis * 977 + y * size.0 + x) % 9) as f32 - 4.0;
                    }
                    extend(row, size.0);
                }
                grid
            });
            let [low, high] = [0.5, 28.5];
            let mut near = Vec::new();
            near_limits(&next, [low, high], &mut near).unwrap();
            let mut weights = Plane::new(width, height).unwrap();
            weights.data_mut().fill(1.0);
            drop_clipped(&mut weights, &near, flow.each_ref(), from);
            for y in 0..height {
                for x in 0..width {
                    let [dx, dy] = flow.each_ref().map(|grid| {
                        (grid.row(y >> from)[x >> from] * (1 << from) as f32).round() as isize
                    });
                    let (to_x, to_y) = (x as isize + dx, y as isize + dy);
                    let inside = |x: isize, y: isize| {
                        (0..width as isize).contains(&x) && (0..height as isize).contains(&y)
                    };
                    let clipped = inside(to_x, to_y) && (-1..=1).any(|dy| (-1..=1).any(|dx| {
                        let (x, y) = (to_x + dx, to_y + dy);
                        inside(x, y) && {
                            let value = next.row(y as usize)[x as usize];
                            value <= low || value >= high
                        }
                    }));
                    prop_assert_eq!(weights.row(y)[x] == 0.0, clipped, "{} {}", x, y);
                }
            }
            let clipped = next.data().iter().filter(|value| **value <= low || **value >= high).count();
            prop_assert_eq!(at_limits(&next, [low, high]), clipped);
        }
    }
}
