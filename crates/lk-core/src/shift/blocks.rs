//! The blocks of tiles over each of which one model of the light holds, and the order of what they leave.
//!
//! `docs/explanation/algorithms.md`, section "Gauss-Newton".

use std::ops::Range;

use super::filters::NoiseGain;
use super::gram::{Block, Gram, Light};
use super::sums::Tiling;
use crate::error::Result;
use crate::memory::replace;

/// Where a part leaves this many times the variance of another, something moves in it on its own: as one block they would
/// be weighed alike.
const UNLIKE: f64 = 4.0;

/// Merges blocks of tiles as long as one model of the light fits them.
pub(super) struct Merger<'a> {
    pub(super) grams: &'a [(Gram, Option<Block>)],
    pub(super) tiling: &'a Tiling,
    pub(super) light: Light,
    /// Sum of squares that one more unknown takes out of filtered white noise of unit variance.
    pub(super) absorbed: f64,
    /// The least variance of a difference: grey levels are rounded.
    pub(super) floor: f64,
    pub(super) blocks: &'a mut Vec<Block>,
    /// Of the last evaluation: see `Solver`.
    pub(super) merged: &'a mut Vec<bool>,
    /// Blocks tried so far.
    pub(super) tried: usize,
    /// Whether a block that was cut stays cut.
    pub(super) hold: bool,
    /// Whether only what leaves alike is merged, as blocks that are weighed by what they leave have to be.
    pub(super) alike: bool,
}

impl Merger<'_> {
    /// The sums over a block of tiles, about its own middle; the blocks that it is best cut into are added to `blocks`.
    pub(super) fn merge(&mut self, columns: Range<usize>, rows: Range<usize>) -> (Gram, [f64; 2]) {
        if columns.len() == 1 && rows.len() == 1 {
            let (gram, block) = &self.grams[rows.start * self.tiling.across() + columns.start];
            let middle = self.tiling.middle(columns.start, rows.start);
            let block = block.as_ref();
            self.blocks
                .extend(block.map(|block| Block { middle, ..*block }));
            return (*gram, middle);
        }
        let halves = |range: &Range<usize>| {
            let middle = range.start + range.len().div_ceil(2);
            [range.start..middle, middle..range.end]
        };
        let before = self.blocks.len();
        let number = self.tried;
        self.tried += 1;
        let mut parts = [(Gram::default(), [0.0; 2]); 4];
        let mut count = 0;
        for rows in halves(&rows) {
            for columns in halves(&columns) {
                if !columns.is_empty() && !rows.is_empty() {
                    parts[count] = self.merge(columns.clone(), rows.clone());
                    count += 1;
                }
            }
        }
        let parts = &parts[..count];
        let middle: [f64; 2] = std::array::from_fn(|axis| {
            parts.iter().map(|part| part.1[axis]).sum::<f64>() / count as f64
        });
        let mut gram = Gram::default();
        for (part, at) in parts {
            gram.add(&part.moved([at[0] - middle[0], at[1] - middle[1]]));
        }
        if (!self.hold || self.merged[number])
            && (!self.alike || self.leave_alike(&self.blocks[before..]))
            && let Some(merged) = gram.reduce(self.light)
            && self.fits(&merged, &self.blocks[before..])
        {
            self.blocks.truncate(before);
            self.blocks.push(Block { middle, ..merged });
            self.merged[number] = true;
        } else {
            self.merged[number] = false;
        }
        (gram, middle)
    }

    /// Whether what the blocks leave is about the same.
    fn leave_alike(&self, cut: &[Block]) -> bool {
        let variances = cut.iter().map(|block| block.variance().max(self.floor));
        let (low, high) = variances.fold((f64::INFINITY, 0.0), |(low, high), variance| {
            (variance.min(low), variance.max(high))
        });
        high <= UNLIKE * low
    }

    /// Whether one model explains the block as well as a model for each of its parts.
    fn fits(&self, merged: &Block, cut: &[Block]) -> bool {
        let mut residual: f64 = cut.iter().map(|block| block.residual).sum();
        let degrees: f64 = cut.iter().map(|block| block.degrees).sum();
        let unknowns = merged.degrees - degrees;
        if unknowns <= 0.0 {
            return true;
        }
        // Noise alone gives each unknown `absorbed` times the variance on average; three deviations above is light.
        let allowed = self.absorbed * (unknowns + 3.0 * (2.0 * unknowns).sqrt());
        let more = merged.residual - residual;
        residual = residual.max(self.floor * degrees);
        more <= allowed * residual / degrees
    }
}

/// What the residual variance of a block rests on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ranked {
    pub(super) variance: f64,
    pub(super) count: f64,
    /// Sum of squared gradients.
    pub(super) information: f64,
    /// Pixels, by the share of the squared gradients that noise does not explain.
    pub(super) telling: f64,
}

/// The blocks in the order of their residual variances.
pub(super) fn sort_by_variance(
    blocks: &[Block],
    noise: NoiseGain,
    floor: f64,
    order: &mut Vec<Ranked>,
) -> Result<()> {
    let ranked = blocks.iter().map(|block| {
        let energy = block.gradient[0][0] + block.gradient[1][1];
        // The mean of two frames has a quarter of the variance of their difference.
        let in_band = block.variance().max(floor) / noise.sampled / 4.0;
        let of_noise = block.count * in_band * (noise.gradient[0] + noise.gradient[1]);
        Ranked {
            variance: block.variance(),
            count: block.count,
            information: energy,
            telling: block.count * (1.0 - of_noise / energy.max(1e-12)).max(0.0),
        }
    });
    replace("tiles", order, ranked)?;
    order.sort_unstable_by(|a, b| {
        (a.variance.total_cmp(&b.variance))
            .then(a.count.total_cmp(&b.count))
            .then(a.information.total_cmp(&b.information))
    });
    Ok(())
}

/// The residual variance below which this share of the blocks lies, by `weight`.
pub(super) fn quantile(order: &[Ranked], share: f64, weight: impl Fn(&Ranked) -> f64) -> f64 {
    let limit = share * order.iter().map(&weight).sum::<f64>();
    let mut seen = 0.0;
    for block in order {
        seen += weight(block);
        if seen >= limit {
            return block.variance;
        }
    }
    0.0
}
