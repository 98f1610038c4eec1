//! Dense flow: where every pixel went.
//!
//! Coarse to fine ([`coarse_to_fine`]). On each level a few Lucas-Kanade steps over all pixels ([`step`]), after each of
//! which a pixel may take the flow of a neighbour whose window fits better ([`propagate`]) and a median removes what stands
//! out ([`median`]); then a variational refinement, at one pixel in 2 x 2 ([`half_round`]) or at all ([`refine`]), that is
//! smooth relative to the affine motion of most of the flow ([`trend`]). On coarse levels windows that say little
//! ([`sureness`]) take the flow of what is around them ([`fill`]). The mean of each window is taken out, so that an
//! offset of the light does no harm; where light has changed by more than that, `prev` is first brought to the light of
//! `next` ([`light`], [`relight`], [`photometric_align`]). Motion that the coarsest level cannot see is looked for where windows are left
//! without a match ([`large_motion`]), and where some are they are compared with every place that they may have moved to
//! ([`block_matching`]). Whether either may be called for is asked beside the coarsest levels ([`looks`]). The
//! last step or round also judges how well its windows fit ([`confidence`]), a coarse level says whether the flow is supported
//! where the finest one cannot ([`support`]), and what is not to be trusted is marked ([`validity`]), or fits by chance
//! ([`chance`]); how far the rest may be off is found if asked for ([`covariance`]).
//!
//! What steps and rounds of refinement share is a stream of rows of window sums ([`windows`]): warped ([`warp`]), summed
//! down ([`sum_down`]) and across ([`moments`]), in strips of columns where the picture is wide ([`tiles`]).
//!
//! Damping and thresholds are in grey levels of 0..255: both frames of a pair are multiplied by the power of two that
//! the range of `prev` asks for ([`GreyRange::scale`](crate::grey::GreyRange::scale)), but for pixels that are hot
//! ([`hot_pixels`]), and what is reported in grey levels is divided by it.
//!
//! `docs/explanation/algorithms.md`, section "Dense flow: dense_flow".

/// Evaluate the expression with the constant `$size` for the side of windows of this radius, 1 to 3.
macro_rules! by_radius {
    ($radius:expr, $size:ident => $body:expr) => {
        match $radius {
            1 => {
                const $size: usize = 3;
                $body
            }
            2 => {
                const $size: usize = 5;
                $body
            }
            _ => {
                const $size: usize = 7;
                $body
            }
        }
    };
}

mod block_matching;
mod box_mean;
mod chance;
mod coarse_to_fine;
mod confidence;
mod covariance;
mod field;
mod fill;
mod gaps;
mod half_round;
mod half_sweep;
mod hot_pixels;
mod large_motion;
mod levels;
mod light;
mod looks;
mod lost_windows;
mod measure;
mod median;
mod moments;
mod options;
mod padded_plane;
mod photometric_align;
mod propagate;
mod recipe;
mod refine;
mod relax;
mod relight;
mod snapshot;
mod source;
mod step;
mod sum_down;
mod support;
mod sureness;
mod tiles;
mod trend;
mod upsample;
mod validity;
mod warp;
mod weights;
mod window_correlation;
mod windows;
mod workspace;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, expect_size, pixels_of};
use crate::parallel::{both, within_pool};

pub use field::FlowField;
pub use options::{DenseHints, DenseOptions};
pub use recipe::Preset;
pub use snapshot::DenseSnapshot;

use hot_pixels::greys_without;
use measure::measure;
use source::{Reading, Source};
use workspace::Workspace;

/// A level is not halved below this, in pixels of its shorter side: the windows of the coarsest level must stay small
/// beside it.
const SMALLEST: usize = 16;

