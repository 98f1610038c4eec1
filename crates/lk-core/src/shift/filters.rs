//! The filters that smooth both frames and move them towards each other, and what they do to noise.
//!
//! `docs/algorithms.md`, section "Sampling and gradients".

#![allow(clippy::needless_range_loop, reason = "filter indices")]

/// Taps on each side of the interpolation and of the derivative.
pub(super) const RADIUS: usize = 2;
/// The taps of one filter.
pub(super) type Taps = [f32; 2 * RADIUS + 1];
/// The derivative of fourth order.
pub(super) const DERIVATIVE: Taps = [1.0 / 12.0, -8.0 / 12.0, 0.0, 8.0 / 12.0, -1.0 / 12.0];

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
/// of standard deviation 0.71 as a weak second aim: textures of any scale are biased by less than 0.0002 px.
pub(super) fn taps(delta: f64) -> Taps {
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
