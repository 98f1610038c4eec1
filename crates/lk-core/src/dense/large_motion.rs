//! Motion that is too large for the pyramid: displacements found by phase correlation are tried everywhere.
//!
//! The coarsest level sees a few pixels of motion at most, and what is as small as that motion is not seen there at all.
//! Where most windows are left without a match, the displacements of the whole picture and of its tiles are tried on the
//! level of about 100 pixels, and each pixel keeps the one that fits it best.
//!
//! `docs/explanation/algorithms.md`, section "Large motion".

use crate::displacement_hypotheses::Hypotheses;
use crate::error::Result;

use super::levels::CoarseToFine;
use super::padded_plane;
use super::trend::Trend;
use super::workspace::Workspace;

/// Motion is looked for where the misfit of windows is above this share of their contrast: unrelated windows have 1.4
/// times their contrast, windows that match next to nothing, and under light that is not modelled yet up to half.
const LOST: f64 = 0.6;

/// What is found is kept if it leaves less than this share of the misfit.
const FOUND: f64 = 0.9;

/// Displacements that differ by less than this many pixels of the level are one: the steps bridge them.
const APART: f64 = 2.0;

/// Most displacements that are tried.
const MOST: usize = 12;

/// Half the windows over which misfit is compared: what one pixel of the level says of a displacement is chance.
const SUPPORT: usize = 3;

impl CoarseToFine<'_> {
    /// Improve the flow of level `level`, which has just been measured, if its misfit `before` is lost for the contrast of `prev`
    /// there.
    /// Returns whether that has led to anything; the flow is then in `memory.found` too.
    pub(super) fn search(&mut self, level: usize, contrast: f64, before: f64) -> Result<bool> {
        if before <= LOST * contrast {
            return Ok(false);
        }
        let scale = (1usize << level) as f64;
        let hypotheses = Hypotheses::find(self.prev.levels(), self.next.levels(), self.execution)?;
        self.memory.keep_flow();
        let Workspace { best, found, .. } = &mut *self.memory;
        for (found, best) in found.iter_mut().zip(best) {
            found.copy_from(best)?;
        }
        self.memory.widen_energy()?;
        self.memory.found_energy.copy_from(&self.memory.energy)?;
        let most = self.options.max_displacement.map_or(f64::MAX, f64::from);
        for hypothesis in hypotheses.distinct(APART * scale).into_iter().take(MOST) {
            if hypothesis[0].hypot(hypothesis[1]) > most + scale {
                continue;
            }
            let plane = &self.prev.levels()[level];
            for (grid, value) in self.memory.flow.iter_mut().zip(hypothesis) {
                grid.resize(plane.width(), plane.height())?;
                grid.fill((value / scale) as f32);
            }
            self.memory.trend = Trend::default();
            self.level(level, false)?;
            self.whole(level)?;
            self.memory.widen_energy()?;
            self.memory.keep_what_fits();
        }
        std::mem::swap(&mut self.memory.flow, &mut self.memory.found);
        self.memory.trend = Trend::default();
        self.level(level, false)?;
        self.whole(level)?;
        let better = self.memory.misfit() < FOUND * before;
        if !better {
            self.memory.take_best_flow();
            return Ok(false);
        }
        let Workspace {
            flow,
            found,
            trend,
            found_trend,
            ..
        } = &mut *self.memory;
        for (found, flow) in found.iter_mut().zip(&*flow) {
            found.copy_from(flow)?;
        }
        *found_trend = *trend;
        Ok(true)
    }
}

impl Workspace {
    /// Replace each energy by the mean over the windows around it; those that are unknown stay so and do not count.
    pub(super) fn widen_energy(&mut self) -> Result<()> {
        let Self {
            energy,
            spare: [sums, counts],
            ..
        } = self;
        let (width, height) = (energy.width(), energy.height());
        sums.resize(width, height)?;
        counts.resize(width, height)?;
        for y in 0..height {
            let row = energy.row(y);
            let (sums, counts) = (sums.padded_mut(y), counts.padded_mut(y));
            for x in 0..width {
                let window = &row[x.saturating_sub(SUPPORT)..(x + SUPPORT + 1).min(width)];
                let known = window.iter().filter(|energy| **energy < f32::MAX);
                let (sum, count) = known.fold((0.0, 0.0), |(sum, count), energy| {
                    (sum + energy, count + 1.0)
                });
                (sums[padded_plane::PAD + x], counts[padded_plane::PAD + x]) = (sum, count);
            }
        }
        for y in 0..height {
            let rows = y.saturating_sub(SUPPORT)..(y + SUPPORT + 1).min(height);
            let row = energy.padded_mut(y);
            for x in 0..width {
                let over = |grid: &padded_plane::PaddedPlane| {
                    rows.clone().map(|y| grid.row(y)[x]).sum::<f32>()
                };
                let energy = &mut row[padded_plane::PAD + x];
                if *energy < f32::MAX {
                    *energy = over(sums) / over(counts);
                }
            }
            padded_plane::extend(row, width);
        }
        Ok(())
    }

    /// Take over into `found` the flow at pixels where it fits better than what is there.
    pub(super) fn keep_what_fits(&mut self) {
        let (width, height) = (self.energy.width(), self.energy.height());
        for y in 0..height {
            let energy = self.energy.padded(y);
            let kept = self.found_energy.padded_mut(y);
            for axis in 0..2 {
                let flow = self.flow[axis].padded(y);
                let found = self.found[axis].padded_mut(y);
                for x in padded_plane::PAD..padded_plane::PAD + width {
                    if energy[x] < kept[x] {
                        found[x] = flow[x];
                    }
                }
                padded_plane::extend(found, width);
            }
            for x in padded_plane::PAD..padded_plane::PAD + width {
                kept[x] = kept[x].min(energy[x]);
            }
        }
    }
}
