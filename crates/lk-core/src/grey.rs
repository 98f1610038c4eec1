//! The range of a frame's grey levels, and the scale that brings it to where thresholds in grey levels hold.

use ndarray::{ArrayView1, ArrayView2, s};

use crate::frame::{Frame, Pixel};
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};

/// Ranges that are left alone: those of frames of 8 bits with some contrast.
const ORDINARY: std::ops::RangeInclusive<f64> = 16.0..=512.0;

/// Any other range is brought to at least this and less than twice this: 2^7, the upper half of 0..255.
const EXPONENT: i32 = 7;

/// Pixels that are scanned together: one that is not finite makes the scan of its part slow.
const PART: usize = 1 << 12;

/// The extremes of the finite grey levels of a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct GreyRange {
    /// The least and the largest; `None` without a finite pixel.
    extremes: Option<[f32; 2]>,
    /// Whether every pixel is finite, and counts.
    finite: bool,
    /// What is beyond counts for nothing; of none but single pixels.
    limits: Option<[f32; 2]>,
}

impl GreyRange {
    /// Of the pixels that `mask` keeps.
    pub(crate) fn among<T: Pixel>(frame: Frame<'_, T>, mask: Option<ArrayView2<'_, bool>>) -> Self {
        let Some(mask) = mask else {
            return Self::of(frame);
        };
        let mut greys = Self::of_none();
        for (pixels, mask) in frame.rows().into_iter().zip(mask.rows()) {
            let mut run = 0;
            for (x, counts) in mask.iter().enumerate() {
                if *counts {
                    run += 1;
                } else if run > 0 {
                    greys.scan(pixels.slice(s![x - run..x]));
                    run = 0;
                }
            }
            greys.scan(pixels.slice(s![mask.len() - run..]));
        }
        greys
    }

    /// Of no pixel.
    fn of_none() -> Self {
        Self {
            extremes: None,
            finite: true,
            limits: None,
        }
    }

    pub(crate) fn of<T: Pixel>(frame: Frame<'_, T>) -> Self {
        let mut greys = Self::of_none();
        if let Some(pixels) = frame.as_slice() {
            for part in pixels.chunks(PART) {
                greys.scan(ArrayView1::from(part));
            }
        } else {
            for row in frame.rows() {
                greys.scan(row);
            }
        }
        greys
    }

    /// The extremes of the finite grey levels, and whether every pixel is finite.
    pub(crate) fn parts(&self) -> (Option<[f32; 2]>, bool) {
        (self.extremes, self.finite)
    }

    /// From what [`GreyRange::parts`] gives.
    pub(crate) fn of_parts(extremes: Option<[f32; 2]>, finite: bool) -> Self {
        Self {
            extremes,
            finite,
            limits: None,
        }
    }

    /// Of a frame whose pixels beyond `limits` count for nothing.
    pub(crate) fn within(extremes: [f32; 2], limits: [f32; 2]) -> Self {
        Self {
            extremes: Some(extremes),
            finite: false,
            limits: Some(limits),
        }
    }

    /// Beyond which grey levels pixels count for nothing, if there are such pixels.
    pub(crate) fn limits(&self) -> Option<[f32; 2]> {
        self.limits
    }

    fn scan<T: Pixel>(&mut self, pixels: ArrayView1<'_, T>) {
        let found = pixels.as_slice().and_then(finite_extremes);
        if let Some(found) = found {
            self.include(found);
            return;
        }
        for value in pixels.iter().map(|value| value.to_f32()) {
            if value.is_finite() {
                self.include([value; 2]);
            } else {
                self.finite = false;
            }
        }
    }

    fn include(&mut self, [low, high]: [f32; 2]) {
        self.extremes = Some(match self.extremes {
            None => [low, high],
            Some([least, largest]) => [least.min(low), largest.max(high)],
        });
    }

    /// The power of two to multiply the frame by.
    pub(crate) fn scale(&self) -> f32 {
        let [low, high] = self.extremes.unwrap_or_default().map(f64::from);
        let range = high - low;
        if range <= 0.0 || ORDINARY.contains(&range) {
            return 1.0;
        }
        // The range of finite `f32` is a normal `f64`: its exponent stands in its bits. The limits keep the scale and
        // its inverse normal.
        let exponent = ((range.to_bits() >> 52) & 0x7ff) as i32 - 1023;
        let exponent = (EXPONENT - exponent).clamp(-126, 126);
        f32::from_bits(((127 + exponent) as u32) << 23)
    }

    /// The least and the largest grey level, multiplied by `scale`.
    pub(crate) fn range(&self, scale: f32) -> Option<[f32; 2]> {
        let range = self.extremes?.map(|value| value * scale);
        range.iter().all(|value| value.is_finite()).then_some(range)
    }

    /// The least and the largest finite grey level.
    pub(crate) fn extremes(&self) -> Option<[f32; 2]> {
        self.extremes
    }

