//! Single pixels far outside of the grey levels of a frame: those of a sensor that are stuck, or hit by a particle. One of them
//! would set the range of the whole frame, and all else would be dark. They count for nothing.

use ndarray::ArrayView2;

use crate::frame::{Frame, Pixel};
use crate::grey::GreyRange;

/// Pixels that are looked at for the range of most.
const SAMPLES: usize = 4096;
/// The share of those that may lie outside of it, at either end.
const OUTSIDE: f64 = 0.005;
/// A pixel is hot where it is farther away from that range than this many times its width: few pictures of a scene have one
/// that is, and none that stands alone.
const FAR: f32 = 16.0;
/// One pixel in so many may be hot.
const ONE_IN: usize = 10_000;
/// The largest range that no pixel is hot in: that of frames of 8 bits.
const ORDINARY: f32 = 512.0;

/// The grey levels of `frame` that `mask` keeps, without hot pixels.
pub(super) fn greys_without<T: Pixel>(
    frame: Frame<'_, T>,
    mask: Option<ArrayView2<'_, bool>>,
) -> GreyRange {
    let greys = GreyRange::among(frame, mask);
    match greys.extremes() {
        Some([low, high]) if high - low > ORDINARY => without(frame, mask, [low, high])
            .map_or(greys, |[extremes, limits]| {
                GreyRange::within(extremes, limits)
            }),
        _ => greys,
    }
}

/// The extremes without hot pixels, and the limits that those are beyond, if there are any and all that is beyond them is hot.
fn without<T: Pixel>(
    frame: Frame<'_, T>,
    mask: Option<ArrayView2<'_, bool>>,
    [low, high]: [f32; 2],
) -> Option<[[f32; 2]; 2]> {
    let (height, width) = frame.dim();
    let level = |y: usize, x: usize| frame[(y, x)].to_f32();
    let counts = |y: usize, x: usize| mask.is_none_or(|mask| mask[(y, x)]);
    // An odd step does not keep to some columns.
    let step = frame.len().div_ceil(SAMPLES) | 1;
    let mut samples: Vec<f32> = (0..frame.len())
        .step_by(step)
        .map(|at| (at / width, at % width))
        .filter(|&(y, x)| counts(y, x) && level(y, x).is_finite())
        .map(|(y, x)| level(y, x))
        .collect();
    let outside = (OUTSIDE * samples.len() as f64) as usize;
    let last = samples.len().checked_sub(1 + outside)?;
    let [least, most] =
        [outside, last].map(|at| *samples.select_nth_unstable_by(at, f32::total_cmp).1);
    let far = FAR * (most - least);
    let limits = [least - far, most + far];
    let is_beyond = |value: f32| value.is_finite() && !(limits[0]..=limits[1]).contains(&value);
    if far <= 0.0 || !(is_beyond(low) || is_beyond(high)) {
        return None;
    }
    let (mut hot, mut extremes) = (0, [f32::INFINITY, f32::NEG_INFINITY]);
    for y in 0..height {
        for x in 0..width {
            let value = level(y, x);
            if !value.is_finite() || !counts(y, x) {
                continue;
            }
            if !is_beyond(value) {
                extremes = [extremes[0].min(value), extremes[1].max(value)];
                continue;
            }
            hot += 1;
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let beside = rows
                .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| (y, x)))
                .filter(|&(y, x)| counts(y, x) && is_beyond(level(y, x)));
            if hot > frame.len().div_ceil(ONE_IN) || beside.count() > 1 {
                return None;
            }
        }
    }
    Some([extremes, limits])
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;

    fn scene() -> Array2<f32> {
        Array2::from_shape_fn((60, 80), |(y, x)| ((7 * x + 31 * y) % 200) as f32)
    }

    #[test]
    fn a_pixel_alone_is_left_out() {
        let mut frame = scene();
        let clean = GreyRange::of(frame.view());
        assert_eq!(greys_without(frame.view(), None), clean);
        for bad in [6e4, -1e8, f32::MAX] {
            frame[(20, 30)] = bad;
            let greys = greys_without(frame.view(), None);
            assert_eq!(greys.extremes(), clean.extremes(), "{bad}");
            assert_eq!(greys.scale(), clean.scale());
            assert!(
                greys
                    .limits()
                    .is_some_and(|[low, high]| bad < low || bad > high)
            );
        }
        // With what is not finite, which is no grey level anyway.
        frame[(40, 50)] = f32::NAN;
        assert_eq!(
            greys_without(frame.view(), None).extremes(),
            clean.extremes()
        );
    }

    #[test]
    fn what_is_bright_and_no_single_pixel_stays() {
        let mut pair = scene();
        (pair[(20, 30)], pair[(20, 31)]) = (6e4, 6e4);
        assert_eq!(greys_without(pair.view(), None).limits(), None);
        // Most of it black, as the night sky is.
        let mut night = Array2::<f32>::zeros((60, 80));
        night[(5, 5)] = 6e4;
        assert_eq!(greys_without(night.view(), None).limits(), None);
        let deep = scene().mapv(|value| (value * 300.0) as u16);
        assert_eq!(greys_without(deep.view(), None), GreyRange::of(deep.view()));
    }

    #[test]
    fn a_mask_takes_it_away_first() {
        let mut frame = scene();
        frame[(20, 30)] = 6e4;
        let mask = Array2::from_shape_fn((60, 80), |at| at != (20, 30));
        assert_eq!(
            greys_without(frame.view(), Some(mask.view())).limits(),
            None
        );
    }
}
