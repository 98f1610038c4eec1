//! A window that shows structure in one direction only: the displacement across the structure.

use super::estimate::measured;
use super::gauss_newton::{Found, Guess, Problem};
use super::matrix::{largest_direction, quadratic};
use super::normalization::Normalization;
use super::{Shift, ShiftStatus};
use crate::error::Result;

/// A standard deviation above this is no measurement, in pixels.
const MAX_SIGMA: f64 = 0.5;
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
        let direction = largest_direction(found.solution.information_matrix);
        let [dx, dy] = found.displacement;
        let across = dx * direction[0] + dy * direction[1];
        let guess = Guess {
            displacement: direction.map(|value| value * across),
            direction: Some(direction),
            to_the_end: true,
            ..found.guess(found.scope)
        };
        let systematic = found.systematic;
        let Ok(found) = self.gauss_newton(guess)? else {
            return Ok(None);
        };
        let [dx, dy] = found.displacement;
        let variance = found.solution.variance_along(direction) + quadratic(systematic, direction);
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
