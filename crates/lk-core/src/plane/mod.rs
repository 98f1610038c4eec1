//! The motion of a camera over a plane: how far it went, in units of its height, and how it turned.
//!
//! A point of the plane is seen by both frames where the motion, the attitude and the lens put it, exactly and for any
//! length of motion; see [`PlaneMotion`]. [`PlaneTracker`] finds the motion from frames themselves: tiles of the picture
//! that move as the motion says, each with its own light, robustly against what moves otherwise. [`fit_plane`] finds it
//! from points that were followed by other means.
//!
//! The rotation is solved for as far as what is known of it leaves it open ([`PlaneOptions::rotation`]): over a narrow
//! field of view a turn looks like a way, and what the data cannot tell apart is in the normal matrix.
//!
//! `docs/explanation/algorithms.md`, section "Velocity over a plane: VelocityEstimator".

mod fit;
mod follow;
mod followed;
mod lattice;
mod lens;
mod motion;
mod points;
#[cfg(test)]
mod properties;
mod seen;
#[cfg(test)]
mod tests;
mod tile;
mod tracker;
mod weights;

pub use fit::Normal as PlaneNormal;
pub use lens::{Distortion, Lens};
pub use motion::{PlaneInterval, PlaneMotion};
pub use points::{PlaneMatch, fit_plane};
pub use tracker::PlaneTracker;

use crate::error::Result;
use crate::execution::Execution;
use crate::options::{expect_option, setters};
use fit::Known;
use motion::UNKNOWNS;

/// What is known of the rotation where nobody says, in radians: nothing.
const ANY_ROTATION: f64 = 1.0;
/// A way of this many heights between two frames leaves nothing in view.
const ANY_WAY: f64 = 100.0;

/// How a motion is found.
///
/// ```
/// use lk_core::PlaneOptions;
///
/// // A gyro that is right to 1e-4 rad between the frames.
/// let options = PlaneOptions::default().rotation_std([1e-4; 3]);
/// assert!(options.validate().is_ok());
/// ```
#[derive(Debug, Clone)]
pub struct PlaneOptions {
    pub(crate) levels: usize,
    pub(crate) rotation: [f64; 3],
    pub(crate) rotation_covariance: [[f64; 3]; 3],
    pub(crate) responses: Vec<PlaneNumber>,
    pub(crate) execution: Execution,
}

impl Default for PlaneOptions {
    fn default() -> Self {
        Self {
            levels: 2,
            rotation: [0.0; 3],
            rotation_covariance: diagonal([ANY_ROTATION; 3]),
            responses: Vec::new(),
            execution: Execution::default(),
        }
    }
}

impl PlaneOptions {
    setters! {
        /// Levels of the pyramid to begin at, the frame itself included: each doubles how far the start may be off.
        levels(levels: usize);

        /// What the camera turned more than [`PlaneInterval::turn`], as far as it is known: a rotation vector in radians.
        rotation(rotation: [f64; 3]);

        /// The covariance of [`PlaneOptions::rotation`], in radians squared; any rotation by default.
        rotation_covariance(covariance: [[f64; 3]; 3]);

        /// Numbers whose effect on the motion is wanted, see [`PlaneFit::responses`].
        responses(numbers: Vec<PlaneNumber>);

        /// Threads, instructions and cancellation.
        execution(execution: Execution);
    }

    /// The same with this standard deviation of [`PlaneOptions::rotation`] about each axis, in radians.
    #[must_use]
    pub fn rotation_std(self, std: [f64; 3]) -> Self {
        self.rotation_covariance(diagonal(std))
    }

    /// Check every option.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option) for the first one outside of what it allows.
    pub fn validate(&self) -> Result<()> {
        expect_option(self.levels > 0, "levels", self.levels, "1 or more")?;
        for value in self.rotation {
            expect_option(
                value.is_finite(),
                "rotation",
                value,
                "finite angles in radians",
            )?;
        }
        let determinant = determinant(&self.rotation_covariance);
        let fits =
            determinant > 0.0 && determinant.is_finite() && self.rotation_covariance[0][0] > 0.0;
        let expected = "a positive covariance, in radians squared";
        expect_option(fits, "rotation_covariance", determinant, expected)
    }

    fn known(&self) -> Known {
        let mut precision = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (k, row) in precision.iter_mut().enumerate().take(3) {
            row[k] = ANY_WAY.powi(-2);
        }
        let c = &self.rotation_covariance;
        let whole = 1.0 / determinant(c);
        for i in 0..3 {
            for j in 0..3 {
                // Cofactors of the transpose: the inverse.
                let at = |row: usize, column: usize| c[(j + row) % 3][(i + column) % 3];
                precision[3 + i][3 + j] = whole * (at(1, 1) * at(2, 2) - at(1, 2) * at(2, 1));
            }
        }
        let [x, y, z] = self.rotation;
        Known {
            precision,
            at: [0.0, 0.0, 0.0, x, y, z],
        }
    }
}

