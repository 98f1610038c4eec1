//! How dense flow is measured, and what it may be told besides the frames.

use ndarray::{ArrayView2, ArrayView3};

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::expect_size;
use crate::illumination::Illumination;
use crate::options::{expect_option, is_positive, setters};

use super::recipe::{Preset, Recipe};

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

    /// The hints for frames of this size without masks that leave nothing out.
    pub(super) fn checked(self, (height, width): (usize, usize)) -> Result<Self> {
        for (name, mask) in [("mask", self.mask), ("next_mask", self.next_mask)] {
            if let Some(mask) = mask {
                expect_size(name, mask.dim(), "the frames", (height, width))?;
            }
        }
        if let Some(initial) = self.initial
            && initial.dim() != (height, width, 2)
        {
            let (h, w, d) = initial.dim();
            return Err(Error::shape(
                "initial",
                format!("({h}, {w}, {d})"),
                format!("({height}, {width}, 2)"),
            ));
        }
        let leaves_out = |mask: &ArrayView2<'_, bool>| mask.iter().any(|counts| !counts);
        Ok(Self {
            mask: self.mask.filter(leaves_out),
            next_mask: self.next_mask.filter(leaves_out),
            ..self
        })
    }
}
