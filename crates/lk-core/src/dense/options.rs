//! Presets of dense flow, and what stands behind them.
//!
//! `docs/algorithms.md`, section "Presets".

use ndarray::{ArrayView2, ArrayView3};

use crate::error::Result;
use crate::execution::Execution;
use crate::illumination::Illumination;
use crate::options::{expect_option, is_positive, names, setters};

pub(crate) use super::covariance::Shares;
pub(crate) use super::refine::RefineRecipe;

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

impl Default for RefineRecipe {
    fn default() -> Self {
        Self {
            radius: 2,
            alpha: 2.8,
            trace_floor: 2.0,
            data_epsilon: 0.1,
            smooth_epsilon: 0.02,
            edge_scale: 10.0,
            relaxation: 1.85,
        }
    }
}

impl Recipe {
    /// The outer taps of the filter of three that smooths the frames: its variance is twice that.
    pub(crate) fn smoothing_side(&self) -> f32 {
        0.5 * self.presmoothing * self.presmoothing
    }

    /// The recipe of `preset`.
    #[must_use]
    pub(crate) fn new(preset: Preset) -> Self {
        let level = LevelRecipe {
            steps: 2,
            sparse: 2,
            radius: 3,
            distance: 3,
            median: 2,
            half_rounds: 1,
            rounds: 0,
            sweeps: 8,
        };
        let coarse = LevelRecipe {
            sparse: 1,
            radius: 2,
            half_rounds: 0,
            rounds: 2,
            sweeps: 6,
            ..level
        };
        let recipe = Self {
            fine: [level; 3],
            finest: 0,
            coarse,
            match_ratio: 0.9,
            damping: 0.3,
            max_step: 0.7,
            presmoothing: 0.7,
            affine_gain: 7.0,
            refine: RefineRecipe::default(),
            covariance: Shares {
                noise: 0.0021,
                roughness: 0.68,
            },
        };
        match preset {
            Preset::Ultrafast => Self {
                fine: [
                    level,
                    LevelRecipe {
                        steps: 1,
                        sparse: 1,
                        half_rounds: 2,
                        sweeps: 6,
                        ..level
                    },
                    LevelRecipe {
                        sparse: 1,
                        half_rounds: 0,
                        rounds: 1,
                        sweeps: 5,
                        ..level
                    },
                ],
                finest: 1,
                ..recipe
            },
            Preset::Fast => Self {
                covariance: Shares {
                    roughness: 0.95,
                    ..recipe.covariance
                },
                fine: [
                    LevelRecipe { sweeps: 4, ..level },
                    LevelRecipe {
                        steps: 1,
                        sparse: 1,
                        sweeps: 6,
                        ..level
                    },
                    LevelRecipe {
                        sparse: 1,
                        half_rounds: 0,
                        rounds: 1,
                        sweeps: 5,
                        ..level
                    },
                ],
                ..recipe
            },
            Preset::Balanced => Self {
                fine: [
                    LevelRecipe {
                        steps: 1,
                        sparse: 1,
                        half_rounds: 2,
                        ..level
                    },
                    LevelRecipe {
                        steps: 3,
                        sparse: 3,
                        half_rounds: 2,
                        sweeps: 12,
                        ..level
                    },
                    LevelRecipe {
                        distance: 0,
                        half_rounds: 2,
                        sweeps: 12,
                        ..level
                    },
                ],
                coarse: LevelRecipe {
                    rounds: 3,
                    sweeps: 8,
                    ..coarse
                },
                match_ratio: 0.85,
                ..recipe
            },
            Preset::Accurate => {
                let fine = LevelRecipe {
                    steps: 5,
                    sparse: 0,
                    half_rounds: 0,
                    rounds: 3,
                    sweeps: 14,
                    ..level
                };
                let coarse = LevelRecipe {
                    steps: 8,
                    distance: 5,
                    rounds: 5,
                    ..fine
                };
                Self {
                    fine: [fine, fine, coarse],
                    coarse,
                    match_ratio: 0.85,
                    presmoothing: 0.6,
                    refine: RefineRecipe {
                        radius: 1,
                        smooth_epsilon: 0.015,
                        edge_scale: 13.0,
                        ..RefineRecipe::default()
                    },
                    covariance: Shares {
                        noise: 0.0012,
                        roughness: 0.8,
                    },
                    ..recipe
                }
            }
        }
    }
}