/// Dense flow from frame to frame; keeps its memory and the pyramid of the frame before.
///
/// ```
/// use lk_core::{DenseFlow, DenseHints, DenseOptions, FlowField};
/// use ndarray::Array2;
///
/// let frame = |shift: f32| Array2::from_shape_fn((64, 80), |(y, x)| {
///     let x = x as f32 - shift;
///     128.0 + 50.0 * (0.3 * x).sin() * (0.25 * y as f32).cos() + 30.0 * (0.5 * x + 0.4 * y as f32).sin()
/// });
/// let mut flow = DenseFlow::new(DenseOptions::default())?;
/// let mut field = FlowField::default();
/// assert!(!flow.update(frame(0.0).view(), DenseHints::default(), &mut field)?);
/// assert!(flow.update(frame(1.5).view(), DenseHints::default(), &mut field)?);
/// let middle = 2 * (32 * 80 + 40);
/// assert!((field.uv()[middle] - 1.5).abs() < 0.1 && field.uv()[middle + 1].abs() < 0.1);
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug)]
pub struct DenseFlow {
    options: DenseOptions,
    prev: Source,
    next: Source,
    /// Whether `next` holds the frame before.
    primed: bool,
    memory: Workspace,
}

/// Dense flow of one pair.
///
/// # Errors
///
/// [`Error::Shape`] if the frames or hints differ in size, [`Error::Option`] for options outside of what they allow,
/// those of the execution.
///
/// ```
/// use lk_core::ndarray::Array2;
/// use lk_core::{DenseHints, DenseOptions, Preset, dense_flow};
///
/// let scene = |x: f32, y: f32| 100.0 + 40.0 * (0.5 * x).sin() + 40.0 * (0.4 * y + 0.1 * x).cos();
/// let prev = Array2::from_shape_fn((96, 128), |(y, x)| scene(x as f32, y as f32));
/// let next = Array2::from_shape_fn((96, 128), |(y, x)| scene(x as f32 - 1.5, y as f32 + 0.5));
/// let options = DenseOptions::default().preset(Preset::Fast);
/// let field = dense_flow(prev.view(), next.view(), DenseHints::default(), &options)?;
/// let (u, v) = (field.uv_view()[(48, 64, 0)], field.uv_view()[(48, 64, 1)]);
/// assert!(field.valid_view()[(48, 64)] && (u - 1.5).abs() < 0.1 && (v + 0.5).abs() < 0.1);
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn dense_flow<T: Pixel>(
    prev: Frame<'_, T>,
    next: Frame<'_, T>,
    hints: DenseHints<'_>,
    options: &DenseOptions,
) -> Result<FlowField> {
    let mut field = FlowField::default();
    DenseFlow::new(options.clone())?.pair(prev, next, hints, &mut field)?;
    Ok(field)
}

impl DenseFlow {
    /// An estimator that has seen no frame yet.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] for options outside of what they allow.
    pub fn new(options: DenseOptions) -> Result<Self> {
        options.validate()?;
        Ok(Self {
            options,
            prev: Source::default(),
            next: Source::default(),
            primed: false,
            memory: Workspace::default(),
        })
    }

    /// Run the coming calls with another execution.
    pub fn set_execution(&mut self, execution: Execution) {
        self.options.execution = execution;
    }

    /// Forget the frame before.
    pub fn reset(&mut self) {
        self.primed = false;
    }

