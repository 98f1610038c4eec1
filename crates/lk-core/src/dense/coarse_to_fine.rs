//! One pair of frames, from the coarsest level to the finest.
//!
//! `docs/explanation/algorithms.md`, section "Dense flow: dense_flow".

use crate::error::Result;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::parallel::both;

use super::levels::{CoarseToFine, first_level};
use super::options::DenseHints;
use super::workspace::Workspace;

/// Light is estimated on levels of at most this many pixels along the longer side, and carried over to finer ones.
pub(super) const LIGHT_SIZE: usize = 100;

/// In small frames the levels that the measurement starts with end here in steady light: finer ones are measured better, and in
/// less time, as those of large frames are. Light is still estimated on finer levels.
const STEADY_FIRST: usize = 2;
/// But not on levels whose shorter side is below this, in pixels: their windows would hold most of the level.
const LEAST_FIRST: usize = 12;

/// The finest level whose flow is filled in where windows say little: on finer ones that costs more than it gains.
const FILLED: usize = 2;

impl CoarseToFine<'_> {
    /// Measure all levels, and judge the flow of the finest one. Returns the level of the light's estimate, if light is
    /// found to have changed.
    pub(super) fn run(&mut self, hints: DenseHints<'_>) -> Result<Option<usize>> {
        let coarsest = first_level(self.prev, hints);
        let small = |plane: &Plane| plane.width().max(plane.height()) <= LIGHT_SIZE;
        let levels = self.prev.levels();
        let most = levels
            .iter()
            .rposition(|plane| plane.width().min(plane.height()) >= LEAST_FIRST)
            .unwrap_or(0)
            .min(coarsest);
        let of_light = levels.iter().position(small).unwrap_or(coarsest);
        let of_light = of_light.max(1.min(most)).min(coarsest);
        let first = of_light.max(STEADY_FIRST.min(most)).min(coarsest);
        self.first = first;
        let mut looks = std::mem::take(&mut self.memory.looks);
        looks.take(
            &self.prev.levels()[first],
            self.weighted.then(|| &self.memory.weights[first]),
        )?;
        let wants_light = self.options.illumination == Illumination::GainOffset;
        let (execution, next) = (self.execution, &self.next.levels()[first]);
        let (measured, looked) = both(
            execution,
            || self.coarse(first, hints, false),
            || looks.look(next, hints.initial.is_none(), wants_light),
        )?;
        let (contrast, lit) = (looks.contrast, looks.lit);
        self.memory.looks = looks;
        measured.and(looked)?;
        // A search that finds nothing leaves energies of its own behind.
        let mut misfit = self.memory.misfit();
        self.found = match contrast {
            Some(contrast) => self.search(first, contrast, misfit)?,
            None => false,
        };
        if self.found {
            misfit = self.memory.misfit();
        }
        let lit = if lit {
            self.relight(of_light, hints, misfit)?
        } else {
            None
        };
        let first = self.first;
        if let Some(mask) = hints.next_mask {
            self.drop_masked(mask, first)?;
            self.coarse(first, hints, false)?;
        }
        let finest = self.options.recipe.finest.min(first);
        // Where a flow is given what is lost is not looked for.
        let matched = if hints.initial.is_none() {
            finest.max(first.saturating_sub(1))
        } else {
            usize::MAX
        };
        if matched == first {
            self.match_lost(first)?;
        }
        for level in (finest..first).rev() {
            self.memory.halved = Some(2.0);
            self.level(level, true)?;
            if level == matched {
                self.match_lost(level)?;
            }
            if level >= FILLED {
                self.fill(level, 2)?;
            }
            if level > 0 {
                self.whole(level)?;
            }
        }
        self.finish(finest)?;
        Ok(lit)
    }

    /// What is left once `finest`, the last level, is measured: what its windows say of the frames, and what a coarse level
    /// says of the flow.
    fn finish(&mut self, finest: usize) -> Result<()> {
        if finest > 0 {
            // What is of the size of the finest level measured is of half the size of the frames.
            self.memory.halved = Some(2.0);
            if self.judged {
                let frame = &self.prev.levels()[0];
                let size = (frame.width(), frame.height());
                let Workspace { judged, spare, .. } = &mut *self.memory;
                judged.spread(size, &mut spare[0])?;
            }
        }
        if !self.judged {
            self.judge()?;
        }
        self.find_support()
    }
}
