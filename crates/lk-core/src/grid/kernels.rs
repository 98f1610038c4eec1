//! The work on the pixels of a window: samples of `next`, normal equations, and what pulls at the solution.
//!
//! `docs/explanation/algorithms.md`, section "Grid: displacement_grid".

use super::shape::{PRODUCTS, TERMS, monomials};
use super::window::{Pattern, Window};
use crate::simd::{Floats, Kernel, LANES, Simd};

/// Columns of the light: the template, and 1, x, y of an offset that may slope.
pub(super) const LIGHT: usize = 4;

/// Monomials of degree `D + 1`, which the products of shape and light reach.
const CROSS: usize = monomials(3);

/// Sums over a window of what the normal equations are made of. A slope's product is with each monomial.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sums {
    /// Slopes with each other: xx, xy, yy.
    pub(super) slopes: [[f64; PRODUCTS]; 3],
    /// Slopes with the template.
    pub(super) template: [[f64; TERMS]; 2],
    /// Slopes alone.
    pub(super) slope: [[f64; CROSS]; 2],
    /// The template with itself.
    pub(super) square: f64,
    /// The template with 1, x, y.
    pub(super) level: [f64; 3],
    /// The monomials alone.
    pub(super) weight: [f64; TERMS],
}

/// The monomials of (x, y) up to degree `D`; the others are 0.
#[inline(always)]
fn powers<S: Simd, const D: usize>(simd: S, x: S::F, y: S::F) -> [S::F; PRODUCTS] {
    let mut found = [simd.splat(0.0); PRODUCTS];
    found[0] = simd.splat(1.0);
    let (mut degree, mut before) = (1, 0);
    while degree <= D {
        let first = before + degree;
        let mut at = 0;
        while at < degree {
            found[first + at] = found[before + at] * x;
            at += 1;
        }
        found[first + degree] = found[before + degree - 1] * y;
        before = first;
        degree += 1;
    }
    found
}

/// The sum over lanes, in a fixed order.
#[inline(always)]
fn total<F: Floats>(lanes: F) -> f64 {
    let mut values = [0.0; LANES];
    lanes.put(&mut values);
    let mut four = [0.0f64; 4];
    for (at, value) in values.into_iter().enumerate() {
        four[at % 4] += f64::from(value);
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

/// [`total`] of each.
#[inline(always)]
fn totals<F: Floats, const N: usize>(lanes: &[F; N]) -> [f64; N] {
    let mut sums = [0.0; N];
    for (sum, lanes) in sums.iter_mut().zip(lanes) {
        *sum = total(*lanes);
    }
    sums
}

/// [`totals`] of each.
#[inline(always)]
fn table<F: Floats, const N: usize, const M: usize>(lanes: &[[F; N]; M]) -> [[f64; N]; M] {
    let mut sums = [[0.0; N]; M];
    for (sums, lanes) in sums.iter_mut().zip(lanes) {
        *sums = totals(lanes);
    }
    sums
}

/// [`Sums`] for a shape of degree `D`.
pub(super) struct Normal<'a, const D: usize> {
    pub(super) pattern: &'a Pattern,
    pub(super) window: &'a Window,
}

impl<const D: usize> Kernel for Normal<'_, D> {
    type Output = Sums;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Sums {
        let (products, cross, terms) = (monomials(2 * D), monomials(D + 1), monomials(D));
        let zero = simd.splat(0.0);
        let mut slopes = [[zero; PRODUCTS]; 3];
        let mut template = [[zero; TERMS]; 2];
        let mut slope = [[zero; CROSS]; 2];
        let (mut square, mut level, mut weights) = (zero, [zero; 3], [zero; TERMS]);
        let Window {
            template: values,
            slope_x,
            slope_y,
            weight,
            ..
        } = self.window;
        let mut at = 0;
        while at < self.pattern.len() {
            let (x, y) = (
                simd.load(&self.pattern.x, at),
                simd.load(&self.pattern.y, at),
            );
            let place = if D == 2 {
                powers::<S, 4>(simd, x, y)
            } else {
                powers::<S, 2>(simd, x, y)
            };
            let (w, t) = (simd.load(weight, at), simd.load(values, at));
            let (gx, gy) = (simd.load(slope_x, at), simd.load(slope_y, at));
            let (wx, wy) = (w * gx, w * gy);
            let pairs = [wx * gx, wx * gy, wy * gy];
            for (sums, pair) in slopes.iter_mut().zip(pairs) {
                for (sum, place) in sums.iter_mut().zip(place).take(products) {
                    *sum = *sum + pair * place;
                }
            }
            for (sums, slope) in slope.iter_mut().zip([wx, wy]) {
                for (sum, place) in sums.iter_mut().zip(place).take(cross) {
                    *sum = *sum + slope * place;
                }
            }
            let wt = w * t;
            for (sums, slope) in template.iter_mut().zip([wx * t, wy * t]) {
                for (sum, place) in sums.iter_mut().zip(place).take(terms) {
                    *sum = *sum + slope * place;
                }
            }
            square = square + wt * t;
            for (sum, place) in level.iter_mut().zip(place) {
                *sum = *sum + wt * place;
            }
            for (sum, place) in weights.iter_mut().zip(place) {
                *sum = *sum + w * place;
            }
            at += LANES;
        }
        Sums {
            slopes: table(&slopes),
            template: table(&template),
            slope: table(&slope),
            square: total(square),
            level: totals(&level),
            weight: totals(&weights),
        }
    }
}