    /// Whether every pixel is finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.finite
    }

    /// Whether every pixel is finite and, multiplied by `scale`, at most `most` from 0.
    pub(crate) fn stay_within(&self, scale: f32, most: f32) -> bool {
        let extremes = self.extremes.unwrap_or_default();
        self.finite && extremes.iter().all(|value| (value * scale).abs() <= most)
    }
}

/// The extremes of `row`; `None` if it is empty or holds what is not finite.
fn finite_extremes<T: Pixel>(row: &[T]) -> Option<[f32; 2]> {
    let first = *row.first()?;
    let Extremes { low, high, nan } = dispatch(SimdLevel::detected(), Scan { row, first });
    let (low, high) = (low.to_f32(), high.to_f32());
    (!nan && low.is_finite() && high.is_finite()).then_some([low, high])
}

/// The least and the largest of a row, and whether there is a NaN among it.
struct Extremes<T> {
    low: T,
    high: T,
    nan: bool,
}

struct Scan<'a, T> {
    row: &'a [T],
    first: T,
}

/// Pixels that are compared at a time.
const GROUP: usize = 64;

impl<T: Pixel> Kernel for Scan<'_, T> {
    type Output = Extremes<T>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Extremes<T> {
        let first = self.first;
        let (mut low, mut high, mut nan) = ([first; GROUP], [first; GROUP], false);
        let (groups, rest) = self.row.as_chunks::<GROUP>();
        let mut tail = [first; GROUP];
        tail[..rest.len()].copy_from_slice(rest);
        for group in groups.iter().chain([&tail]) {
            let mut strange = 0u32;
            for k in 0..GROUP {
                let value = group[k];
                low[k] = if value < low[k] { value } else { low[k] };
                high[k] = if value > high[k] { value } else { high[k] };
                #[allow(clippy::eq_op, reason = "true for NaN; costs integers nothing")]
                let is_nan = value != value;
                strange |= u32::from(is_nan);
            }
            nan |= strange != 0;
        }
        let (mut least, mut largest) = (first, first);
        for (low, high) in low.into_iter().zip(high) {
            least = if low < least { low } else { least };
            largest = if high > largest { high } else { largest };
        }
        Extremes {
            low: least,
            high: largest,
            nan,
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;

    fn scale(range: f32) -> f32 {
        GreyRange {
            extremes: Some([0.0, range]),
            finite: true,
            limits: None,
        }
        .scale()
    }

    #[test]
    fn a_range_is_brought_to_that_of_8_bits() {
        for (range, want) in [
            (0.0, 1.0),
            (16.0, 1.0),
            (255.0, 1.0),
            (512.0, 1.0),
            (1.0, 128.0),
            (255.0 / 256.0, 256.0),
            (15.5, 16.0),
            (513.0, 0.25),
            (65535.0, 1.0 / 256.0),
        ] {
            assert_eq!(scale(range), want, "{range}");
        }
        for range in [f32::from_bits(1), f32::MIN_POSITIVE, 3e-7, 1e30, f32::MAX] {
            let scale = scale(range);
            assert!(scale.is_normal() && scale.recip().is_normal(), "{range}");
            assert!(range < 1e-30 || (128.0..256.0).contains(&(range * scale)));
        }
        let widest = GreyRange {
            extremes: Some([f32::MIN, f32::MAX]),
            finite: true,
            limits: None,
        };
        assert_eq!(widest.scale(), 2.0f32.powi(7 - 128));
        assert_eq!(GreyRange::default().scale(), 1.0);
    }

    #[test]
    fn extremes_are_those_of_the_finite_pixels() {
        for width in [1usize, 15, 16, 17, 40] {
            let frame = Array2::from_shape_fn((3, width), |(y, x)| (y * 50 + x) as f32 - 7.0);
            let greys = GreyRange::of(frame.view());
            let most = (100 + width) as f32 - 8.0;
            assert_eq!(greys.extremes, Some([-7.0, most]));
            assert!(greys.stay_within(1.0, f32::MAX) && !greys.stay_within(f32::MAX, f32::MAX));
            assert_eq!(greys, GreyRange::of(frame.slice(s![.., ..;-1])));
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut frame = frame.clone();
                frame[(1, width / 2)] = bad;
                let greys = GreyRange::of(frame.view());
                assert_eq!(greys.extremes, Some([-7.0, most]));
                assert!(!greys.stay_within(1.0, f32::MAX));
            }
        }
        let nothing = GreyRange::of(Array2::from_elem((2, 5), f32::NAN).view());
        assert_eq!((nothing.extremes, nothing.scale()), (None, 1.0));
        assert!(!nothing.stay_within(1.0, f32::MAX));
        let bytes = Array2::from_shape_fn((4, 9), |(y, x)| (y * 9 + x) as u8);
        assert_eq!(GreyRange::of(bytes.view()).extremes, Some([0.0, 35.0]));
    }
}