/// A covariance without correlations.
fn diagonal(std: [f64; 3]) -> [[f64; 3]; 3] {
    let mut covariance = [[0.0; 3]; 3];
    for (k, std) in std.into_iter().enumerate() {
        covariance[k][k] = std * std;
    }
    covariance
}

fn determinant(c: &[[f64; 3]; 3]) -> f64 {
    let minor = |i: usize, j: usize| c[1][i] * c[2][j] - c[1][j] * c[2][i];
    c[0][0] * minor(1, 2) - c[0][1] * minor(0, 2) + c[0][2] * minor(0, 1)
}

/// A number that a motion depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PlaneNumber {
    /// Of the lens: focal lengths and principal point, x and y each, then the coefficients of the distortion.
    Lens(usize),
    /// The direction straight down, turned about the camera's x axis (0) or its y axis (1), in radians.
    Down(usize),
    /// [`PlaneInterval::readout`].
    Readout,
}

/// What one unit of a number does to the displacements of a plane.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct PlaneResponse {
    /// The right side of the normal equations: with the knowledge of the rotation added to the normal matrix, minus its
    /// inverse times this is the change of the motion.
    pub right: PlaneMotion,
    /// How much what the displacements leave looks like the number.
    pub score: f64,
    /// How much one unit of each of the numbers would look like this one: with the motion's normal matrix and `right`,
    /// this makes the normal matrix of both, with `score` on its right side.
    pub curvature: Vec<f64>,
}

/// A motion, what it was found from, and what it is worth.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct PlaneFit {
    /// The motion: the most likely one under the displacements and what is known of the rotation.
    pub motion: PlaneMotion,
    /// Normal matrix of the displacements alone, without what is known of the rotation: the inverse covariance of the
    /// motion where it is not singular.
    pub normal: PlaneNormal,
    /// What the displacements alone pull the motion by: with `normal` the right side of its normal equations, from
    /// `motion` on. Not zero where what is known of the rotation holds against them.
    pub pull: PlaneMotion,
    /// What each number asked for does to the displacements.
    pub responses: Vec<PlaneResponse>,
    /// Standard deviation of what the displacements leave, in those that they came with.
    pub scale: f64,
    /// Variance that neighbouring tiles which err alike add, in parts of that of chance: `normal` holds it.
    pub widened: f64,
    /// Root mean square of grey levels that motion and light leave where the frames fit best.
    pub residual: f64,
    /// Median correlation of the frames over the tiles.
    pub correlation: f64,
    /// Whether the last step was short.
    pub settled: bool,
    /// Each tile, or each point.
    pub tiles: Vec<PlaneTile>,
}

/// One displacement of which a motion was found.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PlaneTile {
    /// Half-way between its places in both frames, in pixels.
    pub middle: [f64; 2],
    /// Its displacement in pixels; NaN where it was not measured.
    pub displacement: [f64; 2],
    /// The displacement less that of the motion; NaN where it was not measured.
    pub residual: [f64; 2],
    /// How much it counted, 0 to 1.
    pub weight: f64,
    /// Inverse covariance of the displacement, xx, xy, yy, in pixels to the power -2; 0 where it was not measured.
    pub information: [f64; 3],
    /// Correlation of both frames over it, light taken out; 0 where it was not measured.
    pub correlation: f64,
    /// What became of it.
    pub status: PlaneTileStatus,
}

/// What became of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum PlaneTileStatus {
    /// It moves with the plane.
    Plane = 0,
    /// It is not within both frames, or masked.
    Outside = 1,
    /// It shows nothing, or only noise.
    LowTexture = 2,
    /// Both frames show different things where the plane should be.
    Unmatched = 3,
    /// It moves otherwise.
    Outlier = 4,
    /// It does not move: part of the vehicle, or dirt on the lens.
    Fixed = 5,
}

impl PlaneTileStatus {
    /// Every status, in the order of its values.
    pub const ALL: [Self; 6] = [
        Self::Plane,
        Self::Outside,
        Self::LowTexture,
        Self::Unmatched,
        Self::Outlier,
        Self::Fixed,
    ];

    /// The name used in Python.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Outside => "outside",
            Self::LowTexture => "low_texture",
            Self::Unmatched => "unmatched",
            Self::Outlier => "outlier",
            Self::Fixed => "fixed",
        }
    }
}

/// A motion checked to be finite.
fn expect_motion(motion: &PlaneMotion) -> Result<()> {
    for value in motion.iter().take(UNKNOWNS) {
        expect_option(value.is_finite(), "start", value, "finite numbers")?;
    }
    Ok(())
}
