//! How the noise of a pixel reaches a displacement: the spline spreads it over its neighbours, and the window's
//! gradients weigh them.
//!
//! `docs/explanation/algorithms.md`, section "Covariance of a point".

use crate::track::patch::Window;

/// Correlation of neighbouring gradients, and their energy.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gradients {
    /// Correlation with the next pixel across the edges that a gradient stands on, and along itself.
    pub(super) across: f64,
    pub(super) along: f64,
    /// Mean square of a gradient along one axis.
    pub(super) energy: f64,
}

impl Gradients {
    /// From sums over a window of `area` pixels: squares of a gradient, and products with that of the next pixel, of
    /// which there are `share` times as many.
    pub(super) fn new(energy: [f64; 2], lagged: [f64; 2], share: f64, area: f64) -> Self {
        let correlation = |axis: usize| {
            let found = lagged[axis] / (share * energy[axis]);
            if found.is_finite() {
                found.clamp(0.0, 1.0)
            } else {
                1.0
            }
        };
        Self {
            across: correlation(0),
            along: correlation(1),
            energy: 0.5 * (energy[0] + energy[1]) / area,
        }
    }
}

/// Where the samples of a window lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Samples {
    /// The window's first sample in `prev`.
    pub(super) prev: [f64; 2],
    /// That in `next`; `None` where they lie between pixels in all ways.
    pub(super) next: Option<[f64; 2]>,
    /// Pixels of `next` from sample to sample.
    pub(super) spacing: f64,
}

/// Products of the spline's weights with themselves, none, one and two pixels apart, at a position.
fn overlaps(position: f64) -> [f64; 3] {
    let weights = cubic((position - position.floor()) as f32).map(f64::from);
    let apart = |lag: usize| {
        weights
            .iter()
            .zip(&weights[lag..])
            .map(|(one, other)| one * other)
            .sum()
    };
    [apart(0), apart(1), apart(2)]
}

/// The mean of both extremes, for samples at all positions.
fn mean_overlaps() -> [f64; 3] {
    let (at, between) = (overlaps(0.0), overlaps(0.5));
    [0, 1, 2].map(|lag| 0.5 * (at[lag] + between[lag]))
}

/// The variance of a displacement is `left`, the variance of what is left in the window, times this times the inverse of
/// the summed structure tensor. `own` is the part of it that is the noise of `prev`.
pub(super) fn noise_gain(
    gradients: &Gradients,
    window: Window,
    samples: &Samples,
    own: f64,
) -> f64 {
    // Of so many pixels in a row, this share has a neighbour so far away within the window.
    let share = |pixels: usize, lag: usize| pixels.saturating_sub(lag) as f64 / pixels as f64;
    let sides = [
        (window.width, gradients.across),
        (window.height, gradients.along),
    ];
    let mut total = 1.0;
    for (axis, (pixels, correlation)) in sides.into_iter().enumerate() {
        let prev = overlaps(samples.prev[axis]);
        let next = samples
            .next
            .map_or_else(mean_overlaps, |next| overlaps(next[axis]));
        let noise = |lag: usize| {
            // The overlap falls off about like a Gaussian: at another spacing it is a power.
            let mut wider = next[lag] / next[0];
            if samples.spacing != 1.0 {
                wider = wider.powf(samples.spacing * samples.spacing);
            }
            (prev[lag] + next[0] * wider) / (prev[0] + next[0])
        };
        // So does the gradients' correlation.
        let one = noise(1) * share(pixels, 1) * correlation;
        let two = noise(2) * share(pixels, 2) * correlation.powi(4);
        total *= 1.0 + 2.0 * (one + two);
    }
    let slope = slope(gradients, own);
    total / (slope * slope)
}

/// How much steeper what is sampled is than its central differences, along a gradient.
///
/// The slope of the spline is the difference of the pixels themselves, which the samples' differences are smoothed from
/// by the weights 1/6, 4/6, 1/6: in frequencies w their share is 1 - (1 - cos w) / 3, and the mean of cos w is the
/// correlation along the gradient. The noise in the gradients adds to their energy, but meets no slope.
fn slope(gradients: &Gradients, own: f64) -> f64 {
    let [none, one, two] = overlaps(0.0);
    let noise = 0.5 * own * (1.0 - two / none);
    let lagged_noise = 0.25 * own * one / none;
    let energy = gradients.energy - noise;
    let correlation = (gradients.along * gradients.energy - lagged_noise) / energy;
    let lost = (1.0 - correlation) / 3.0;
    if energy <= 0.0 || !(0.0..0.5).contains(&lost) {
        return 1.0;
    }
    energy / gradients.energy * (1.0 + lost + lost * lost)
}

/// The weights of the four taps of the cubic B-spline around a position `t` after the second of them.
#[inline(always)]
pub(super) fn cubic(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        s * s * s / 6.0,
        2.0 / 3.0 - t * t * (1.0 - t / 2.0),
        2.0 / 3.0 - s * s * (1.0 - s / 2.0),
        t * t * t / 6.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums over the window in frequency space, for a wave of one direction and no noise in its gradients.
    #[test]
    fn one_wave_is_spread_as_its_spectrum_says() {
        let window = Window {
            width: 4001,
            height: 4001,
        };
        let samples = Samples {
            prev: [3.0, 7.0],
            next: Some([4.0, 1.0]),
            spacing: 1.0,
        };
        for frequency in [0.1f64, 0.4, 0.8] {
            let gradients = Gradients {
                across: 1.0,
                along: frequency.cos(),
                energy: 20.0,
            };
            // The spline passes this share of the wave, and of the noise that meets it.
            let passed = (2.0 + frequency.cos()) / 3.0;
            // The noise's power there over its variance, 1/2 along each axis; the gradients are its differences.
            let want = (passed * passed / 0.5) / 0.5 * (passed * passed);
            let spread = noise_gain(&gradients, window, &samples, 0.0);
            let ratio = spread / want;
            assert!(
                (0.95..1.05).contains(&ratio),
                "{frequency}: {spread} {want}"
            );
        }
    }
}
