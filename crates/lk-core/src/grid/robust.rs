//! Weights that pixels lose which do not follow the others of their window.
//!
//! P. Holland and R. Welsch, "Robust regression using iteratively reweighted least-squares", 1977.

use super::window::Window;

/// A robust weight falls to a half at this multiple of the deviation; the least deviation in grey levels.
const ROBUST: f32 = 1.5;
const LEAST_DEVIATION: f32 = 0.3;
/// The deviation of a Gaussian over the median of its sizes.
const OF_MEDIAN: f32 = 1.4826;

/// Weigh each pixel by what is left of it (Cauchy), against the median of all.
pub(super) fn reweigh(window: &mut Window, gain: f64) {
    weigh(window, gain, |share| 1.0 / (1.0 + share));
}

/// Weigh each pixel by how much more it would pull if the window moved: less than its weight says, and where it is far off
/// less than nothing.
pub(super) fn change_of_pull(window: &mut Window, gain: f64) {
    weigh(window, gain, |share| {
        (1.0 - share) / ((1.0 + share) * (1.0 + share))
    });
}

/// Weigh each pixel by the square of its share in what is left.
fn weigh(window: &mut Window, gain: f64, weight_of: impl Fn(f32) -> f32) {
    let Window {
        weight,
        residual,
        met,
        sizes,
        ..
    } = window;
    sizes.clear();
    let left = residual.iter().zip(met.iter());
    sizes.extend(
        left.filter(|(_, met)| **met > 0.0)
            .map(|(left, _)| left.abs()),
    );
    if sizes.is_empty() {
        return;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f32::total_cmp);
    let least = LEAST_DEVIATION * (gain as f32).max(1.0);
    let scale = 1.0 / (ROBUST * (OF_MEDIAN * *median).max(least));
    for ((weight, left), met) in weight.iter_mut().zip(residual.iter()).zip(met.iter()) {
        let share = left * scale;
        *weight = met * weight_of(share * share);
    }
}
