//! One window fitted: Gauss-Newton over its motion and its light, from the slopes of `prev` alone, so that noise in `next`
//! is not weighted by itself.
//!
//! S. Baker and I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004 (inverse compositional).

use super::cholesky::{Factor, MOST};
use super::equations::{Equations, light_columns, normal_matrix};
use super::frames::{Frames, MARGIN, REACH};
use super::kernels::{LIGHT, Normal, Pull, Pulling, Sample};
use super::robust::{change_of_pull, reweigh};
use super::shape::{TERMS, Warp, monomials};
use super::window::{Pattern, Window};
use crate::illumination::Illumination;
use crate::simd::{SimdLevel, dispatch};

/// Steps at most.
const STEPS: usize = 24;
/// A step that moves no pixel of the window by more than this, in pixels, is the last.
const SETTLED: f64 = 0.004;
/// Least share of the window that counts.
const LEAST_SHARE: f64 = 0.25;
/// Steps before pixels are weighted by what is left of them.
const STEPS_BEFORE_WEIGHTS: usize = 2;
/// Why a fit has no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Failure {
    /// Too few pixels count.
    Support,
    /// The texture does not tell the unknowns apart.
    Texture,
    /// The steps did not come to rest.
    Diverged,
}

/// What is fitted, and how.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fitting<'a> {
    pub(super) frames: &'a Frames,
    pub(super) pattern: &'a Pattern,
    pub(super) degree: usize,
    pub(super) illumination: Illumination,
    pub(super) robust: bool,
    /// How far the centre may move, in pixels.
    pub(super) reach: f64,
    pub(super) level: SimdLevel,
}

/// A fit that has come to rest.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    pub(super) warp: Warp,
    /// Gain, offset at the centre, and its slopes.
    pub(super) light: [f64; LIGHT],
    /// The factor of the normal equations of u, v and light; of displacements in `prev`, times the gain.
    pub(super) factor: Factor,
    /// Unknowns of the light, which come after those of the motion.
    pub(super) lights: usize,
    /// The weighted mean square of what is left.
    pub(super) variance: f64,
}

