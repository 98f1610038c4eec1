//! The unit of grey levels in which frames are compared.

use ndarray::ArrayView2;

use crate::frame::{Frame, Pixel};

/// Pixels of each frame that are looked at; they tell enough.
const LOOKED_AT: usize = 2048;

/// Planes hold `scale * (grey level - mean)`: sums of squares do not lose digits, and no result depends on the range of
/// the frames' grey levels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Normalization {
    pub(super) mean: f64,
    pub(super) scale: f64,
    /// Variance of the rounding of grey levels, in the planes.
    pub(super) rounding: f64,
}

impl Normalization {
    /// Standard deviation of the grey levels in the planes: that of a picture of good contrast in eight bits.
    const SPREAD: f64 = 32.0;
    /// Floating point is taken to be exact to this variance: a ten thousandth of the spread, squared.
    const LEAST_ROUNDING: f64 = 1e-5;

    /// From some rows of both frames, which may be parts of larger ones.
    pub(super) fn new<T: Pixel>(frames: [(Frame<'_, T>, Option<ArrayView2<'_, bool>>); 2]) -> Self {
        let [a, b] = frames.map(|(frame, mask)| {
            let step = (frame.len() / LOOKED_AT).max(1);
            let mut moments = Moments::default();
            for (y, row) in frame.rows().into_iter().enumerate().step_by(step) {
                let grey = row.iter().map(|value| value.to_f32());
                match mask {
                    Some(mask) => moments.add(
                        grey.zip(mask.row(y))
                            .filter_map(|(value, counts)| counts.then_some(value)),
                    ),
                    None => moments.add(grey),
                }
            }
            moments
        });
        let spread = ((a.variance() + b.variance()) / 2.0).sqrt();
        let scale = if spread > 0.0 && spread.is_finite() {
            Self::SPREAD / spread
        } else {
            1.0
        };
        Self {
            mean: (a.mean() + b.mean()) / 2.0,
            scale,
            rounding: (T::ROUNDING * scale * scale).max(Self::LEAST_ROUNDING),
        }
    }
}

/// Sums over the finite values, less a first one so that their squares do not lose digits.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    first: Option<f32>,
    count: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, row: impl Iterator<Item = f32>) {
        for value in row.filter(|value| value.is_finite()) {
            let value = f64::from(value - *self.first.get_or_insert(value));
            self.count += 1.0;
            self.sum += value;
            self.squares += value * value;
        }
    }

    fn mean(&self) -> f64 {
        f64::from(self.first.unwrap_or(0.0)) + self.sum / self.count.max(1.0)
    }

    fn variance(&self) -> f64 {
        let count = self.count.max(1.0);
        (self.squares / count - (self.sum / count).powi(2)).max(0.0)
    }
}