/// Sample `next` under a warp of degree `D` (1 at least), and write what light does not explain into `residual`.
pub(super) struct Sample<'a, const D: usize> {
    pub(super) pattern: &'a Pattern,
    pub(super) template: &'a [f32],
    pub(super) residual: &'a mut [f32],
    /// Spline coefficients from the first that may be read on, and how many a row has.
    pub(super) coefficients: &'a [f32],
    pub(super) stride: usize,
    /// The factors of each monomial in the place of the first tap, counted from the first coefficient.
    pub(super) place: [[f32; TERMS]; 2],
    /// The greatest places that a tap may have.
    pub(super) limit: [f32; 2],
    pub(super) light: [f32; LIGHT],
}

impl<const D: usize> Kernel for Sample<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let terms = monomials(D);
        let zero = simd.splat(0.0);
        let factors = self
            .place
            .map(|factors| factors.map(|factor| simd.splat(factor)));
        let limit = self.limit.map(|limit| simd.splat(limit));
        let light = self.light.map(|light| simd.splat(light));
        let mut at = 0;
        while at < self.pattern.len() {
            let (x, y) = (
                simd.load(&self.pattern.x, at),
                simd.load(&self.pattern.y, at),
            );
            let powers = powers::<S, D>(simd, x, y);
            let mut place = [zero; 2];
            for axis in 0..2 {
                let mut sum = factors[axis][0];
                for (factor, power) in factors[axis].iter().zip(powers).take(terms).skip(1) {
                    sum = sum + *factor * power;
                }
                // A NaN on the left gives the right side.
                place[axis] = sum.max(zero).min(limit[axis]);
            }
            let first = place.map(|place| place.trunc());
            let (across, down) = (
                weights(simd, place[0] - first[0]),
                weights(simd, place[1] - first[1]),
            );
            let third = first[0] + simd.splat(2.0);
            let mut value = zero;
            for (row, down) in down.into_iter().enumerate() {
                let row = first[1] + simd.splat(row as f32);
                let (a, b) = simd.pairs(self.coefficients, self.stride, row, first[0]);
                let (c, d) = simd.pairs(self.coefficients, self.stride, row, third);
                let sum = (across[0] * a + across[1] * b) + (across[2] * c + across[3] * d);
                value = value + down * sum;
            }
            let t = simd.load(self.template, at);
            let lit = (light[0] * t + light[1]) + (light[2] * x + light[3] * y);
            let to = self.residual[at..].first_chunk_mut::<LANES>();
            if let Some(to) = to {
                (value - lit).put(to);
            }
            at += LANES;
        }
    }
}

