//! What is asked of the frames before their flow is known, beside the coarsest levels, which are too small to divide.

use crate::error::Result;
use crate::frame::Plane;

use super::light::{LIGHT_RADII, Light};

/// Whether light has changed is looked at closely where the logarithm of the gain exceeds this.
const SUSPICIOUS: f64 = 0.05;
/// Half the windows whose contrast is measured, and the distance from one to the next.
const RADIUS: usize = 3;

/// Looks at one level, and the memory for them.
#[derive(Debug, Default)]
pub(super) struct Looks {
    /// The level of `prev` as it came: the measurement writes to its own.
    prev: Plane,
    /// Of no size where every pixel counts.
    weight: Plane,
    light: Light,
    /// The contrast of `prev`, if it was asked for.
    pub(super) contrast: Option<f64>,
    /// Whether the light may have changed by more than an offset.
    pub(super) lit: bool,
}

impl Looks {
    /// Take the level to look at.
    pub(super) fn take(&mut self, prev: &Plane, weight: Option<&Plane>) -> Result<()> {
        self.prev.copy_of(prev)?;
        match weight {
            Some(weight) => self.weight.copy_of(weight),
            None => self.weight.resize(0, 0),
        }
    }

    /// Look at the contrast, if it is wanted, and at the light.
    pub(super) fn look(&mut self, next: &Plane, contrast: bool, light: bool) -> Result<()> {
        let weight = Some(&self.weight).filter(|plane| plane.width() > 0);
        self.contrast = contrast.then(|| contrast_of(&self.prev));
        self.lit = light && gain_matters(&mut self.light, &self.prev, next, weight)?;
        Ok(())
    }
}

/// Whether the light may have changed by more than an offset from `prev` to `next`, a coarse level of both.
fn gain_matters(
    memory: &mut Light,
    prev: &Plane,
    next: &Plane,
    weight: Option<&Plane>,
) -> Result<bool> {
    let [trend, beyond] = memory.change(prev, next, weight, LIGHT_RADII.1)?;
    Ok(trend > SUSPICIOUS || beyond > 2.0 * SUSPICIOUS)
}

/// The mean standard deviation of grey levels within windows.
fn contrast_of(plane: &Plane) -> f64 {
    let (mut all, mut windows) = (0.0, 0.0);
    for y in (0..plane.height()).step_by(RADIUS) {
        for x in (0..plane.width()).step_by(RADIUS) {
            let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for row in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(plane.height()) {
                let columns = x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(plane.width());
                for value in &plane.row(row)[columns] {
                    let value = f64::from(*value);
                    n += 1.0;
                    sum += value;
                    squares += value * value;
                }
            }
            all += (squares / n - (sum / n).powi(2)).max(0.0).sqrt();
            windows += 1.0;
        }
    }
    if windows > 0.0 { all / windows } else { 0.0 }
}