    /// The flow from the frame before to `frame`; false, and `field` untouched, for the first one.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if the frame or the hints have another size than the frame before, [`Error::Memory`], those of the
    /// execution. After an error the next frame is a first one.
    pub fn update<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        hints: DenseHints<'_>,
        field: &mut FlowField,
    ) -> Result<bool> {
        let primed = std::mem::replace(&mut self.primed, false);
        pixels_of("frame", frame.dim())?;
        let hints = hints.checked(frame.dim())?;
        if primed {
            std::mem::swap(&mut self.prev, &mut self.next);
            let before = &self.prev.pyramid.levels()[0];
            expect_size(
                "next",
                frame.dim(),
                "prev",
                (before.height(), before.width()),
            )?;
        }
        let execution = self.execution(frame.len());
        let side = self.options.recipe.smoothing_side();
        let measured = within_pool(&execution, || {
            let levels = self.levels(frame.dim());
            let reading = |mask| Reading { levels, side, mask };
            if primed {
                self.prev.mask_anew(reading(hints.mask), &execution)?;
            }
            let greys = greys_without(frame, hints.next_mask);
            let scale = if primed { &self.prev.greys } else { &greys }.scale();
            self.next
                .read(frame, (greys, scale), reading(hints.next_mask), &execution)?;
            // The mask of the next pair's first frame may be another.
            if hints.mask.is_some() || hints.next_mask.is_some() {
                self.next.keep(frame, &execution)?;
            }
            if primed {
                self.prev.rescale(scale);
                self.measure(hints, &execution, field)?;
            }
            Ok(())
        });
        self.give_back(measured)?;
        self.primed = true;
        Ok(primed)
    }

    /// The flow from `prev` to `next`; the frame before, for [`DenseFlow::update`], is forgotten.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if the frames or hints differ in size, [`Error::Memory`], those of the execution.
    pub fn pair<T: Pixel>(
        &mut self,
        prev: Frame<'_, T>,
        next: Frame<'_, T>,
        hints: DenseHints<'_>,
        field: &mut FlowField,
    ) -> Result<()> {
        self.primed = false;
        expect_size("next", next.dim(), "prev", prev.dim())?;
        pixels_of("prev", prev.dim())?;
        let hints = hints.checked(prev.dim())?;
        let execution = self.execution(prev.len());
        let side = self.options.recipe.smoothing_side();
        let measured = within_pool(&execution, || {
            let levels = self.levels(prev.dim());
            let reading = |mask| Reading { levels, side, mask };
            let (mask, next_mask) = (hints.mask, hints.next_mask);
            let greys = both(
                &execution,
                || greys_without(prev, mask),
                || greys_without(next, next_mask),
            )?;
            let scale = greys.0.scale();
            let Self {
                prev: first,
                next: second,
                ..
            } = self;
            let (first, second) = both(
                &execution,
                || first.read(prev, (greys.0, scale), reading(mask), &execution),
                || second.read(next, (greys.1, scale), reading(next_mask), &execution),
            )?;
            first.and(second)?;
            self.measure(hints, &execution, field)
        });
        self.give_back(measured)
    }

    /// Forget the frame before, and let go of all memory.
    pub fn forget(&mut self) {
        self.primed = false;
        (self.prev, self.next) = (Source::default(), Source::default());
        self.memory = Workspace::default();
    }

    /// Let go of all memory if `measured` had too little: others may need it, and the next frame may be smaller.
    fn give_back(&mut self, measured: Result<()>) -> Result<()> {
        if measured.as_ref().is_err_and(Error::is_memory) {
            self.forget();
        }
        measured
    }

    /// The execution of a call for frames of this many pixels.
    fn execution(&self, pixels: usize) -> Execution {
        let execution = self.options.execution.clone();
        if pixels < SHARED {
            execution.threads(1)
        } else {
            execution
        }
    }

    /// Levels of the pyramid for a frame of this (height, width).
    fn levels(&self, (height, width): (usize, usize)) -> usize {
        let [mut size, mut longer] = [width.min(height), width.max(height)];
        let mut levels = 1;
        // Each level doubles the reach: about 2 pixels on the coarsest.
        let mut reach = 2.0;
        let wanted = self.options.max_displacement.unwrap_or(f32::MAX);
        // Down to where the measurement starts even for the shortest motion: from finer levels it would take longer.
        while size > SMALLEST && (reach < wanted || longer > coarse_to_fine::LIGHT_SIZE) {
            size = size.div_ceil(2);
            longer = longer.div_ceil(2);
            levels += 1;
            reach *= 2.0;
        }
        levels
    }

    fn measure(
        &mut self,
        hints: DenseHints<'_>,
        execution: &Execution,
        field: &mut FlowField,
    ) -> Result<()> {
        let Self {
            options,
            prev,
            next,
            memory,
            ..
        } = self;
        measure(options, (prev, next), memory, hints, execution, field)
    }
}

/// Frames of fewer pixels are measured on the caller's thread: nothing of them is divided.
const SHARED: usize = 1 << 14;

#[cfg(test)]
mod tests;
