//! The kernels beside plain f64.

use proptest::prelude::*;

use crate::grid::kernels::{LIGHT, Normal, Pulling, Sample, TilePulls};
use crate::grid::shape::{EXPONENTS, TERMS, monomials};
use crate::grid::window::{Pattern, Window};
use crate::simd::{LANES, SimdLevel, dispatch};

/// The monomial `at` of a place.
fn power(at: usize, x: f64, y: f64) -> f64 {
    let [a, b] = EXPONENTS[at];
    x.powi(a as i32) * y.powi(b as i32)
}

/// Random values from a seed.
fn values(count: usize, seed: u32, low: f32, high: f32) -> Vec<f32> {
    let mut state = seed | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        low + (high - low) * (state % 10_007) as f32 / 10_006.0
    };
    (0..count).map(|_| next()).collect()
}

fn window(pattern: &Pattern, seed: u32) -> Window {
    let of = |at: u32, low, high| values(pattern.len(), seed.wrapping_add(at * 7919), low, high);
    let mut window = Window::default();
    window.template = of(1, -90.0, 120.0);
    window.slope_x = of(2, -40.0, 40.0);
    window.slope_y = of(3, -40.0, 40.0);
    window.weight = of(4, 0.0, 1.0);
    window.residual = of(5, -9.0, 9.0);
    window
}

/// The sum over the window of `f` of (x, y, weight, slopes, template, residual), and of its size.
fn sum(pattern: &Pattern, window: &Window, f: impl Fn([f64; 7]) -> f64) -> (f64, f64) {
    let mut sums = (0.0, 0.0);
    for at in 0..pattern.len() {
        let lanes = [
            &pattern.x,
            &pattern.y,
            &window.weight,
            &window.slope_x,
            &window.slope_y,
            &window.template,
            &window.residual,
        ];
        let value = f(lanes.map(|lane| f64::from(lane[at])));
        sums = (sums.0 + value, sums.1 + value.abs());
    }
    sums
}

/// Whether `got` is the sum `want` to the rounding of f32.
fn close(got: f64, (want, size): (f64, f64)) -> bool {
    (got - want).abs() <= 2e-5 * size + 1e-6
}

fn hold_normal<const D: usize>(pattern: &Pattern, window: &Window) {
    let of = |level| dispatch(level, Normal::<D> { pattern, window });
    let got = of(SimdLevel::Baseline);
    for level in SimdLevel::available() {
        assert_eq!(of(level), got, "{level:?}");
    }
    for at in 0..monomials(2 * D) {
        let pairs = [(3, 3), (3, 4), (4, 4)];
        for (got, (a, b)) in got.slopes.iter().zip(pairs) {
            let want = sum(pattern, window, |v| {
                v[2] * v[a] * v[b] * power(at, v[0], v[1])
            });
            assert!(close(got[at], want), "slopes {D} {at}");
        }
    }
    for axis in 0..2 {
        for at in 0..monomials(D + 1) {
            let want = sum(pattern, window, |v| {
                v[2] * v[3 + axis] * power(at, v[0], v[1])
            });
            assert!(close(got.slope[axis][at], want), "slope {D} {at}");
        }
        for at in 0..monomials(D) {
            let of = |v: [f64; 7]| v[2] * v[3 + axis] * v[5] * power(at, v[0], v[1]);
            assert!(
                close(got.template[axis][at], sum(pattern, window, of)),
                "template {D} {at}"
            );
        }
    }
    assert!(close(
        got.square,
        sum(pattern, window, |v| v[2] * v[5] * v[5])
    ));
    for at in 0..3 {
        let want = sum(pattern, window, |v| v[2] * v[5] * power(at, v[0], v[1]));
        assert!(close(got.level[at], want));
    }
    for at in 0..TERMS {
        let want = sum(pattern, window, |v| v[2] * power(at, v[0], v[1]));
        assert!(close(got.weight[at], want));
    }
}

