//! Both frames, as windows read them: grey levels and slopes of `prev`, spline coefficients of `next`.

use super::spline::{Taps, along_columns, along_rows, both, widened};
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane};
use crate::support::{Masks, Support};

/// Pixels beyond the border that the spline reads.
pub(super) const MARGIN: usize = 2;
/// Pixels beside one that is sampled, on each side, that smoothing and spline make it of, but for a hundredth.
pub(super) const REACH: usize = 2;

/// Correlations of neighbours, and the deviations of the smoothing of such texture: particles of two and a half pixels have
/// the first, speckle of five pixels the second.
const SMOOTHING: [(f64, f64); 2] = [(0.65, 0.5), (0.78, 0.75)];

/// Both frames; memory is kept from pair to pair.
#[derive(Debug, Default)]
pub(super) struct Frames {
    pub(super) prev: Plane,
    pub(super) next: Plane,
    /// Derivatives of `prev` along x and y.
    pub(super) slopes: [Plane; 2],
    /// Of `next`, with a margin.
    pub(super) coefficients: Plane,
    pub(super) prev_support: Support,
    pub(super) next_support: Support,
    /// What was taken from all grey levels.
    pub(super) level: f64,
    other: Plane,
}

impl Frames {
    /// Take a pair of one size, smoothed.
    ///
    /// # Errors
    ///
    /// Those of the memory and of the execution.
    pub(super) fn take<T: Pixel>(
        &mut self,
        frames: [Frame<'_, T>; 2],
        masks: Masks<'_>,
        execution: &Execution,
    ) -> Result<()> {
        let [prev, next] = frames;
        self.prev_support
            .take_present(prev, masks.of_prev(), execution)?;
        self.next_support
            .take_present(next, masks.of_next(), execution)?;
        self.prev.copy_from(prev, execution)?;
        self.next.copy_from(next, execution)?;
        self.prev_support.fill(&mut self.prev);
        self.next_support.fill(&mut self.next);
        self.level = mean(&self.prev);
        let level = self.level as f32;
        let smoothing = Taps::smoothing(smoothing_of(likeness(&self.prev, self.level)));
        for plane in [&mut self.prev, &mut self.next] {
            for value in plane.data_mut() {
                *value -= level;
            }
            both(plane, &smoothing, &mut self.other, execution)?;
        }
        along_rows(
            &self.prev,
            &Taps::derivative(),
            &mut self.slopes[0],
            execution,
        )?;
        along_columns(
            &self.prev,
            &Taps::derivative(),
            &mut self.slopes[1],
            execution,
        )?;
        let mut coefficients = Plane::default();
        along_rows(&self.next, &Taps::inverse(), &mut self.other, execution)?;
        along_columns(&self.other, &Taps::inverse(), &mut coefficients, execution)?;
        widened(&coefficients, MARGIN, &mut self.coefficients)
    }

    /// Columns and rows.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.prev.width(), self.prev.height()]
    }

    /// Whether the pixel of `prev` rests on pixels that count.
    pub(super) fn is_read(&self, [x, y]: [usize; 2]) -> bool {
        let [width, height] = self.size();
        if x < REACH || y < REACH || x + REACH >= width || y + REACH >= height {
            return false;
        }
        let place = ((x - REACH) as isize, (y - REACH) as isize);
        !self.prev_support.has_absent()
            || self
                .prev_support
                .has_all(place, 2 * REACH + 1, 2 * REACH + 1)
    }

    /// Whether a sample at (x, y) of `next` rests on pixels that count.
    pub(super) fn is_sampled(&self, [x, y]: [f64; 2]) -> bool {
        let [width, height] = self.size();
        let reach = REACH as f64;
        let inside = |at: f64, size: usize| at >= reach && at < (size as f64) - reach - 1.0;
        // False for NaN.
        if !(inside(x, width) && inside(y, height)) {
            return false;
        }
        let place = (x as isize - REACH as isize, y as isize - REACH as isize);
        !self.next_support.has_absent()
            || self
                .next_support
                .has_all(place, 2 * REACH + 2, 2 * REACH + 2)
    }
}

/// Deviation of the smoothing, in pixels, of texture whose neighbours are as much alike as `likeness` says: what is fine
/// keeps what little the samples have of it, what is coarse loses nothing by more.
fn smoothing_of(likeness: f64) -> f64 {
    let [(fine, least), (coarse, most)] = SMOOTHING;
    least + (most - least) * ((likeness - fine) / (coarse - fine)).clamp(0.0, 1.0)
}

/// The correlation of pixels with their neighbours to the right.
fn likeness(plane: &Plane, level: f64) -> f64 {
    let (mut square, mut change) = (0.0, 0.0);
    for y in 0..plane.height() {
        let row = plane.row(y);
        for pair in row.windows(2) {
            square += (f64::from(pair[0]) - level).powi(2);
            change += (f64::from(pair[1]) - f64::from(pair[0])).powi(2);
        }
    }
    if square > 0.0 {
        1.0 - 0.5 * change / square
    } else {
        0.0
    }
}

/// The mean grey level.
fn mean(plane: &Plane) -> f64 {
    let sum: f64 = (0..plane.height())
        .map(|y| {
            plane
                .row(y)
                .iter()
                .map(|value| f64::from(*value))
                .sum::<f64>()
        })
        .sum();
    sum / plane.data().len().max(1) as f64
}
