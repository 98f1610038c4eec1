//! Rays of a camera's pixels, and pixels of rays: the models of OpenCV, both ways, in double precision.

use crate::error::Result;
use crate::options::expect_option;

/// Newton's steps double the digits near the solution; far out in a wide lens the first ones are short.
const ITERATIONS: usize = 50;
/// Largest error accepted of an inverse, in normalised units: 1e-8 pixels at a focal length of 1000.
const ENOUGH: f64 = 1e-11;

/// How a lens bends rays, with the coefficients in OpenCV's order.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Distortion {
    /// After Brown, with the rational and thin-prism terms: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4. All zero: none.
    Brown([f64; 12]),
    /// After Kannala and Brandt (2006), equidistant: k1 k2 k3 k4.
    Fisheye([f64; 4]),
}

/// A camera: intrinsics in pixels, pixel centres at integers, and the distortion of its lens.
///
/// ```
/// use lk_core::{Distortion, Lens};
///
/// let mut bent = [0.0; 12];
/// bent[0] = -0.2;
/// let lens = Lens::new([300.0, 300.0], [159.5, 119.5], Distortion::Brown(bent))?;
/// let pixel = lens.project([0.3, -0.2, 1.0]).unwrap();
/// let ray = lens.ray(pixel).unwrap();
/// assert!((ray[0] - 0.3).abs() < 1e-10 && (ray[1] + 0.2).abs() < 1e-10);
/// // Behind the camera there is no picture.
/// assert!(lens.project([0.3, -0.2, -1.0]).is_none());
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    pub(super) focal: [f64; 2],
    pub(super) centre: [f64; 2],
    pub(super) distortion: Distortion,
    plain: bool,
}

impl Lens {
    /// A camera of these focal lengths and this principal point, x and y, in pixels.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option) if a number is not finite or a focal length not above 0.
    pub fn new(focal: [f64; 2], centre: [f64; 2], distortion: Distortion) -> Result<Self> {
        for value in focal {
            let fits = value > 0.0 && value.is_finite();
            expect_option(fits, "focal", value, "a focal length above 0, in pixels")?;
        }
        let coefficients: &[f64] = match &distortion {
            Distortion::Brown(k) => k,
            Distortion::Fisheye(k) => k,
        };
        for value in centre.iter().chain(coefficients) {
            expect_option(value.is_finite(), "camera", value, "finite numbers")?;
        }
        let plain = matches!(distortion, Distortion::Brown(k) if k.iter().all(|k| *k == 0.0));
        Ok(Self {
            focal,
            centre,
            distortion,
            plain,
        })
    }

    /// The pixel that shows what lies along `ray`; none for what lies behind.
    #[must_use]
    pub fn project(&self, ray: [f64; 3]) -> Option<[f64; 2]> {
        if ray[2] <= 1e-9 {
            return None;
        }
        let (x, y) = (ray[0] / ray[2], ray[1] / ray[2]);
        let [x, y] = if self.plain {
            [x, y]
        } else {
            let (at, slopes) = self.bend(x, y);
            // Beyond the fold of the polynomial the picture would come back.
            if slopes[0] * slopes[3] - slopes[1] * slopes[2] <= 0.0 {
                return None;
            }
            at
        };
        Some([
            self.focal[0] * x + self.centre[0],
            self.focal[1] * y + self.centre[1],
        ])
    }

    /// The ray (x, y, 1) of a pixel; none where the model has no valid answer.
    #[must_use]
    pub fn ray(&self, pixel: [f64; 2]) -> Option<[f64; 3]> {
        let goal: [f64; 2] = std::array::from_fn(|k| (pixel[k] - self.centre[k]) / self.focal[k]);
        if self.plain {
            return Some([goal[0], goal[1], 1.0]);
        }
        let mut at = goal;
        for _ in 0..ITERATIONS {
            let (seen, [a, b, c, d]) = self.bend(at[0], at[1]);
            let off = [seen[0] - goal[0], seen[1] - goal[1]];
            let determinant = a * d - b * c;
            if determinant.is_nan() || determinant <= 0.0 {
                // Over the fold: half-way back to the axis.
                at = at.map(|value| 0.5 * value);
                continue;
            }
            if off[0].abs().max(off[1].abs()) < ENOUGH {
                return Some([at[0], at[1], 1.0]);
            }
            at = [
                at[0] - (d * off[0] - b * off[1]) / determinant,
                at[1] - (a * off[1] - c * off[0]) / determinant,
            ];
        }
        None
    }

    /// Distorted coordinates, and their slopes: x by x, x by y, y by x, y by y.
    fn bend(&self, x: f64, y: f64) -> ([f64; 2], [f64; 4]) {
        match &self.distortion {
            Distortion::Brown(k) => brown(k, x, y),
            Distortion::Fisheye(k) => fisheye(k, x, y),
        }
    }

    /// The same camera with one of its numbers changed: 0 to 3 are the focal lengths and the principal point, then the
    /// coefficients follow.
    pub(super) fn varied(&self, number: usize, by: f64) -> Self {
        let mut lens = *self;
        match number {
            0 | 1 => lens.focal[number] += by,
            2 | 3 => lens.centre[number - 2] += by,
            _ => match &mut lens.distortion {
                Distortion::Brown(k) => k[number - 4] += by,
                Distortion::Fisheye(k) => k[number - 4] += by,
            },
        }
        lens.plain = lens.plain && number < 4;
        lens
    }

    /// How many numbers [`Lens::varied`] knows.
    pub(super) fn numbers(&self) -> usize {
        match self.distortion {
            Distortion::Brown(_) => 16,
            Distortion::Fisheye(_) => 8,
        }
    }
}

fn brown(k: &[f64; 12], x: f64, y: f64) -> ([f64; 2], [f64; 4]) {
    let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] = *k;
    let r2 = x * x + y * y;
    let low = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
    let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / low;
    let slope = (k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3))
        - radial * (k4 + r2 * (2.0 * k5 + r2 * (3.0 * k6))))
        / low;
    let cross = 2.0 * (x * y * slope + p1 * x + p2 * y);
    let [prism_x, prism_y] = [2.0 * (s1 + 2.0 * s2 * r2), 2.0 * (s3 + 2.0 * s4 * r2)];
    (
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + s2 * r2),
            y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y) + r2 * (s3 + s4 * r2),
        ],
        [
            radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + x * prism_x,
            cross + y * prism_x,
            cross + x * prism_y,
            radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + y * prism_y,
        ],
    )
}

fn fisheye(k: &[f64; 4], x: f64, y: f64) -> ([f64; 2], [f64; 4]) {
    let r = x.hypot(y);
    if r < 1e-9 {
        return ([x, y], [1.0, 0.0, 0.0, 1.0]);
    }
    let theta = r.atan();
    let t2 = theta * theta;
    let bent = theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
    let slope = (1.0
        + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * (9.0 * k[3])))))
        / (1.0 + r * r);
    let factor = bent / r;
    // Along the radius the derivative is that of the bent angle, across it the factor itself.
    let across = slope - factor;
    let (ux, uy) = (x / r, y / r);
    let cross = across * ux * uy;
    (
        [x * factor, y * factor],
        [
            factor + across * ux * ux,
            cross,
            cross,
            factor + across * uy * uy,
        ],
    )
}
