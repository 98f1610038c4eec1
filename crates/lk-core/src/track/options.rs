//! What a caller may set, and what a caller gets.

use crate::error::Result;
use crate::execution::Execution;
use crate::illumination::Illumination;
use crate::options::{expect_option, is_positive, names, setters};
use crate::track::patch::Window;

/// What memory for points holds.
pub(super) const POINTS: &str = "points";

/// Levels beyond which no frame that fits into memory has pixels left.
const MAX_LEVELS: usize = 16;

/// How points are tracked.
///
/// ```
/// use lk_core::{Illumination, TrackOptions};
///
/// let options = TrackOptions::default().window_size(15, 15).illumination(Illumination::Offset);
/// assert!(options.validate().is_ok());
/// assert!(options.window_size(2, 15).validate().is_err());
/// ```
#[derive(Debug, Clone)]
pub struct TrackOptions {
    pub(crate) window: Window,
    pub(crate) levels: Option<usize>,
    pub(crate) max_displacement: Option<f32>,
    pub(crate) max_iterations: usize,
    pub(crate) epsilon: f32,
    pub(crate) illumination: Illumination,
    pub(crate) max_forward_backward: Option<f32>,
    pub(crate) deformation: Deformation,
    pub(crate) execution: Execution,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            window: Window::default(),
            levels: None,
            max_displacement: None,
            max_iterations: 30,
            epsilon: 0.01,
            illumination: Illumination::default(),
            max_forward_backward: Some(0.5),
            deformation: Deformation::default(),
            execution: Execution::default(),
        }
    }
}

impl TrackOptions {
    /// Width and height of the window around a point, in pixels, 3 to 63; 21 by 21 by default. On the finest level one
    /// more pixel on each side takes part.
    #[must_use]
    pub fn window_size(mut self, width: usize, height: usize) -> Self {
        self.window = Window { width, height };
        self
    }

    /// Pixels of that window.
    #[must_use]
    pub fn window_area(&self) -> usize {
        self.window.width * self.window.height
    }

    /// The longer side of that window.
    pub(crate) fn window_side(&self) -> usize {
        self.window.width.max(self.window.height)
    }

    setters! {
        /// Levels of the pyramid, the frame itself included; `None`, the default, follows from frame and displacement.
        levels(levels: Option<usize>);

        /// The longest displacement to look for, a length in pixels: longer ones are not valid; `None`, the default, looks for any. On texture that repeats and
        /// fills the picture, one below half of the period says which of several displacements it was.
        max_displacement(pixels: Option<f32>);

        /// Steps on one level after which a point counts as not converged; 30 by default.
        max_iterations(iterations: usize);

        /// Length of a step in pixels below which a point has converged; 0.01 by default.
        epsilon(pixels: f32);

        /// What may change in the light of a window.
        illumination(illumination: Illumination);

        /// How far from its start a point may come back, in pixels, when it is tracked back; `None` does not look.
        /// 0.5 by default.
        max_forward_backward(pixels: Option<f32>);

        /// Whether windows may turn, grow and shear; [`Deformation::Auto`] by default.
        deformation(deformation: Deformation);

        /// Threads, instructions and cancellation.
        execution(execution: Execution);
    }

    /// Check every option.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option) for the first one outside of what it allows.
    pub fn validate(&self) -> Result<()> {
        self.window.expect_allowed("window_size")?;
        let levels = self.levels.unwrap_or(1);
        expect_option(
            (1..=MAX_LEVELS).contains(&levels),
            "levels",
            levels,
            format_args!("1 to {MAX_LEVELS}, or none for as many as it takes"),
        )?;
        expect_option(
            is_positive(self.max_displacement),
            "max_displacement",
            self.max_displacement.unwrap_or_default(),
            "a positive number of pixels, or none for any displacement",
        )?;
        expect_option(self.max_iterations > 0, "max_iterations", 0, "1 or more")?;
        expect_option(
            is_positive(Some(self.epsilon)),
            "epsilon",
            self.epsilon,
            "a positive number of pixels",
        )?;
        expect_option(
            is_positive(self.max_forward_backward),
            "max_forward_backward",
            self.max_forward_backward.unwrap_or_default(),
            "a positive number of pixels, or none for no check",
        )
    }

    /// Levels of the pyramids of frames of this size: those that were set, or as many as the window and the displacement
    /// ask for. A pyramid of fewer levels is tracked on those that it has.
    ///
    /// ```
    /// use lk_core::TrackOptions;
    ///
    /// let options = TrackOptions::default();
    /// assert_eq!(options.levels_for(640, 480), 4);
    /// assert_eq!(options.max_displacement(Some(100.0)).levels_for(1920, 1080), 5);
    /// assert_eq!(TrackOptions::default().levels(Some(2)).levels_for(640, 480), 2);
    /// ```
    #[must_use]
    pub fn levels_for(&self, width: usize, height: usize) -> usize {
        if let Some(levels) = self.levels {
            return levels;
        }
        let window = self.window.width.max(self.window.height);
        // A window takes in motion up to about its half, so on the coarsest level this much of a displacement.
        let reach = (window as f32 * 0.5).max(2.0);
        let mut levels = 1;
        // A level that the window does not fit into twice tells nothing about a point.
        while width.min(height) >> levels >= 2 * window
            && levels < MAX_LEVELS
            && self
                .max_displacement
                .is_none_or(|longest| reach * ((1u32 << (levels - 1)) as f32) < longest)
            && (self.max_displacement.is_some() || levels < DEFAULT_LEVELS)
        {
            levels += 1;
        }
        levels
    }
}

