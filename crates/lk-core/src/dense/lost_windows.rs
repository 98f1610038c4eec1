//! Windows that are left without a match are sought ([`block_matching`](super::block_matching)), and what is found is taken
//! where it fits better.
//!
//! `docs/explanation/algorithms.md`, section "Large motion".

use crate::error::Result;

use super::block_matching::Matching;
use super::levels::CoarseToFine;
use super::trend::Trend;

impl CoarseToFine<'_> {
    /// Seek what is lost on `level`, which has just been measured, and take its flow where that fits better. The flow is of
    /// full size then.
    pub(super) fn match_lost(&mut self, level: usize) -> Result<()> {
        let mut matching = std::mem::take(&mut self.memory.matching);
        let done = self.match_with(level, &mut matching);
        self.memory.matching = matching;
        done
    }

    fn match_with(&mut self, level: usize, matching: &mut Matching) -> Result<()> {
        let (prev, next) = (&self.prev.levels()[level], &self.next.levels()[level]);
        let energy = &self.memory.energy;
        let radius = self.level_recipe(level).radius;
        let weight = self.weighted.then(|| &self.memory.weights[level]);
        if !matching.find_lost(prev, energy, radius, weight)? {
            return Ok(());
        }
        self.execution.check()?;
        let simd = self.execution.simd_level();
        let most = self
            .options
            .max_displacement
            .map(|most| most / (1u32 << level) as f32);
        if !matching.search([prev, next], most, simd)? {
            return Ok(());
        }
        // What is there, and what is found, each improved in the same way: without refinement, whose smoothness draws what
        // is small along with what is around it.
        self.whole(level)?;
        self.steps(level, false)?;
        self.whole(level)?;
        self.memory.widen_energy()?;
        let memory = &mut *self.memory;
        for (found, flow) in memory.found.iter_mut().zip(&memory.flow) {
            found.copy_from(flow)?;
        }
        memory.found_energy.copy_from(&memory.energy)?;
        matching.write(&mut memory.flow);
        memory.trend = Trend::default();
        self.steps(level, false)?;
        self.whole(level)?;
        self.memory.widen_energy()?;
        self.memory.keep_what_fits();
        std::mem::swap(&mut self.memory.flow, &mut self.memory.found);
        self.memory.trend = Trend::default();
        self.steps(level, false)?;
        self.whole(level)
    }
}
