//! The normal equations of one window, with the lighting model taken out of the sums.
//!
//! With d = next - prev, motion by s, and light that changes by a gain g and an offset that varies linearly over the
//! window, d = (g - 1) a + offset - g grad(a).s. The unknowns of the light are eliminated in closed form, so that a
//! step is one 2 x 2 solve under every model.

use crate::illumination::Illumination;
use crate::track::patch::{Sums, Template};

/// Gains beyond which two windows are not the same thing in another light.
pub(crate) const GAIN_RANGE: (f64, f64) = (0.25, 4.0);

/// Share of the gradients' energy along the weak direction below which single precision has no digit left for it.
const LEAST_SHARE: f64 = 1e-5;

/// Correlation of the noise of two samples one and two pixels apart along an axis: the cubic B-spline's weights at a
/// whole pixel, 1/6, 4/6 and 1/6, correlated with themselves.
const NOISE_CORRELATION: [f64; 2] = [4.0 / 9.0, 1.0 / 18.0];

/// What of the light is unknown in one window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Light {
    gain: bool,
    offset: bool,
    /// Whether the offset varies linearly over the window.
    tilt: bool,
}

impl Light {
    pub(crate) const STEADY: Self = Self {
        gain: false,
        offset: false,
        tilt: false,
    };
    pub(crate) const OFFSET: Self = Self {
        offset: true,
        ..Self::STEADY
    };
    pub(crate) const GAIN_OFFSET: Self = Self {
        gain: true,
        ..Self::OFFSET
    };
    pub(crate) const TILTED_OFFSET: Self = Self {
        tilt: true,
        ..Self::OFFSET
    };

    pub(crate) fn of(illumination: Illumination) -> Self {
        match illumination {
            Illumination::None => Self::STEADY,
            Illumination::Offset => Self::OFFSET,
            Illumination::GainOffset => Self::GAIN_OFFSET,
        }
    }

    pub(crate) fn has_gain(self) -> bool {
        self.gain
    }

    pub(crate) fn has_offset(self) -> bool {
        self.offset
    }

    pub(crate) fn has_tilt(self) -> bool {
        self.tilt
    }

    /// The same, with an offset that varies over the window where the model has a gain.
    pub(crate) fn with_tilt(self) -> Self {
        Self {
            tilt: self.gain,
            ..self
        }
    }
}

/// The normal equations of one template, inverted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Normal {
    light: Light,
    area: f64,
    moments: [f64; 2],
    /// Of the intensity and both gradients: mean, and slopes along x and y.
    mean: [f64; 3],
    slopes: [[f64; 3]; 2],
    /// The part of the intensity in both gradients.
    part: [f64; 2],
    /// Sum of the squared intensity, and of its products with the gradients.
    intensity: [f64; 3],
    /// Sum of the squared intensity without its mean.
    contrast: f64,
    /// The inverse of the structure tensor, summed over the window: xx, xy, yy.
    inverse: [f64; 3],
}

/// One step of the least squares.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) by: [f64; 2],
    pub(crate) gain: f64,
    /// Sum of squares that is left after the step.
    pub(crate) left: f64,
}

impl Normal {
    /// `None` if the window's texture does not fix a displacement at all, or holds a NaN.
    pub(crate) fn new(template: &Template, light: Light) -> Option<Self> {
        let Light { gain, offset, tilt } = light;
        let area = template.window.area();
        let moments = template.window.moments();
        let sums = &template.sums;
        let mut products = sums.products;
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (product, (i, j)) in products.iter_mut().zip(pairs) {
            if offset {
                *product -= sums.plain[i] * sums.plain[j] / area;
            }
            if tilt {
                *product -= sums.with_x[i] * sums.with_x[j] / moments[0];
                *product -= sums.with_y[i] * sums.with_y[j] / moments[1];
            }
        }
        let [aa, ax, ay, mut xx, mut xy, mut yy] = products;
        // A window without contrast has no gain to speak of.
        let gain = gain && aa > LEAST_SHARE * sums.products[0];
        let mut part = [0.0; 2];
        if gain {
            part = [ax / aa, ay / aa];
            xx -= ax * part[0];
            xy -= ax * part[1];
            yy -= ay * part[1];
        }
        let determinant = xx * yy - xy * xy;
        let weakest = 0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        let energy = sums.products[3] + sums.products[5];
        if !(determinant > 0.0 && weakest > LEAST_SHARE * energy && energy.is_finite()) {
            return None;
        }
        Some(Self {
            light: Light { gain, ..light },
            area,
            moments,
            mean: sums.plain.map(|sum| sum / area),
            slopes: [
                sums.with_x.map(|sum| sum / moments[0]),
                sums.with_y.map(|sum| sum / moments[1]),
            ],
            part,
            intensity: [aa.max(0.0), ax, ay],
            contrast: (sums.products[0] - sums.plain[0] * sums.plain[0] / area).max(0.0),
            inverse: [yy / determinant, -xy / determinant, xx / determinant],
        })
    }

    /// The step for these sums.
    pub(crate) fn step(&self, sums: &Sums) -> Step {
        let mut products = sums.products;
        let mut left = sums.squared;
        if self.light.offset {
            left -= sums.plain * sums.plain / self.area;
            for (product, mean) in products.iter_mut().zip(self.mean) {
                *product -= mean * sums.plain;
            }
        }
        if self.light.tilt {
            for axis in 0..2 {
                left -= sums.tilt[axis] * sums.tilt[axis] / self.moments[axis];
                for (product, slope) in products.iter_mut().zip(self.slopes[axis]) {
                    *product -= slope * sums.tilt[axis];
                }
            }
        }
        let [intensity, mut x, mut y] = products;
        let [aa, ax, ay] = self.intensity;
        if self.light.gain {
            left -= intensity * intensity / aa;
            x -= self.part[0] * intensity;
            y -= self.part[1] * intensity;
        }
        let [xx, xy, yy] = self.inverse;
        let scaled = [-(xx * x + xy * y), -(xy * x + yy * y)];
        left += scaled[0] * x + scaled[1] * y;
        let mut gain = 1.0;
        if self.light.gain {
            gain += (intensity + scaled[0] * ax + scaled[1] * ay) / aa;
        }
        let usable = gain.clamp(GAIN_RANGE.0, GAIN_RANGE.1);
        Step {
            by: scaled.map(|component| component / usable),
            gain,
            left: left.max(0.0),
        }
    }

    /// Mean square of what `step` leaves, in square grey levels.
    pub(crate) fn variance(&self, step: &Step) -> f64 {
        let unknowns = 2.0
            + f64::from(u8::from(self.light.offset))
            + f64::from(u8::from(self.light.gain))
            + 2.0 * f64::from(u8::from(self.light.tilt));
        step.left / (self.area - unknowns).max(1.0)
    }

    /// By how much one more unknown that explains nothing lowers the sum of squares: the noise of smooth functions of
    /// the coordinates, over which the spline's correlation adds up.
    pub(crate) fn noise(&self, step: &Step) -> f64 {
        let [one, two] = NOISE_CORRELATION;
        let along = 1.0 + 2.0 * (one + two);
        self.variance(step) * along * along
    }

    /// Mean square of the window's own grey levels, without what an offset explains, times the squared gain.
    pub(crate) fn signal(&self, step: &Step) -> f64 {
        step.gain * step.gain * self.contrast / self.area
    }

    /// Covariance of the displacement where what is left has variance 1 a pixel, and no correlation: xx, xy, yy.
    pub(crate) fn unit_covariance(&self, step: &Step) -> [f64; 3] {
        self.inverse.map(|entry| entry / (step.gain * step.gain))
    }
}