/// Levels where nobody says how far things move: with a window of 21 pixels they take in some 80 pixels.
const DEFAULT_LEVELS: usize = 4;

/// Whether windows may turn, grow and shear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Deformation {
    /// Where many points are lost, fit badly, or move unlike their neighbours.
    #[default]
    Auto,
    /// Nowhere: windows move as a whole.
    None,
    /// Everywhere: each point has the affine motion of its window.
    Affine,
}

names!(Deformation, "deformation": Auto "auto", None "none", Affine "affine");

/// Whether a point was tracked, or else the first reason why not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum PointStatus {
    /// Tracked; position and covariance hold.
    Tracked = 0,
    /// The point is, or went, outside of the frame.
    OutOfFrame = 1,
    /// The window has too little texture, or only along one direction, to say where it went.
    LowTexture = 2,
    /// The steps did not come to rest.
    NotConverged = 3,
    /// What was found does not look like what was sought; or nine in ten of many points are lost, and no neighbour moves
    /// like this one.
    HighResidual = 4,
    /// Tracked back, the point did not return to where it came from.
    ForwardBackward = 5,
    /// A mask excludes the point, or where it went.
    Masked = 6,
    /// A coordinate of the point is NaN or infinite.
    NotFinite = 7,
    /// Found in this frame by a [`crate::PointTracker`]: it has a position, but no motion yet.
    New = 8,
    /// Fewer than an eighth of the window's pixels count in both frames: the others are outside, masked, or not finite.
    LowSupport = 9,
    /// The texture repeats: another displacement explains the window as well, is not longer than `max_displacement`, and
    /// nothing around the window tells which one it was.
    Ambiguous = 10,
}

impl PointStatus {
    /// Every status, in the order of its values.
    pub const ALL: [Self; 11] = [
        Self::Tracked,
        Self::OutOfFrame,
        Self::LowTexture,
        Self::NotConverged,
        Self::HighResidual,
        Self::ForwardBackward,
        Self::Masked,
        Self::NotFinite,
        Self::New,
        Self::LowSupport,
        Self::Ambiguous,
    ];

    /// The name used in Python and in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracked => "tracked",
            Self::OutOfFrame => "out_of_frame",
            Self::LowTexture => "low_texture",
            Self::NotConverged => "not_converged",
            Self::HighResidual => "high_residual",
            Self::ForwardBackward => "forward_backward",
            Self::Masked => "masked",
            Self::NotFinite => "not_finite",
            Self::New => "new",
            Self::LowSupport => "low_support",
            Self::Ambiguous => "ambiguous",
        }
    }

    /// Whether another start could help.
    pub(super) fn is_retryable(self) -> bool {
        matches!(
            self,
            Self::OutOfFrame | Self::NotConverged | Self::HighResidual | Self::ForwardBackward
        )
    }
}

/// Where one point went.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct TrackedPoint {
    /// Position (x, y) in `next`, in pixels; NaN unless tracked.
    pub position: [f32; 2],
    /// Tracked, or why not.
    pub status: PointStatus,
    /// Root mean square difference of the window between the frames, in grey levels, after the lighting model;
    /// NaN if it was not measured.
    pub residual: f32,
    /// Covariance of the position in square pixels: xx, xy, yy; infinite unless tracked.
    pub covariance: [f32; 3],
    /// Distance from where the point came from to where it comes back, in pixels; NaN if it was not measured.
    pub forward_backward: f32,
    /// How the surroundings are turned, scaled and sheared: where the offsets (1, 0) and (0, 1) from the point are in
    /// `next`, as columns. The identity where a displacement alone explains the window; NaN unless tracked.
    pub deformation: [[f32; 2]; 2],
    /// Share of the window's variance that is left; 0 unless tracked.
    pub(crate) unexplained: f32,
}

impl TrackedPoint {
    /// A point that was not tracked, for this reason.
    #[must_use]
    pub fn lost(status: PointStatus) -> Self {
        Self {
            position: [f32::NAN; 2],
            status,
            residual: f32::NAN,
            covariance: [f32::INFINITY, 0.0, f32::INFINITY],
            forward_backward: f32::NAN,
            deformation: [[f32::NAN; 2]; 2],
            unexplained: 0.0,
        }
    }

    /// How far a tracked point went from `origin`.
    pub(crate) fn displacement(&self, origin: [f32; 2]) -> [f64; 2] {
        [
            f64::from(self.position[0]) - f64::from(origin[0]),
            f64::from(self.position[1]) - f64::from(origin[1]),
        ]
    }

    /// Whether the point was tracked.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.status == PointStatus::Tracked
    }
}
