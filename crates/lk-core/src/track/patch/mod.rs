//! The window of one point: its template in `prev`, and one comparison of it with `next`.
//!
//! A window is sampled at one sub-pixel offset for all its pixels, so sampling is a separable filter with constant
//! weights and needs no gathers. Rows are padded to whole lanes; what stands in the padding has no weight.
//!
//! The lighting model costs no pass over the pixels: what it explains is taken out of the sums, in
//! [`super::normal::Normal`].

mod compare;
mod differentiate;
mod joint;
mod light;
mod masked;
mod outside;
mod region;
mod sampling;
mod sums;
mod template;

use crate::error::Result;
use crate::options::expect_option;
use crate::simd::{EIGHT, Eight, Packed};

pub(crate) use compare::{AbsoluteDifference, Compare};
pub(crate) use joint::Place;
pub(crate) use light::Light;
pub(crate) use masked::SumAgain;
pub(crate) use region::BorderScratch;
pub(crate) use sampling::Sampling;
pub(crate) use sums::Sums;
pub(crate) use template::{BuildTemplate, Template};

/// The smallest window, in pixels a side: less has no gradient to speak of.
const MIN_WINDOW: usize = 3;

/// The largest window, in pixels a side.
const MAX_WINDOW: usize = 63;

/// Pixels around the window that the finest level takes in too.
const RIM: usize = 1;

/// The longest side of what is compared.
pub(crate) const MAX_SIDE: usize = MAX_WINDOW + 2 * RIM;

/// The size of a window, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) width: usize,
    pub(crate) height: usize,
}

/// 21 pixels a side, as OpenCV's.
impl Default for Window {
    fn default() -> Self {
        Self {
            width: 21,
            height: 21,
        }
    }
}

impl Window {
    /// Hold the option `name` to the sizes that a window may have.
    ///
    /// # Errors
    ///
    /// [`Error::Option`](crate::Error::Option).
    pub(crate) fn expect_allowed(self, name: &'static str) -> Result<()> {
        let sides = MIN_WINDOW..=MAX_WINDOW;
        expect_option(
            sides.contains(&self.width) && sides.contains(&self.height),
            name,
            format_args!("({}, {})", self.width, self.height),
            format_args!("{MIN_WINDOW} to {MAX_WINDOW} pixels a side"),
        )
    }

    /// From the centre to the first pixel, along x and y.
    #[inline(always)]
    pub(crate) fn half(self) -> [f32; 2] {
        [
            (self.width as f32 - 1.0) * 0.5,
            (self.height as f32 - 1.0) * 0.5,
        ]
    }

    #[inline(always)]
    pub(crate) fn blocks(self) -> usize {
        self.width.div_ceil(EIGHT)
    }

    /// With the pixels around it that its gradients look at anyway.
    pub(crate) fn with_rim(self) -> Self {
        Self {
            width: self.width + 2 * RIM,
            height: self.height + 2 * RIM,
        }
    }

    /// Pixels.
    #[inline(always)]
    pub(crate) fn area(self) -> f64 {
        (self.width * self.height) as f64
    }

    /// Sums over the window of x^2 and y^2, from its centre.
    #[inline(always)]
    pub(crate) fn moments(self) -> [f64; 2] {
        let (width, height) = (self.width as f64, self.height as f64);
        let twelfth = width * height / 12.0;
        [
            twelfth * (width * width - 1.0),
            twelfth * (height * height - 1.0),
        ]
    }

    /// The sum of values times their y coordinates from the window's centre, where their sum is `total` and the sum of
    /// their sums down to each row is `running`: a value counts there as often as there are rows from its own on.
    #[inline(always)]
    pub(super) fn with_y<L: Eight>(self, [total, running]: [L; 2]) -> L {
        total * L::splat(self.height as f32 - self.half()[1]) - running
    }

    /// The x coordinates of a block of lanes, from the window's centre.
    #[inline(always)]
    pub(crate) fn block_x<L: Eight>(self, block: usize) -> L {
        L::splat((block * EIGHT) as f32 - self.half()[0]) + L::unpack(&Packed::STEPS)
    }
}