impl Fitting<'_> {
    /// Fit the window of `window`, whose first pixel is at `corner`, from `start`.
    pub(super) fn fit(
        &self,
        window: &mut Window,
        corner: [usize; 2],
        start: Warp,
    ) -> Result<Fitted, Failure> {
        let mut warp = start;
        let mut light = [1.0, 0.0, 0.0, 0.0];
        self.meet(window, corner, &warp)?;
        let mut equations = self.equations(window)?;
        let mut settled = false;
        for step in 0..STEPS {
            self.sample(window, corner, &warp, light);
            if self.robust && step >= STEPS_BEFORE_WEIGHTS {
                reweigh(window, light[0]);
                equations = self.equations(window)?;
            }
            let pull = self.pull(window);
            let size = self.advance(&equations.factor, &pull, &mut warp, &mut light);
            let [u, v] = warp.displacement();
            if !(warp.is_finite() && u.abs().max(v.abs()) <= self.reach && light[0] > 0.05) {
                return Err(Failure::Diverged);
            }
            if size < SETTLED && (!self.robust || step > STEPS_BEFORE_WEIGHTS) {
                if settled || !self.meets_others(window, corner, &warp)? {
                    return Ok(self.finish(window, corner, warp, light, equations));
                }
                // The window has come to where other pixels count.
                settled = true;
                equations = self.equations(window)?;
            }
        }
        Err(Failure::Diverged)
    }

    /// Why a window that does not move could not be fitted.
    pub(super) fn reason(&self, window: &mut Window, corner: [usize; 2]) -> Option<Failure> {
        let found = self.meet(window, corner, &Warp::default());
        found.and_then(|()| self.equations(window).map(drop)).err()
    }

    /// Take the pixels that count under `warp`.
    fn meet(&self, window: &mut Window, corner: [usize; 2], warp: &Warp) -> Result<(), Failure> {
        let near = self.is_near(corner, warp);
        let centre = [0, 1].map(|axis| corner[axis] as f64 + self.pattern.half);
        let half = self.pattern.half;
        window.meet(self.frames, near, |at| {
            let (x, y) = (f64::from(self.pattern.x[at]), f64::from(self.pattern.y[at]));
            let [u, v] = warp.seen_from([x, y]).displacement();
            [centre[0] + x * half + u, centre[1] + y * half + v]
        });
        if window.counted < LEAST_SHARE * (self.pattern.side * self.pattern.side) as f64 {
            return Err(Failure::Support);
        }
        Ok(())
    }

    /// [`Fitting::meet`] again, and whether that has changed how many count.
    fn meets_others(
        &self,
        window: &mut Window,
        corner: [usize; 2],
        warp: &Warp,
    ) -> Result<bool, Failure> {
        if self.robust || self.is_near(corner, warp) {
            return Ok(false);
        }
        let before = window.counted;
        self.meet(window, corner, warp)?;
        Ok(window.counted != before)
    }

    /// Whether all pixels stay well within what counts in `next`.
    fn is_near(&self, corner: [usize; 2], warp: &Warp) -> bool {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for place in [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]] {
            let moved = warp.seen_from(place).displacement();
            for axis in 0..2 {
                let at =
                    corner[axis] as f64 + self.pattern.half * (1.0 + place[axis]) + moved[axis];
                (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
            }
        }
        // A quadratic shape may bulge beyond its corners by as much as its factors say.
        let bulge = warp
            .0
            .map(|factors| factors[3..].iter().map(|c| c.abs()).sum::<f64>());
        let size = self.frames.size();
        let mut first = [0isize; 2];
        let mut count = [0usize; 2];
        for axis in 0..2 {
            let reach = REACH as f64 + 1.0;
            let (low, high) = (
                low[axis] - bulge[axis] - reach,
                high[axis] + bulge[axis] + reach,
            );
            if !(low >= 0.0 && high < size[axis] as f64) {
                return false;
            }
            first[axis] = low as isize;
            count[axis] = (high - low).ceil() as usize + 1;
        }
        self.frames
            .next_support
            .has_all((first[0], first[1]), count[0], count[1])
    }

    /// Sample `next` under `warp` and write what is left.
    fn sample(&self, window: &mut Window, corner: [usize; 2], warp: &Warp, light: [f64; LIGHT]) {
        let coefficients = &self.frames.coefficients;
        let size = [coefficients.width(), coefficients.height()];
        let mut first = [0usize; 2];
        let mut place = [[0.0f32; TERMS]; 2];
        let mut limit = [0.0f32; 2];
        // Room around the window for all that it may come to, so that places count from near by.
        let room = 2.0 * self.pattern.half + 8.0;
        for axis in 0..2 {
            // The first of four taps stands one before; the margin is before the frame.
            let centre =
                corner[axis] as f64 + self.pattern.half + warp.0[axis][0] + MARGIN as f64 - 1.0;
            let most = size[axis] - 4;
            first[axis] = ((centre - room).floor().max(0.0) as usize).min(most);
            place[axis] = warp.0[axis].map(|factor| factor as f32);
            place[axis][0] = (centre - first[axis] as f64) as f32;
            place[axis][1 + axis] = (warp.0[axis][1 + axis] + self.pattern.half) as f32;
            limit[axis] = ((most - first[axis]) as f32).min(2.0 * room as f32);
        }
        let from = &coefficients.data()[first[1] * size[0] + first[0]..];
        let sampling = (place, limit, light.map(|light| light as f32));
        match self.degree {
            2 => self.sample_as::<2>(window, from, sampling),
            _ => self.sample_as::<1>(window, from, sampling),
        }
    }

    fn sample_as<const D: usize>(
        &self,
        window: &mut Window,
        coefficients: &[f32],
        (place, limit, light): ([[f32; TERMS]; 2], [f32; 2], [f32; LIGHT]),
    ) {
        let kernel = Sample::<D> {
            pattern: self.pattern,
            template: &window.template,
            residual: &mut window.residual,
            coefficients,
            stride: self.frames.coefficients.width(),
            place,
            limit,
            light,
        };
        dispatch(self.level, kernel);
    }

    /// How far the centre would move, in u and v, if the shape were quadratic: nothing unless that is more than noise
    /// explains.
    pub(super) fn bend(&self, window: &Window, fitted: &Fitted) -> [f64; 2] {
        const TOLD: f64 = 3.0;
        let bent = Self { degree: 2, ..*self };
        let Ok(equations) = bent.equations(window) else {
            return [0.0; 2];
        };
        let (mut warp, mut light) = (fitted.warp, fitted.light);
        bent.advance(&equations.factor, &bent.pull(window), &mut warp, &mut light);
        let (moved, from) = (warp.displacement(), fitted.warp.displacement());
        let terms = [monomials(self.degree), TERMS];
        std::array::from_fn(|axis| {
            let by =
                |factor: &Factor, terms: usize| factor.inverse_column(axis * terms)[axis * terms];
            let more = by(&equations.factor, terms[1]) - by(&fitted.factor, terms[0]);
            let noise = fitted.variance * more.max(0.0) / fitted.light[0].powi(2);
            let bend = moved[axis] - from[axis];
            if bend.abs() > TOLD * noise.sqrt() {
                bend
            } else {
                0.0
            }
        })
    }

    fn pull(&self, window: &Window) -> Pull {
        let pattern = self.pattern;
        match self.degree {
            0 => dispatch(self.level, Pulling::<0> { pattern, window }),
            1 => dispatch(self.level, Pulling::<1> { pattern, window }),
            _ => dispatch(self.level, Pulling::<2> { pattern, window }),
        }
    }

    fn equations(&self, window: &Window) -> Result<Equations, Failure> {
        let pattern = self.pattern;
        let sums = match self.degree {
            0 => dispatch(self.level, Normal::<0> { pattern, window }),
            1 => dispatch(self.level, Normal::<1> { pattern, window }),
            _ => dispatch(self.level, Normal::<2> { pattern, window }),
        };
        let lights = light_columns(self.illumination).len();
        let (normal, size) = normal_matrix(&sums, self.degree, self.illumination);
        let factor = Factor::new(&normal, size).ok_or(Failure::Texture)?;
        Ok(Equations {
            weight: sums.weight[0],
            factor,
            lights,
        })
    }

    /// Step; the largest motion of a pixel of the window, in pixels.
    fn advance(
        &self,
        factor: &Factor,
        pull: &Pull,
        warp: &mut Warp,
        light: &mut [f64; LIGHT],
    ) -> f64 {
        let terms = monomials(self.degree);
        let mut rest = [0.0; MOST];
        for axis in 0..2 {
            rest[axis * terms..][..terms].copy_from_slice(&pull.slopes[axis][..terms]);
        }
        let columns = light_columns(self.illumination);
        for (to, column) in rest[2 * terms..].iter_mut().zip(columns) {
            *to = pull.light[*column];
        }
        factor.solve(&mut rest);
        for (change, column) in rest[2 * terms..].iter().zip(columns) {
            light[*column] += change;
        }
        let gradient = warp.gradient(self.pattern.half);
        let mut sizes = [0.0f64; 2];
        for term in 0..terms {
            let back = [rest[term], rest[terms + term]].map(|step| step / light[0]);
            for axis in 0..2 {
                let [a, b] = gradient[axis];
                let step = back[axis] + a * back[0] + b * back[1];
                warp.0[axis][term] -= step;
                sizes[axis] += step.abs();
            }
        }
        sizes[0].max(sizes[1])
    }

    fn finish(
        &self,
        window: &mut Window,
        corner: [usize; 2],
        warp: Warp,
        light: [f64; LIGHT],
        equations: Equations,
    ) -> Fitted {
        self.sample(window, corner, &warp, light);
        let mut factor = equations.factor;
        if self.robust {
            // How much more each pixel would pull if the window moved: less than its weight says.
            change_of_pull(window, light[0]);
            if let Ok(equations) = self.equations(window) {
                factor = equations.factor;
            }
            reweigh(window, light[0]);
        }
        let pull = self.pull(window);
        let all = equations.weight.max(f64::MIN_POSITIVE);
        Fitted {
            warp,
            light,
            factor,
            lights: equations.lights,
            variance: pull.square / all,
        }
    }
}