/// The weights of four taps of the cubic B-spline, `t` of the way from the second to the third.
#[inline(always)]
fn weights<S: Simd>(simd: S, t: S::F) -> [S::F; 4] {
    let (one, sixth) = (simd.splat(1.0), simd.splat(1.0 / 6.0));
    let rest = one - t;
    let (t2, rest2) = (t * t, rest * rest);
    let (far, near) = (t2 * t * sixth, rest2 * rest * sixth);
    let second = simd.splat(2.0 / 3.0) - t2 + simd.splat(0.5) * (t2 * t);
    [near, second, one - near - second - far, far]
}

/// Sums over a window of slopes and light times what is left.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pull {
    pub(super) slopes: [[f64; TERMS]; 2],
    pub(super) light: [f64; LIGHT],
    /// The square of what is left.
    pub(super) square: f64,
}

/// [`Pull`] for a shape of degree `D`.
pub(super) struct Pulling<'a, const D: usize> {
    pub(super) pattern: &'a Pattern,
    pub(super) window: &'a Window,
}

impl<const D: usize> Kernel for Pulling<'_, D> {
    type Output = Pull;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Pull {
        let zero = simd.splat(0.0);
        let (mut slopes, mut light, mut square) = ([[zero; TERMS]; 2], [zero; LIGHT], zero);
        let mut at = 0;
        while at < self.pattern.len() {
            let part = PullOf::<S, D>::new(simd, self.pattern, self.window, at);
            for (sums, slope) in slopes.iter_mut().zip(part.slopes) {
                for (sum, place) in sums.iter_mut().zip(part.place).take(monomials(D)) {
                    *sum = *sum + slope * place;
                }
            }
            for (sum, part) in light.iter_mut().zip(part.light) {
                *sum = *sum + part;
            }
            square = square + part.square;
            at += LANES;
        }
        Pull {
            slopes: table(&slopes),
            light: totals(&light),
            square: total(square),
        }
    }
}

/// The pull of sixteen pixels.
struct PullOf<S: Simd, const D: usize> {
    place: [S::F; PRODUCTS],
    slopes: [S::F; 2],
    light: [S::F; LIGHT],
    square: S::F,
}

impl<S: Simd, const D: usize> PullOf<S, D> {
    #[inline(always)]
    fn new(simd: S, pattern: &Pattern, window: &Window, at: usize) -> Self {
        let (x, y) = (simd.load(&pattern.x, at), simd.load(&pattern.y, at));
        let left = simd.load(&window.residual, at);
        let pull = simd.load(&window.weight, at) * left;
        let (gx, gy) = (
            simd.load(&window.slope_x, at),
            simd.load(&window.slope_y, at),
        );
        Self {
            place: powers::<S, D>(simd, x, y),
            slopes: [pull * gx, pull * gy],
            light: [
                pull * simd.load(&window.template, at),
                pull,
                pull * x,
                pull * y,
            ],
            square: pull * left,
        }
    }
}

/// The pull of each tile, as [`Pull`] has it: u and v of each monomial, then light.
pub(super) struct TilePulls<'a, const D: usize> {
    pub(super) pattern: &'a Pattern,
    pub(super) window: &'a Window,
    pub(super) pulls: &'a mut [[f64; 2 * TERMS + LIGHT]],
}

impl<const D: usize> Kernel for TilePulls<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let terms = monomials(D);
        for (tile, to) in self.pulls.iter_mut().enumerate() {
            let part = PullOf::<S, D>::new(simd, self.pattern, self.window, tile * LANES);
            for axis in 0..2 {
                for term in 0..terms {
                    to[axis * terms + term] = total(part.slopes[axis] * part.place[term]);
                }
            }
            for (at, light) in part.light.into_iter().enumerate() {
                to[2 * terms + at] = total(light);
            }
        }
    }
}
