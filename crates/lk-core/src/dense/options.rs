//! Presets of dense flow, and what stands behind them.

use ndarray::{ArrayView2, ArrayView3};

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::illumination::Illumination;

pub use super::refine::RefineRecipe;

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
pub enum Preset {
    /// A few milliseconds for a frame of 640 x 480 on one core.
    Fast,
    /// Small details and sharp edges of motion.
    #[default]
    Balanced,
    /// The smallest error.
    Accurate,
}

impl Preset {
    /// The name used in Python and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::Accurate => "accurate",
        }
    }
}

impl std::str::FromStr for Preset {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        [Self::Fast, Self::Balanced, Self::Accurate]
            .into_iter()
            .find(|preset| preset.name() == name)
            .ok_or_else(|| {
                Error::option(
                    "preset",
                    format!("{name:?}"),
                    "\"fast\", \"balanced\" or \"accurate\"",
                )
            })
    }
}

/// What is done on a level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelRecipe {
    /// Times that the steps and then the refinement are run.
    pub cycles: usize,
    /// Lucas-Kanade steps of a cycle.
    pub steps: usize,
    /// How many of the steps, the first ones, are taken at one pixel in each 2 x 2 and interpolated.
    pub sparse: usize,
    /// Half the window of the least squares, 1 to 3.
    pub radius: usize,
    /// How far away the neighbours are whose flow a pixel may take, 1 to 16 pixels; 0: it takes none.
    pub distance: usize,
    /// How far apart the nine pixels are whose median is taken after each step, 1 to 16; 0: none.
    pub median: usize,
    /// Rounds of variational refinement that end a cycle.
    pub rounds: usize,
}

/// The constants behind a preset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recipe {
    /// The finest level, those of a half and of a quarter of its size, and all coarser ones.
    pub levels: [LevelRecipe; 4],
    /// A neighbour's window must have less than this share of a pixel's own mean squared difference.
    pub better: f32,
    /// Added to the diagonal of the structure tensor (mean over the window), in squared grey levels of 0..255.
    pub damping: f32,
    /// The longest step along each axis, in pixels of the level.
    pub longest: f32,
    /// The refinement of the levels that have one.
    pub refine: RefineRecipe,
}

impl Default for RefineRecipe {
    fn default() -> Self {
        Self {
            sweeps: 3,
            radius: 2,
            alpha: 0.7,
            ground: 4.0,
            data_epsilon: 0.1,
            smooth_epsilon: 0.005,
            edge: 20.0,
            relaxation: 1.6,
        }
    }
}

impl Recipe {
    /// The recipe of `preset`.
    #[must_use]
    pub fn new(preset: Preset) -> Self {
        let level = |steps, sparse, rounds, distance| LevelRecipe {
            cycles: 1,
            steps,
            sparse,
            radius: 3,
            distance,
            median: 2,
            rounds,
        };
        let (levels, better, sweeps) = match preset {
            Preset::Fast => {
                let coarse = level(3, 1, 1, 3);
                (
                    [level(1, 1, 0, 3), level(2, 1, 0, 3), coarse, coarse],
                    0.9,
                    4,
                )
            }
            Preset::Balanced => {
                let coarse = level(6, 3, 2, 3);
                (
                    [level(1, 1, 1, 3), level(3, 2, 1, 3), coarse, coarse],
                    0.9,
                    3,
                )
            }
            Preset::Accurate => {
                let (fine, coarse) = (level(5, 0, 5, 3), level(8, 0, 5, 5));
                ([fine, fine, coarse, coarse], 0.85, 6)
            }
        };
        Self {
            levels,
            better,
            damping: 0.3,
            longest: 0.7,
            refine: RefineRecipe {
                sweeps,
                ..RefineRecipe::default()
            },
        }
    }
}

/// How dense flow is measured.
#[derive(Debug, Clone)]
pub struct DenseOptions {
    pub(super) recipe: Recipe,
    pub(super) illumination: Illumination,
    pub(super) max_displacement: Option<f32>,
    pub(super) execution: Execution,
}

