//! Rows of what the shade of a thing explains.

use super::background::OLD;
use super::slopes::gradient;
use crate::simd::{Kernel, Simd};

/// A shadow leaves this share of the light; gradients in it are those of the background but for this many of the noise's.
const SHADES: [f32; 2] = [0.3, 0.97];
/// The edge of a shade is between it and the background but for so many of the noise's deviations.
const PENUMBRA: f32 = 2.5;
/// The texture of the background tells a shade where it is so many times what noise makes.
const TEXTURED: f32 = 2.0;
/// The inside of a shade keeps a share of the light with at most this standard deviation.
const UNEVEN: f32 = 0.04;
/// Texture in a shade is the background's but for this share of its squares: the light is not quite alike all around.
const UNLIKE: f32 = 0.08;

pub(super) struct Ratio<'a> {
    pub(super) a: &'a [f32],
    pub(super) b: &'a [f32],
    pub(super) to: &'a mut [f32],
}

impl Kernel for Ratio<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        for ((to, a), b) in self.to.iter_mut().zip(self.a).zip(self.b) {
            *to = a / if *b > 1.0 { *b } else { 1.0 };
        }
    }
}

pub(super) struct Unlike<'a> {
    pub(super) picture: [&'a [f32]; 3],
    pub(super) background: [&'a [f32]; 3],
    pub(super) ratio: &'a [f32],
    pub(super) to: [&'a mut [f32]; 4],
}

impl Kernel for Unlike<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [ex, ey, square, texture] = self.to;
        // Down first: its memory is free afterwards.
        gradient(self.picture, ex, ey);
        let width = ex.len();
        let [above, row, below] = self.background;
        let (ex, ey, square) = (&mut ex[..width], &mut ey[..width], &mut square[..width]);
        let (above, below, ratio) = (&above[..width], &below[..width], &self.ratio[..width]);
        let texture = &mut texture[..width];
        for x in 0..width {
            let slope = ratio[x] * 0.5 * (below[x] - above[x]);
            ey[x] -= slope;
            texture[x] = slope * slope;
        }
        if width > 1 {
            ex[0] -= ratio[0] * 0.5 * (row[1] - row[0]);
            ex[width - 1] -= ratio[width - 1] * 0.5 * (row[width - 1] - row[width - 2]);
            let middle = ex[1..width - 1].iter_mut().zip(&ratio[1..]);
            let middle = middle.zip(&mut texture[1..width - 1]);
            for (((ex, ratio), texture), (left, right)) in middle.zip(row.iter().zip(&row[2..])) {
                let slope = ratio * 0.5 * (right - left);
                *ex -= slope;
                *texture += slope * slope;
            }
        }
        for x in 0..width {
            square[x] = ex[x] * ex[x] + ey[x] * ey[x];
        }
    }
}

pub(super) struct Penumbra<'a> {
    /// Of the inside of a shade, of its ratio there and of that squared.
    pub(super) means: [&'a [f32]; 3],
    pub(super) differs: &'a [u8],
    pub(super) background: &'a [f32],
    pub(super) picture: &'a [f32],
    pub(super) noise: f32,
    pub(super) to: &'a mut [u8],
}

impl Kernel for Penumbra<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [weights, shares, squares] = self.means;
        let pictures = self.background.iter().zip(self.picture).zip(self.differs);
        let means = weights.iter().zip(shares.iter().zip(squares));
        let slack = PENUMBRA * self.noise;
        for ((to, (weight, (share, square))), ((background, picture), differs)) in
            self.to.iter_mut().zip(means).zip(pictures)
        {
            let there = *weight > 1e-6;
            let weight = if there { *weight } else { 1.0 };
            let ratio = share / weight;
            let alike = square / weight - ratio * ratio < UNEVEN * UNEVEN;
            let darkest = background * ratio - slack;
            let within = *picture > darkest && *picture < background + slack;
            *to |= differs & u8::from(there & alike & within);
        }
    }
}

pub(super) struct Shade<'a> {
    pub(super) means: [&'a [f32]; 4],
    pub(super) ratio: &'a [f32],
    pub(super) noise: f32,
    /// Which shares of the light a shade leaves where no texture tells it.
    pub(super) learned: [f32; 2],
    /// 1 where these were learned.
    pub(super) believed: u8,
    /// Frames in which the background was seen.
    pub(super) age: &'a [u8],
    /// Where it is a shade, and where the background's texture says so.
    pub(super) to: [&'a mut [u8]; 2],
}

impl Kernel for Shade<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [ex, ey, square, texture] = self.means;
        let means = ex.iter().zip(ey).zip(square.iter().zip(texture));
        let [shade, told] = self.to;
        let [low, high] = self.learned;
        let to = shade
            .iter_mut()
            .zip(told.iter_mut())
            .zip(self.ratio.iter().zip(self.age));
        for (((shade, told), (ratio, age)), ((ex, ey), (square, texture))) in to.zip(means) {
            // A soft edge is a gradient that is alike all around.
            let unlike = square - ex * ex - ey * ey;
            let dark = u8::from(*ratio > SHADES[0]) & u8::from(*ratio < SHADES[1]);
            let made = self.noise * (1.0 + ratio * ratio);
            let alike = u8::from(unlike < made + UNLIKE * texture);
            let textured = u8::from(*texture > TEXTURED * made);
            *told = dark & alike & textured;
            let learned = u8::from(*ratio > low) & u8::from(*ratio < high);
            // What was only seen in the shade comes into the light.
            let back = 1.0 / *ratio;
            let bright = u8::from(back > SHADES[0]) & u8::from(back < SHADES[1]);
            let inside = u8::from(back > low) & u8::from(back < high) & self.believed;
            let young = u8::from(*age < OLD);
            *shade =
                alike & ((dark & (textured | learned)) | (bright & young & (textured | inside)));
        }
    }
}
