//! The normal equations of one window, with the lighting model taken out of the sums.
//!
//! With d = next - prev, motion by s, and light that changes by a gain g and an offset that varies linearly over the
//! window, d = (g - 1) a + offset - g grad(a).s. The unknowns of the light are eliminated in closed form, so that a
//! step is one 2 x 2 solve under every model.
//!
//! `docs/explanation/algorithms.md`, section "One window".

use crate::track::patch::{Light, Sums, Template};

/// Gains beyond which two windows are not the same thing in another light.
pub(crate) const GAIN_RANGE: (f64, f64) = (0.25, 4.0);

/// Share of the gradients' energy along the weak direction below which single precision has no digit left for it.
const LEAST_SHARE: f64 = 1e-5;

/// Correlation of the noise of two samples one and two pixels apart along an axis: the cubic B-spline's weights at a
/// whole pixel, 1/6, 4/6 and 1/6, correlated with themselves.
const NOISE_CORRELATION: [f64; 2] = [4.0 / 9.0, 1.0 / 18.0];

/// Lighting models within "gain_offset", the simplest first, and how much more than the full one they may leave: the
/// 90 % quantile of chi squared for the unknowns that they lack.
pub(super) const SIMPLER: [(Light, f64); 4] = [
    (Light::STEADY, 7.78),
    (Light::OFFSET, 6.25),
    (Light::GAIN_OFFSET, 4.61),
    (Light::TILTED_OFFSET, 2.71),
];

/// By how much one more unknown that explains nothing lowers the sum of squares, for a mean square of what is left: the
/// noise of smooth functions of the coordinates, over which the spline's correlation adds up.
pub(super) fn unit_noise(variance: f64) -> f64 {
    let [one, two] = NOISE_CORRELATION;
    let along = 1.0 + 2.0 * (one + two);
    variance * along * along
}

/// The normal equations of one template, inverted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Normal {
    light: Light,
    /// What was asked for: a window without contrast has no gain.
    model: Light,
    area: f64,
    /// One over the area, and over the moments.
    share: f64,
    shares: [f64; 2],
    /// Of the intensity and both gradients: mean, and slopes along x and y.
    mean: [f64; 3],
    slopes: [[f64; 3]; 2],
    /// The part of the intensity in both gradients.
    part: [f64; 2],
    /// One over the sum of the squared intensity, without what an offset explains.
    intensity: f64,
    /// Sum of the squared intensity without its mean.
    contrast: f64,
    /// The inverse of the structure tensor, summed over the window: xx, xy, yy.
    inverse: [f64; 3],
}

/// One step of the least squares.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) delta: [f64; 2],
    pub(crate) gain: f64,
}

impl Step {
    /// The displacement after it.
    pub(crate) fn after(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x + self.delta[0], y + self.delta[1]]
    }
}

impl Normal {
    /// `None` if the window's texture does not fix a displacement at all, or holds a NaN.
    pub(crate) fn new(template: &Template, light: Light) -> Option<Self> {
        let Light { gain, offset, tilt } = light;
        let area = template.area();
        let (share, sums) = (1.0 / area, &template.sums);
        let mean = sums.plain.map(|sum| sum * share);
        let mut products = sums.products;
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        if offset {
            for (product, (i, j)) in products.iter_mut().zip(pairs) {
                *product -= sums.plain[i] * mean[j];
            }
        }
        let (mut shares, mut slopes) = ([0.0; 2], [[0.0; 3]; 2]);
        if tilt {
            shares = template.moments().map(|moment| 1.0 / moment);
            slopes = [
                sums.with_x.map(|sum| sum * shares[0]),
                sums.with_y.map(|sum| sum * shares[1]),
            ];
            for (product, (i, j)) in products.iter_mut().zip(pairs) {
                *product -= sums.with_x[i] * slopes[0][j];
                *product -= sums.with_y[i] * slopes[1][j];
            }
        }
        let [aa, ax, ay, mut xx, mut xy, mut yy] = products;
        // A window without contrast has no gain to speak of.
        let gain = gain && aa > LEAST_SHARE * sums.products[0];
        let (mut part, mut intensity) = ([0.0; 2], 0.0);
        if gain {
            intensity = 1.0 / aa;
            part = [ax * intensity, ay * intensity];
            xx -= ax * part[0];
            xy -= ax * part[1];
            yy -= ay * part[1];
        }
        let determinant = xx * yy - xy * xy;
        let energy = sums.products[3] + sums.products[5];
        // Both eigenvalues are above `least` where the tensor without it is positive definite.
        let least = LEAST_SHARE * energy;
        let (over_x, over_y) = (xx - least, yy - least);
        let textured = determinant > 0.0
            && over_x + over_y > 0.0
            && over_x * over_y > xy * xy
            && energy.is_finite();
        if !textured {
            return None;
        }
        let scale = 1.0 / determinant;
        Some(Self {
            light: Light { gain, ..light },
            model: light,
            area,
            share,
            shares,
            mean,
            slopes,
            part,
            intensity,
            contrast: (sums.products[0] - sums.plain[0] * mean[0]).max(0.0),
            inverse: [yy * scale, -xy * scale, xx * scale],
        })
    }

