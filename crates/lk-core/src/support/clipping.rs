//! At which grey levels those of a frame are cut off.

use ndarray::ArrayView2;

use crate::frame::{Frame, Pixel};
use crate::grey::GreyRange;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};

/// Of so many pixels, and of this share of the frame, an end of the range must be made up for it to be a limit.
const LEAST_PILE: usize = 16;
const PILE_SHARE: f64 = 0.001;

/// Where grey levels are cut off, slopes lead to them: of the steps from a limit to its neighbour in the row so large a
/// share is below this share of the range. The edges of flat shapes in black and white are jumps.
const SOFT_SHARE: f64 = 0.25;
const SOFT_STEP: f32 = 0.125;

/// The least and the largest grey level where those of `frame` are cut off.
///
/// Bytes are cut off at 0 and 255. Deeper types hold the grey levels of sensors of many depths, and floats any range: the
/// ends are those of the frame. At either end there must be a pile of them, with slopes that lead to it. What `mask` takes
/// away says nothing of that: `greys` are those that it keeps.
pub(super) fn limits<T: Pixel>(
    frame: Frame<'_, T>,
    mask: Option<ArrayView2<'_, bool>>,
    greys: &GreyRange,
) -> [Option<f32>; 2] {
    let Some([low, high]) = greys.extremes() else {
        return [None; 2];
    };
    let reached = |end: f32, limit: f32| T::DEPTH != Some(8) || end == limit;
    let soft = SOFT_STEP * (high - low);
    [(low, 0.0), (high, 255.0)].map(|(end, limit)| {
        (reached(end, limit) && high > low && piles_up(frame, mask, end, soft)).then_some(end)
    })
}

/// Whether grey levels that `mask` keeps pile up at `end`, within slopes whose steps are at most `soft`.
fn piles_up<T: Pixel>(
    frame: Frame<'_, T>,
    mask: Option<ArrayView2<'_, bool>>,
    end: f32,
    soft: f32,
) -> bool {
    let keep = |y: usize, x: usize| mask.is_none_or(|mask| mask[(y, x)]);
    let among = mask.map_or(frame.len(), |mask| {
        mask.iter().filter(|keep| **keep).count()
    });
    let least = (PILE_SHARE * among as f64).max(LEAST_PILE as f64);
    let mut pixels = 0;
    for (y, row) in frame.rows().into_iter().enumerate() {
        pixels += match row.as_slice() {
            Some(row) if mask.is_none() => dispatch(SimdLevel::detected(), Count { row, end }),
            _ => row
                .iter()
                .enumerate()
                .map(|(x, value)| u32::from(value.to_f32() == end && keep(y, x)))
                .sum(),
        } as usize;
    }
    if (pixels as f64) < least {
        return false;
    }
    let (mut steps, mut gentle) = (0, 0);
    for (y, row) in frame.rows().into_iter().enumerate() {
        let found = match row.as_slice() {
            Some(row) if mask.is_none() => {
                dispatch(SimdLevel::detected(), CountSteps { row, end, soft })
            }
            _ => steps_among(
                row.iter()
                    .enumerate()
                    .map(|(x, value)| if keep(y, x) { value.to_f32() } else { f32::NAN }),
                end,
                soft,
            ),
        };
        steps += found.0;
        gentle += found.1;
    }
    gentle > 0 && f64::from(gentle) >= SOFT_SHARE * f64::from(steps)
}

/// Whether the step between neighbours is one from or to `end`, and whether it is such a one and gentle. A value that is
/// NaN is none.
#[inline(always)]
fn is_step(last: f32, value: f32, end: f32, soft: f32) -> (u32, u32) {
    let step = (value - last).abs();
    let counts = u32::from(step > 0.0) & (u32::from(value == end) | u32::from(last == end));
    (counts, counts & u32::from(step <= soft))
}

/// Steps from `end` to others among the values of a row, and those that are gentle.
fn steps_among(values: impl Iterator<Item = f32>, end: f32, soft: f32) -> (u32, u32) {
    let (mut steps, mut gentle) = (0, 0);
    let mut last = f32::NAN;
    for value in values {
        let found = is_step(last, value, end, soft);
        steps += found.0;
        gentle += found.1;
        last = value;
    }
    (steps, gentle)
}

/// [`steps_among`] the values of a row that all count.
struct CountSteps<'a, T> {
    row: &'a [T],
    end: f32,
    soft: f32,
}

impl<T: Pixel> Kernel for CountSteps<'_, T> {
    type Output = (u32, u32);

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> (u32, u32) {
        let Self { row, end, soft } = self;
        let (mut steps, mut gentle) = (0, 0);
        for (last, value) in row.iter().zip(row.get(1..).unwrap_or_default()) {
            let found = is_step(last.to_f32(), value.to_f32(), end, soft);
            steps += found.0;
            gentle += found.1;
        }
        (steps, gentle)
    }
}

/// How many pixels of a row have this grey level.
struct Count<'a, T> {
    row: &'a [T],
    end: f32,
}

impl<T: Pixel> Kernel for Count<'_, T> {
    type Output = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let mut count = 0;
        for value in self.row {
            count += u32::from(value.to_f32() == self.end);
        }
        count
    }
}
