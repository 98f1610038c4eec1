//! A window that shows structure in one direction only: the displacement across the structure.
//!
//! `docs/explanation/algorithms.md`, section "One direction only".

use super::gauss_newton::{Found, Guess, Problem};
use super::judge::{AMBIGUITY_RATIO, EXPLAINED, measured};
use super::matrix::{largest_direction, quadratic};
use super::model::LightScope;
use super::normalization::Normalization;
use super::result::{Shift, ShiftStatus};
use super::view::GainField;
use crate::error::Result;

/// A standard deviation above this is no measurement, in pixels.
const MAX_SIGMA: f64 = 0.5;
/// What the interpolation of one edge that is not blurred errs by, in pixels, as a standard deviation over its places
/// between the samples: hundreds of pixels along it may all err alike,
const PROFILE_SIGMA: f64 = 0.012;
/// with the dampings by smoothness of an edge that is not blurred and of one that is blurred enough to be sampled, by a
/// Gaussian of half a pixel.
const UNBLURRED: f64 = 0.7;
const BLURRED: f64 = 0.77;
/// A direction is taken for an axis where the motion along the structure, as far as it may go, adds no more than this
/// to the other axis, in pixels.
const AXIS_TOLERANCE: f64 = 0.1;

/// The displacement across the structure of a window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Across {
    found: Found,
    /// A unit vector across the structure.
    pub(super) direction: [f64; 2],
    /// The displacement along it.
    pub(super) across: f64,
    variance: f64,
}

impl Problem<'_> {
    /// The displacement across the structure, from what was found without knowing that there is one direction only;
    /// `None` if it cannot be measured either.
    pub(super) fn along_one_direction(&mut self, found: &Found) -> Result<Option<Across>> {
        // The border of the window, where gradients are not whole, turns the direction.
        let inside = self.inside(found)?;
        let solution = inside.as_ref().unwrap_or(&found.solution);
        let direction = largest_direction(solution.information_matrix);
        let [dx, dy] = found.displacement;
        let across = dx * direction[0] + dy * direction[1];
        let guess = |found: &Found, scope| Guess {
            displacement: direction.map(|value| value * across),
            direction: Some(direction),
            to_the_end: true,
            ..found.guess(scope)
        };
        let systematic = found.systematic;
        let plain = Guess {
            gain: GainField::default(),
            ..guess(found, LightScope::Window)
        };
        // A gain that varies with place or grey level may be the motion of an edge: the simplest light that explains the
        // frames is taken.
        let left = |found: &Found| 1.0 - found.solution.correlation;
        let explains = |plain: &Found| {
            plain.steady && left(plain) < (1.0 - EXPLAINED).max(AMBIGUITY_RATIO * left(found))
        };
        let mut found = match self.gauss_newton(plain)? {
            Ok(plain) if explains(&plain) => plain,
            _ => match self.gauss_newton(guess(found, found.scope))? {
                Ok(found) => found,
                Err(_) => return Ok(None),
            },
        };
        let [dx, dy] = found.displacement;
        found.add(systematic);
        found.add(self.aliasing(&found, Some(direction))?);
        let sharpness = (BLURRED - found.solution.damping) / (BLURRED - UNBLURRED);
        let profile = PROFILE_SIGMA * sharpness.clamp(0.0, 1.0);
        let variance = profile * profile
            + found.solution.variance_along(direction)
            + quadratic(found.systematic, direction);
        Ok(
            (found.steady && variance < MAX_SIGMA * MAX_SIGMA).then_some(Across {
                found,
                direction,
                across: dx * direction[0] + dy * direction[1],
                variance,
            }),
        )
    }
}

impl Across {
    /// The result: the displacement across the structure, and infinite variance along it.
    pub(super) fn shift(&self, normalization: Normalization, limit: [f64; 2]) -> Shift {
        let (mut direction, mut variance) = (self.direction, self.variance);
        for axis in 0..2 {
            let slip = direction[1 - axis] * limit[1 - axis];
            if slip.abs() < AXIS_TOLERANCE {
                direction[axis] = direction[axis].signum();
                direction[1 - axis] = 0.0;
                variance += slip * slip;
                break;
            }
        }
        let [x, y] = direction;
        let along = |product: f64| {
            if product == 0.0 {
                0.0
            } else {
                product * f64::INFINITY
            }
        };
        let cross = variance * x * y + along(-x * y);
        Shift {
            dx: self.across * x,
            dy: self.across * y,
            covariance: [
                [variance * x * x + along(y * y), cross],
                [cross, variance * y * y + along(x * x)],
            ],
            direction,
            direction_variance: variance,
            gradient: [[f64::NAN; 2]; 2],
            joint_covariance: Shift::invalid(ShiftStatus::Aperture).joint_covariance,
            ..measured(normalization, &self.found, ShiftStatus::Aperture)
        }
    }
}