/// How dense flow is measured.
#[derive(Debug, Clone)]
pub struct DenseOptions {
    pub(super) recipe: Recipe,
    pub(super) illumination: Illumination,
    pub(super) max_displacement: Option<f32>,
    pub(super) covariance: bool,
    pub(super) execution: Execution,
}

impl Default for DenseOptions {
    fn default() -> Self {
        Self {
            recipe: Recipe::new(Preset::default()),
            illumination: Illumination::default(),
            max_displacement: None,
            covariance: false,
            execution: Execution::default(),
        }
    }
}

impl DenseOptions {
    /// Time against accuracy; [`Preset::Balanced`] by default.
    #[must_use]
    pub fn preset(mut self, preset: Preset) -> Self {
        self.recipe = Recipe::new(preset);
        self
    }

    setters! {
        /// How light may change.
        illumination(illumination: Illumination);

        /// The longest displacement to look for, a length in pixels: longer vectors are not sought, and none is valid. By default
        /// half the frame along each axis.
        max_displacement(pixels: Option<f32>);

        /// Whether to say how far the flow of each pixel may be off ([`FlowField::covariance`]); not by default.
        ///
        /// [`FlowField::covariance`]: crate::FlowField::covariance
        covariance(wanted: bool);

        /// Threads, instructions and cancel flag.
        execution(execution: Execution);
    }

    /// Whether every option is within what it allows.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option), which names the option.
    pub fn validate(&self) -> Result<()> {
        expect_option(
            is_positive(self.max_displacement),
            "max_displacement",
            self.max_displacement.unwrap_or_default(),
            "a positive number of pixels, or None",
        )
    }
}

/// What a measurement may know besides its two frames.
///
/// ```
/// use lk_core::DenseHints;
/// use ndarray::Array2;
///
/// let keep = Array2::from_elem((48, 64), true);
/// assert!(DenseHints::default().mask(keep.view()).mask.is_some());
/// ```
#[derive(Debug, Clone, Copy, Default)]
#[non_exhaustive]
pub struct DenseHints<'a> {
    /// A flow to start from, (height, width, 2) in pixels; where it is not finite, or longer than the frame, it is taken
    /// as zero.
    pub initial: Option<ArrayView3<'a, f32>>,
    /// (height, width): false at pixels of `prev` that count for nothing, whatever they hold. In a sequence that holds for
    /// the first frame of a pair if the call that brought it had a mask too; else what it held under the mask reaches the
    /// pixels beside it.
    pub mask: Option<ArrayView2<'a, bool>>,
    /// (height, width): false at pixels of `next` that count for nothing. A pixel of `prev` counts where it and what it
    /// moves to do.
    pub next_mask: Option<ArrayView2<'a, bool>>,
}

impl<'a> DenseHints<'a> {
    /// With a flow to start from.
    #[must_use]
    pub fn initial(self, flow: impl Into<Option<ArrayView3<'a, f32>>>) -> Self {
        let initial = flow.into();
        Self { initial, ..self }
    }

    /// With the pixels of `prev` that count.
    #[must_use]
    pub fn mask(self, mask: impl Into<Option<ArrayView2<'a, bool>>>) -> Self {
        let mask = mask.into();
        Self { mask, ..self }
    }

    /// With the pixels of `next` that count.
    #[must_use]
    pub fn next_mask(self, mask: impl Into<Option<ArrayView2<'a, bool>>>) -> Self {
        let next_mask = mask.into();
        Self { next_mask, ..self }
    }
}