    /// What may change in the light.
    pub(crate) fn model(&self) -> Light {
        self.model
    }

    /// The products of `sums` without what the offset and its slopes explain.
    fn without_offset(&self, sums: &Sums) -> [f64; 3] {
        let mut products = sums.products;
        if self.light.offset {
            for (product, mean) in products.iter_mut().zip(self.mean) {
                *product -= mean * sums.plain;
            }
        }
        if self.light.tilt {
            for axis in 0..2 {
                for (product, slope) in products.iter_mut().zip(self.slopes[axis]) {
                    *product -= slope * sums.tilt[axis];
                }
            }
        }
        products
    }

    /// The step for these sums.
    pub(crate) fn step(&self, sums: &Sums) -> Step {
        let [intensity, mut x, mut y] = self.without_offset(sums);
        if self.light.gain {
            x -= self.part[0] * intensity;
            y -= self.part[1] * intensity;
        }
        let [xx, xy, yy] = self.inverse;
        let scaled = [-(xx * x + xy * y), -(xy * x + yy * y)];
        if !self.light.gain {
            return Step {
                delta: scaled,
                gain: 1.0,
            };
        }
        let gain =
            1.0 + intensity * self.intensity + scaled[0] * self.part[0] + scaled[1] * self.part[1];
        let usable = 1.0 / gain.clamp(GAIN_RANGE.0, GAIN_RANGE.1);
        Step {
            delta: scaled.map(|component| component * usable),
            gain,
        }
    }

    /// Sum of squares that the step for these sums leaves.
    pub(crate) fn left(&self, sums: &Sums) -> f64 {
        let mut left = sums.squared;
        if self.light.offset {
            left -= sums.plain * sums.plain * self.share;
        }
        if self.light.tilt {
            for axis in 0..2 {
                left -= sums.tilt[axis] * sums.tilt[axis] * self.shares[axis];
            }
        }
        let [intensity, mut x, mut y] = self.without_offset(sums);
        if self.light.gain {
            left -= intensity * intensity * self.intensity;
            x -= self.part[0] * intensity;
            y -= self.part[1] * intensity;
        }
        let [xx, xy, yy] = self.inverse;
        left -= (xx * x + xy * y) * x + (xy * x + yy * y) * y;
        left.max(0.0)
    }

    /// Mean square of what is left, in square grey levels.
    pub(crate) fn variance(&self, left: f64) -> f64 {
        let unknowns = 2.0
            + f64::from(u8::from(self.light.offset))
            + f64::from(u8::from(self.light.gain))
            + 2.0 * f64::from(u8::from(self.light.tilt));
        left / (self.area - unknowns).max(1.0)
    }

    /// [`unit_noise`] of what is left.
    pub(crate) fn noise(&self, left: f64) -> f64 {
        unit_noise(self.variance(left))
    }

    /// Mean square of the window's own grey levels, without what an offset explains, times the squared gain.
    pub(crate) fn signal(&self, step: &Step) -> f64 {
        step.gain * step.gain * self.contrast * self.share
    }

    /// Covariance of the displacement where what is left has variance 1 a pixel, and no correlation: xx, xy, yy.
    pub(crate) fn unit_covariance(&self, step: &Step) -> [f64; 3] {
        let scale = 1.0 / (step.gain * step.gain);
        self.inverse.map(|entry| entry * scale)
    }
}
