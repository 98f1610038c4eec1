//! Rows of the comparison of a picture with the background.

use super::slopes::gradient;
use crate::parallel::{RowsMut, SplitRows};
use crate::simd::{Kernel, Simd};

/// A sample is near within so many standard deviations and this share of the gradient, in pixels: of a camera at rest, of one
/// that moves; within these limits, in grey levels.
const NEAR: f32 = 3.0;
const GRADIENT_PX: [f32; 2] = [0.1, 0.45];
const RADII: [f32; 2] = [3.0, 45.0];
/// Half of that is a weak difference.
const WEAK: f32 = 0.5;
/// The variance that a misregistration of the square root of so many pixels brings, and the most squared deviations of one pixel.
const REGISTRATION_PX2: [f32; 2] = [0.02, 0.07];
const MOST: f32 = 5.0;
/// Mean squared deviations over 5 x 5 pixels from which on something differs; beside that, over 5 x 5 and 3 x 3.
const SURE: f32 = 2.6;
const BESIDE: [f32; 2] = [2.3, 2.6];
/// Frames after which the deviation of a pixel's samples is known.
const TOLD: u8 = 8;

/// No weak difference is nearer than this to the background, in grey levels.
pub(super) fn least_apart(noise: f32) -> f32 {
    WEAK * (NEAR * (1.1 * noise)).clamp(RADII[0], RADII[1])
}

pub(super) struct Pixels<'a> {
    pub(super) strong: RowsMut<'a, u8>,
    pub(super) weak: RowsMut<'a, u8>,
    pub(super) squares: RowsMut<'a, f32>,
}

impl SplitRows for Pixels<'_> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (strong, weak) = (self.strong.split_at_row(row), self.weak.split_at_row(row));
        let squares = self.squares.split_at_row(row);
        (
            Self {
                strong: strong.0,
                weak: weak.0,
                squares: squares.0,
            },
            Self {
                strong: strong.1,
                weak: weak.1,
                squares: squares.1,
            },
        )
    }
}

pub(super) struct Masks<'a>(pub(super) RowsMut<'a, u8>, pub(super) RowsMut<'a, u8>);

impl SplitRows for Masks<'_> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (a, b) = (self.0.split_at_row(row), self.1.split_at_row(row));
        (Self(a.0, b.0), Self(a.1, b.1))
    }
}

pub(super) struct Row<'a> {
    pub(super) around: [&'a [f32]; 3],
    pub(super) slopes: [&'a mut [f32]; 2],
    pub(super) picture: &'a [f32],
    pub(super) deviation: &'a [f32],
    pub(super) age: &'a [u8],
    pub(super) both: &'a [u8],
    pub(super) apart: &'a [f32],
    pub(super) noise: f32,
    pub(super) moves: bool,
    pub(super) strong: &'a mut [u8],
    pub(super) weak: &'a mut [u8],
    pub(super) squares: &'a mut [f32],
}

impl Kernel for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [gx, gy] = self.slopes;
        gradient(self.around, gx, gy);
        let which = usize::from(self.moves);
        let (reach, registration) = (GRADIENT_PX[which], REGISTRATION_PX2[which]);
        let noise = self.noise;
        let width = self.picture.len();
        let (gx, gy, middle) = (&gx[..width], &gy[..width], &self.around[1][..width]);
        let (deviation, age, both, apart) = (
            &self.deviation[..width],
            &self.age[..width],
            &self.both[..width],
            &self.apart[..width],
        );
        let (strong, weak, squares) = (
            &mut self.strong[..width],
            &mut self.weak[..width],
            &mut self.squares[..width],
        );
        for x in 0..width {
            let slope2 = gx[x] * gx[x] + gy[x] * gy[x];
            let own = if age[x] > TOLD { deviation[x] } else { noise };
            let wide = if own > 1.1 * noise { own } else { 1.1 * noise };
            let radius = NEAR * wide + reach * slope2.sqrt();
            let radius = if radius > RADII[0] { radius } else { RADII[0] };
            let radius = if radius < RADII[1] { radius } else { RADII[1] };
            strong[x] = both[x] & u8::from(apart[x] > radius);
            weak[x] = both[x] & u8::from(apart[x] > WEAK * radius);
            let variance = if own * own > noise * noise {
                own * own
            } else {
                noise * noise
            };
            let few = if age[x] < 8 { f32::from(age[x]) } else { 8.0 };
            let few = if few > 1.0 { few } else { 1.0 };
            let d = self.picture[x] - middle[x];
            let square = d * d / (variance * (1.0 + 0.5 / few) + registration * slope2);
            let square = if square < MOST { square } else { MOST };
            squares[x] = square * f32::from(both[x]);
        }
    }
}

pub(super) struct Thresholds<'a> {
    pub(super) means: &'a [f32],
    pub(super) three: &'a [f32],
    pub(super) both: &'a [u8],
    pub(super) seeds: &'a mut [u8],
    pub(super) beside: &'a mut [u8],
}

impl Kernel for Thresholds<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let from = self.means.iter().zip(self.three).zip(self.both);
        for ((seed, beside), ((five, three), both)) in
            self.seeds.iter_mut().zip(self.beside.iter_mut()).zip(from)
        {
            *seed = both & u8::from(*five > SURE) & u8::from(*three > BESIDE[1]);
            *beside = both & u8::from(*five > BESIDE[0]) & u8::from(*three > BESIDE[1]);
        }
    }
}
