//! The filters that smooth both frames and move them towards each other, and what they do to noise.
//!
//! `docs/explanation/algorithms.md`, section "Sampling and gradients".

#![allow(clippy::needless_range_loop, reason = "filter indices")]

use crate::simd::Eight;

/// Taps on each side of the interpolation and of the derivative.
pub(crate) const RADIUS: usize = 2;
/// The taps of one filter.
pub(crate) type Taps = [f32; 2 * RADIUS + 1];
/// The derivative of fourth order.
pub(crate) const DERIVATIVE: Taps = [1.0 / 12.0, -8.0 / 12.0, 0.0, 8.0 / 12.0, -1.0 / 12.0];

/// The even part of the taps: coefficients of 1, delta^2, delta^4, delta^6 for the taps 1 and 2 from the middle.
const EVEN: [[f64; 2]; 4] = [
    [0.215646278, 0.007313361],
    [0.393206985, -0.095004255],
    [-5.254674985, 3.876233824],
    [35.923271313, -26.894626937],
];
/// The odd part: coefficients of delta, delta^3, delta^5, delta^7.
const ODD: [[f64; 2]; 4] = [
    [0.424915308, 0.037542346],
    [0.00455665, -0.002278325],
    [-3.069134786, 1.534567393],
    [19.31072613, -9.655363065],
];

/// A filter that smooths and moves by `delta` at once, |delta| <= 0.26.
///
/// Two frames that are moved towards each other share its amplitude, so that only its phase can bias a displacement.
/// The coefficients are the least squares fit of the phase up to 2.6 radians a pixel, with the amplitude of a Gaussian
/// of standard deviation 0.71 as a weak second aim: textures of any scale are biased by less than 0.0002 px. The tests
/// below hold them to both aims; the weights of the fit itself are not on record.
pub(crate) fn taps(delta: f64) -> Taps {
    let square = delta * delta;
    let even: [f64; 2] = std::array::from_fn(|k| {
        ((EVEN[3][k] * square + EVEN[2][k]) * square + EVEN[1][k]) * square + EVEN[0][k]
    });
    let odd: [f64; 2] = std::array::from_fn(|k| {
        (((ODD[3][k] * square + ODD[2][k]) * square + ODD[1][k]) * square + ODD[0][k]) * delta
    });
    [
        (even[1] - odd[1]) as f32,
        (even[0] - odd[0]) as f32,
        (1.0 - 2.0 * (even[0] + even[1])) as f32,
        (even[0] + odd[0]) as f32,
        (even[1] + odd[1]) as f32,
    ]
}

/// [`taps`] of each lane.
#[inline(always)]
pub(crate) fn lane_taps<L: Eight>(delta: L) -> [L; 2 * RADIUS + 1] {
    let square = delta * delta;
    let mut even = [L::zero(); 2];
    let mut odd = [L::zero(); 2];
    for k in 0..2 {
        let of = |table: &[[f64; 2]; 4], power: usize| L::splat(table[power][k] as f32);
        even[k] = ((of(&EVEN, 3) * square + of(&EVEN, 2)) * square + of(&EVEN, 1)) * square
            + of(&EVEN, 0);
        odd[k] = (((of(&ODD, 3) * square + of(&ODD, 2)) * square + of(&ODD, 1)) * square
            + of(&ODD, 0))
            * delta;
    }
    [
        even[1] - odd[1],
        even[0] - odd[0],
        L::splat(1.0) - L::splat(2.0) * (even[0] + even[1]),
        even[0] + odd[0],
        even[1] + odd[1],
    ]
}

/// The taps that move the other way.
#[inline(always)]
pub(crate) fn reversed([a, b, c, d, e]: Taps) -> Taps {
    [e, d, c, b, a]
}

/// What the filters do to white noise of unit variance in each frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoiseGain {
    /// Variance of the filtered frame.
    pub(super) sampled: f64,
    /// Variance of its gradient, along x and along y.
    pub(super) gradient: [f64; 2],
    /// Variance of its Laplacian.
    pub(super) laplacian: f64,
}

/// What the filters along x and along y do to white noise.
pub(super) fn noise_gain(taps: &[Taps; 2]) -> NoiseGain {
    let (across, down) = (energy(&taps[0]), energy(&taps[1]));
    // The Laplacian is the second difference along x plus that along y; its cross term is the product of the two
    // correlations of a filter with its own second difference.
    let second = |taps: &[f32]| convolved(taps, &[1.0, -2.0, 1.0]);
    let cross = |taps: &[f32]| -> f64 {
        second(taps)[1..]
            .iter()
            .zip(taps)
            .map(|(a, b)| f64::from(a * b))
            .sum()
    };
    NoiseGain {
        sampled: across * down,
        gradient: [
            energy(&convolved(&taps[0], &DERIVATIVE)) * down,
            across * energy(&convolved(&taps[1], &DERIVATIVE)),
        ],
        laplacian: energy(&second(&taps[0])) * down
            + across * energy(&second(&taps[1]))
            + 2.0 * cross(&taps[0]) * cross(&taps[1]),
    }
}

fn energy(taps: &[f32]) -> f64 {
    taps.iter().map(|tap| f64::from(tap * tap)).sum()
}

/// One filter after the other, of at most as many taps; zeros follow the last tap.
fn convolved(taps: &[f32], other: &[f32]) -> [f32; 4 * RADIUS + 1] {
    let mut both = [0.0f32; 4 * RADIUS + 1];
    for (i, a) in taps.iter().enumerate() {
        for (j, b) in other.iter().enumerate() {
            both[i + j] += a * b;
        }
    }
    both
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the filter for `delta` makes of a wave of this frequency, moved back by it: real and imaginary part.
    fn moved_back(delta: f64, frequency: f64) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for (place, tap) in taps(delta).iter().enumerate() {
            let phase = frequency * (place as f64 - RADIUS as f64 - delta);
            sum[0] += f64::from(*tap) * phase.cos();
            sum[1] += f64::from(*tap) * phase.sin();
        }
        sum
    }

    /// Displacements up to which each frame is moved, and frequencies in radians a pixel.
    fn grid(longest: f64, count: usize) -> impl Iterator<Item = f64> {
        (0..=count).map(move |index| longest * index as f64 / count as f64)
    }

    #[test]
    fn textures_of_any_scale_are_moved_by_what_was_asked_for() {
        for smoothed in [1.0f64, 1.5, 2.0, 4.0, 8.0] {
            for delta in grid(0.26, 26) {
                // Least squares of a displacement, by the texture's power at each frequency.
                let (mut seen, mut weight) = (0.0, 0.0);
                for frequency in grid(std::f64::consts::PI, 500) {
                    let [re, im] = moved_back(delta, frequency);
                    let power = (re * re + im * im) * (-(smoothed * frequency).powi(2)).exp();
                    seen += frequency * im.atan2(re) * power;
                    weight += frequency * frequency * power;
                }
                // Both frames are moved.
                let bias = 2.0 * seen / weight;
                assert!(bias.abs() < 2e-4, "{smoothed} {delta}: {bias}");
            }
        }
    }

    #[test]
    fn the_amplitude_is_that_of_a_gaussian() {
        for delta in grid(0.26, 26) {
            for frequency in grid(2.6, 100) {
                let [re, im] = moved_back(delta, frequency);
                let gaussian = (-0.5 * (0.71 * frequency).powi(2)).exp();
                let off = re.hypot(im) - gaussian;
                assert!(off.abs() < 0.017, "{delta} {frequency}: {off}");
            }
        }
    }
}