fn hold_pulls<const D: usize>(pattern: &Pattern, window: &Window) {
    let of = |level| dispatch(level, Pulling::<D> { pattern, window });
    let tiles = |level| {
        let mut pulls = vec![[0.0; 2 * TERMS + LIGHT]; pattern.len() / LANES];
        dispatch(
            level,
            TilePulls::<D> {
                pattern,
                window,
                pulls: &mut pulls,
            },
        );
        pulls
    };
    let (got, parts) = (of(SimdLevel::Baseline), tiles(SimdLevel::Baseline));
    for level in SimdLevel::available() {
        assert_eq!(of(level), got, "{level:?}");
        assert_eq!(tiles(level), parts, "{level:?}");
    }
    let terms = monomials(D);
    let whole = |at: usize| parts.iter().map(|part| part[at]).sum::<f64>();
    for axis in 0..2 {
        for at in 0..terms {
            let of = |v: [f64; 7]| v[2] * v[3 + axis] * v[6] * power(at, v[0], v[1]);
            let want = sum(pattern, window, of);
            assert!(close(got.slopes[axis][at], want));
            assert!(close(whole(axis * terms + at), want));
        }
    }
    let lights: [fn([f64; 7]) -> f64; LIGHT] = [|v| v[5], |_| 1.0, |v| v[0], |v| v[1]];
    for (at, light) in lights.into_iter().enumerate() {
        let want = sum(pattern, window, |v| v[2] * v[6] * light(v));
        assert!(close(got.light[at], want));
        assert!(close(whole(2 * terms + at), want));
    }
    assert!(close(
        got.square,
        sum(pattern, window, |v| v[2] * v[6] * v[6])
    ));
}

/// The cubic B-spline.
fn spline(x: f64) -> f64 {
    match x.abs() {
        a if a < 1.0 => 2.0 / 3.0 - a * a + a * a * a / 2.0,
        a if a < 2.0 => (2.0 - a).powi(3) / 6.0,
        _ => 0.0,
    }
}

fn hold_sample<const D: usize>(pattern: &Pattern, window: &Window, warp: &[f32], seed: u32) {
    const STRIDE: usize = 70;
    let coefficients = values(STRIDE * STRIDE, seed ^ 0x5555, -130.0, 130.0);
    let mut place = [[0.0f32; TERMS]; 2];
    for axis in 0..2 {
        place[axis][..monomials(D)].copy_from_slice(&warp[axis * TERMS..][..monomials(D)]);
        place[axis][0] += 30.0;
        place[axis][1 + axis] += pattern.half as f32;
    }
    let light = [0.9, 3.0, -1.5, 0.7];
    let limit = [(STRIDE - 4) as f32; 2];
    let of = |level| {
        let mut residual = vec![0.0; pattern.len()];
        let kernel = Sample::<D> {
            pattern,
            template: &window.template,
            residual: &mut residual,
            coefficients: &coefficients,
            stride: STRIDE,
            place,
            limit,
            light,
        };
        dispatch(level, kernel);
        residual
    };
    let got = of(SimdLevel::Baseline);
    for level in SimdLevel::available() {
        assert_eq!(of(level), got, "{level:?}");
    }
    for (at, got) in got.into_iter().enumerate() {
        let (x, y) = (f64::from(pattern.x[at]), f64::from(pattern.y[at]));
        let at_axis = |axis: usize| {
            let sum: f64 = (0..monomials(D))
                .map(|k| f64::from(place[axis][k]) * power(k, x, y))
                .sum();
            sum.clamp(0.0, f64::from(limit[axis]))
        };
        let (sx, sy) = (at_axis(0), at_axis(1));
        let mut value = 0.0;
        for row in 0..4 {
            for column in 0..4 {
                let (cx, cy) = (sx.floor() as usize + column, sy.floor() as usize + row);
                // The first tap stands one before the place.
                let weight = spline(sx + 1.0 - cx as f64) * spline(sy + 1.0 - cy as f64);
                value += weight * f64::from(coefficients[cy * STRIDE + cx]);
            }
        }
        let [gain, level, across, down] = light.map(f64::from);
        let lit = gain * f64::from(window.template[at]) + level + across * x + down * y;
        assert!(
            (f64::from(got) - (value - lit)).abs() < 5e-3,
            "{got} {}",
            value - lit
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn kernels_are_what_they_say(side in 2usize..45, seed in any::<u32>()) {
        let pattern = Pattern::new(side).unwrap();
        let window = window(&pattern, seed);
        hold_normal::<0>(&pattern, &window);
        hold_normal::<1>(&pattern, &window);
        hold_normal::<2>(&pattern, &window);
        hold_pulls::<0>(&pattern, &window);
        hold_pulls::<1>(&pattern, &window);
        hold_pulls::<2>(&pattern, &window);
    }

    #[test]
    fn samples_are_those_of_the_spline(
        side in 2usize..45, seed in any::<u32>(), warp in prop::array::uniform12(-6.0f32..6.0),
    ) {
        let pattern = Pattern::new(side).unwrap();
        let window = window(&pattern, seed);
        hold_sample::<1>(&pattern, &window, &warp, seed);
        hold_sample::<2>(&pattern, &window, &warp, seed);
    }
}
