//! What is asked of the frames before their flow is known, beside the coarsest levels, which are too small to divide.

use crate::error::Result;
use crate::frame::Plane;

use super::light::Light;
use super::{large_motion, photometric_align};

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
        self.contrast = contrast.then(|| large_motion::contrast(&self.prev));
        self.lit =
            light && photometric_align::gain_matters(&mut self.light, &self.prev, next, weight)?;
        Ok(())
    }
}
