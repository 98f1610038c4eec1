//! Presets of dense flow, and what stands behind them.
//!
//! `docs/explanation/algorithms.md`, section "Presets".

use crate::options::names;

use super::covariance::Shares;
use super::refine::RefineRecipe;

/// How much time dense flow takes for how much accuracy.
///
/// ```
/// use lk_core::Preset;
///
/// assert_eq!("fast".parse::<Preset>()?, Preset::Fast);
/// assert_eq!(Preset::default().name(), "balanced");
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Preset {
    /// Measured on a level of half the size, for the least time.
    Ultrafast,
    /// A few milliseconds for a frame of 640 x 480 on one core.
    Fast,
    /// Small details and sharp edges of motion.
    #[default]
    Balanced,
    /// The smallest error.
    Accurate,
}

names!(
    Preset, "preset":
    Ultrafast "ultrafast",
    Fast "fast",
    Balanced "balanced",
    Accurate "accurate",
);

/// What is done on a level: steps, then rounds on a grid of half the size, then rounds at all pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LevelRecipe {
    /// Lucas-Kanade steps.
    pub(crate) steps: usize,
    /// How many of the steps, the first ones, are taken at one pixel in each 2 x 2 and interpolated.
    pub(crate) sparse: usize,
    /// Half the window of the least squares, 1 to 3.
    pub(crate) radius: usize,
    /// How far away the neighbours are whose flow a pixel may take, 1 to 16 pixels; 0: it takes none.
    pub(crate) distance: usize,
    /// How far apart the nine pixels are whose median is taken after each step, 1 to 16; 0: none.
    pub(crate) median: usize,
    /// Rounds of refinement at one pixel in each 2 x 2, on levels whose flow comes from a coarser one.
    pub(crate) half_rounds: usize,
    /// Rounds of refinement at all pixels.
    pub(crate) rounds: usize,
    /// Sweeps of each round.
    pub(crate) sweeps: usize,
}

/// The constants behind a preset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Recipe {
    /// The finest level, and those of a half and of a quarter of its size.
    pub(crate) fine: [LevelRecipe; 3],
    /// The finest level that is measured: 0, or 1 where the flow of half the size is interpolated.
    pub(crate) finest: usize,
    /// All coarser ones, and those from which the measurement starts.
    pub(crate) coarse: LevelRecipe,
    /// A neighbour's window must have less than this share of a pixel's own mean squared difference.
    pub(crate) match_ratio: f32,
    /// Added to the diagonal of the structure tensor (mean over the window), in squared grey levels of 0..255.
    pub(crate) damping: f32,
    /// The longest step along each axis, in pixels of the level.
    pub(crate) max_step: f32,
    /// Both frames are smoothed by this much first: the standard deviation in pixels, at most 0.7.
    pub(crate) presmoothing: f32,
    /// How many times smoothness counts where the whole flow is affine.
    pub(crate) affine_gain: f32,
    pub(crate) refine: RefineRecipe,
    pub(crate) covariance: Shares,
}

/// How a level is refined, but where a preset differs.
pub(super) const REFINE: RefineRecipe = RefineRecipe {
    radius: 2,
    alpha: 2.8,
    trace_floor: 2.0,
    data_epsilon: 0.1,
    smooth_epsilon: 0.02,
    edge_scale: 10.0,
    relaxation: 1.85,
};

/// What is done on a fine level, but where a preset differs.
const LEVEL: LevelRecipe = LevelRecipe {
    steps: 2,
    sparse: 2,
    radius: 3,
    distance: 3,
    median: 2,
    half_rounds: 1,
    rounds: 0,
    sweeps: 8,
};

/// The same on a coarse one.
const COARSE: LevelRecipe = LevelRecipe {
    sparse: 1,
    radius: 2,
    half_rounds: 0,
    rounds: 2,
    sweeps: 6,
    ..LEVEL
};

/// A quarter of the size, where little time is to be taken.
const QUICK: LevelRecipe = LevelRecipe {
    sparse: 1,
    half_rounds: 0,
    rounds: 1,
    sweeps: 5,
    ..LEVEL
};

/// What presets have in common.
const BASE: Recipe = Recipe {
    fine: [LEVEL; 3],
    finest: 0,
    coarse: COARSE,
    match_ratio: 0.9,
    damping: 0.3,
    max_step: 0.7,
    presmoothing: 0.7,
    affine_gain: 7.0,
    refine: REFINE,
    covariance: Shares {
        noise: 0.0021,
        roughness: 0.68,
    },
};

const ULTRAFAST: Recipe = Recipe {
    fine: [
        LEVEL,
        LevelRecipe {
            steps: 1,
            sparse: 1,
            half_rounds: 2,
            sweeps: 6,
            ..LEVEL
        },
        QUICK,
    ],
    finest: 1,
    ..BASE
};

const FAST: Recipe = Recipe {
    covariance: Shares {
        roughness: 0.95,
        ..BASE.covariance
    },
    fine: [
        LevelRecipe {
            steps: 1,
            sparse: 1,
            sweeps: 6,
            ..LEVEL
        },
        LevelRecipe {
            steps: 1,
            sparse: 1,
            sweeps: 10,
            ..LEVEL
        },
        QUICK,
    ],
    ..BASE
};

const BALANCED: Recipe = Recipe {
    fine: [
        LevelRecipe {
            steps: 1,
            sparse: 1,
            half_rounds: 2,
            ..LEVEL
        },
        LevelRecipe {
            steps: 3,
            sparse: 3,
            half_rounds: 2,
            sweeps: 12,
            ..LEVEL
        },
        LevelRecipe {
            distance: 0,
            half_rounds: 2,
            sweeps: 12,
            ..LEVEL
        },
    ],
    coarse: LevelRecipe {
        rounds: 3,
        sweeps: 8,
        ..COARSE
    },
    match_ratio: 0.85,
    ..BASE
};

/// A fine level of [`ACCURATE`], and a coarse one.
const ACCURATE_FINE: LevelRecipe = LevelRecipe {
    steps: 5,
    sparse: 0,
    half_rounds: 0,
    rounds: 3,
    sweeps: 14,
    ..LEVEL
};
const ACCURATE_COARSE: LevelRecipe = LevelRecipe {
    steps: 8,
    distance: 5,
    rounds: 5,
    ..ACCURATE_FINE
};

const ACCURATE: Recipe = Recipe {
    fine: [ACCURATE_FINE, ACCURATE_FINE, ACCURATE_COARSE],
    coarse: ACCURATE_COARSE,
    match_ratio: 0.85,
    presmoothing: 0.6,
    refine: RefineRecipe {
        radius: 1,
        smooth_epsilon: 0.015,
        edge_scale: 13.0,
        ..REFINE
    },
    covariance: Shares {
        noise: 0.0012,
        roughness: 0.8,
    },
    ..BASE
};

impl Recipe {
    /// The recipe of `preset`.
    #[must_use]
    pub(crate) fn new(preset: Preset) -> Self {
        match preset {
            Preset::Ultrafast => ULTRAFAST,
            Preset::Fast => FAST,
            Preset::Balanced => BALANCED,
            Preset::Accurate => ACCURATE,
        }
    }

    /// The outer taps of the filter of three that smooths the frames: its variance is twice that.
    pub(crate) fn smoothing_side(&self) -> f32 {
        0.5 * self.presmoothing * self.presmoothing
    }
}