impl Default for DenseOptions {
    fn default() -> Self {
        Self {
            recipe: Recipe::new(Preset::default()),
            illumination: Illumination::default(),
            max_displacement: None,
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

    /// The constants behind a preset, for those who tune their own.
    #[must_use]
    pub fn recipe(mut self, recipe: Recipe) -> Self {
        self.recipe = recipe;
        self
    }

    /// How light may change.
    #[must_use]
    pub fn illumination(mut self, illumination: Illumination) -> Self {
        self.illumination = illumination;
        self
    }

    /// The largest motion to look for, in pixels. By default all levels of the pyramid are searched.
    #[must_use]
    pub fn max_displacement(mut self, pixels: Option<f32>) -> Self {
        self.max_displacement = pixels;
        self
    }

    /// Threads, instructions and cancel flag.
    #[must_use]
    pub fn execution(mut self, execution: Execution) -> Self {
        self.execution = execution;
        self
    }

    /// Whether every option is within what it allows.
    ///
    /// # Errors
    ///
    /// [`Error::Option`], which names the option.
    pub fn validate(&self) -> Result<()> {
        if let Some(most) = self.max_displacement
            && !(most > 0.0 && most.is_finite())
        {
            return Err(Error::option(
                "max_displacement",
                most,
                "a positive number of pixels, or None",
            ));
        }
        for level in &self.recipe.levels {
            if !(1..=3).contains(&level.radius) {
                return Err(Error::option("radius", level.radius, "1, 2 or 3"));
            }
            if level.distance > 16 {
                return Err(Error::option("distance", level.distance, "0 to 16 pixels"));
            }
            if level.median > 16 {
                return Err(Error::option("median", level.median, "0 to 16 pixels"));
            }
            for (name, count) in [
                ("cycles", level.cycles),
                ("steps", level.steps),
                ("sparse", level.sparse),
                ("rounds", level.rounds),
            ] {
                at_most(name, count, MOST_REPETITIONS)?;
            }
        }
        if !(1..=3).contains(&self.recipe.refine.radius) {
            return Err(Error::option(
                "refine.radius",
                self.recipe.refine.radius,
                "1, 2 or 3",
            ));
        }
        at_most("refine.sweeps", self.recipe.refine.sweeps, MOST_SWEEPS)?;
        let positive = [
            ("better", self.recipe.better),
            ("damping", self.recipe.damping),
            ("longest", self.recipe.longest),
            ("refine.alpha", self.recipe.refine.alpha),
            ("refine.ground", self.recipe.refine.ground),
            ("refine.data_epsilon", self.recipe.refine.data_epsilon),
            ("refine.smooth_epsilon", self.recipe.refine.smooth_epsilon),
            ("refine.edge", self.recipe.refine.edge),
            ("refine.relaxation", self.recipe.refine.relaxation),
        ];
        for (name, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::option(name, value, "a positive number"));
            }
        }
        Ok(())
    }
}

/// Most cycles, steps and rounds of a level: far beyond what changes a flow.
const MOST_REPETITIONS: usize = 1000;
/// Most sweeps of a round, each of which takes rows of memory.
const MOST_SWEEPS: usize = 100;

fn at_most(name: &'static str, count: usize, most: usize) -> Result<()> {
    if count > most {
        return Err(Error::option(name, count, format!("0 to {most}")));
    }
    Ok(())
}

/// What a measurement may know besides its two frames.
#[derive(Debug, Clone, Copy, Default)]
pub struct DenseHints<'a> {
    /// A flow to start from, (height, width, 2) in pixels; where it is not finite, or longer than the frame, it is taken
    /// as zero.
    pub initial: Option<ArrayView3<'a, f32>>,
    /// (height, width): false at pixels of `prev` that count for nothing.
    pub mask: Option<ArrayView2<'a, bool>>,
}
