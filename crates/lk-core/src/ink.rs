//! Lines laid over a picture in colour.

use ndarray::{ArrayView2, ArrayViewMut3};

use crate::error::{Error, Result};

/// A rim takes so many twentieths of the light away.
const RIM: u32 = 17;

/// Lines that are laid over a picture, as shares of 255 for each of its pixels.
#[derive(Debug, Clone, Copy)]
pub struct Ink<'a> {
    /// How much of a pixel a line covers.
    pub ink: ArrayView2<'a, u8>,
    /// How much of it a dark rim beside the lines does.
    pub rim: ArrayView2<'a, u8>,
    /// Whose colour it has; the first by default.
    pub which: Option<ArrayView2<'a, u8>>,
    /// The colours, in the order of the picture's channels.
    pub colors: &'a [[u8; 3]],
}

/// Lay lines over a picture, `(height, width, 3)`, in place.
///
/// # Errors
///
/// [`Error::Shape`] if the sizes do not fit together, there is no colour, or one that is asked for is not there.
///
/// ```
/// use lk_core::{Ink, lay_ink};
/// use ndarray::{Array3, array};
///
/// let mut picture = Array3::from_elem((1, 3, 3), 100);
/// let (ink, rim) = (array![[255, 51, 0]], array![[255, 255, 0]]);
/// let lines = Ink { ink: ink.view(), rim: rim.view(), which: None, colors: &[[0, 200, 255]] };
/// lay_ink(picture.view_mut(), lines)?;
/// assert_eq!(picture.as_slice(), Some(&[0, 200, 255, 15, 55, 66, 100, 100, 100][..]));
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn lay_ink(mut picture: ArrayViewMut3<'_, u8>, lines: Ink<'_>) -> Result<()> {
    let (height, width, channels) = picture.dim();
    let fits = |plane: ArrayView2<'_, u8>| plane.dim() == (height, width);
    let whole = channels == 3 && fits(lines.ink) && fits(lines.rim) && lines.which.is_none_or(fits);
    if !whole {
        let got = format!("{:?} and {:?}", lines.ink.dim(), lines.rim.dim());
        return Err(Error::shape("lines", got, format!("{:?}", (height, width))));
    }
    for y in 0..height {
        for x in 0..width {
            let (ink, rim) = (u32::from(lines.ink[(y, x)]), u32::from(lines.rim[(y, x)]));
            if ink | rim == 0 {
                continue;
            }
            let which = lines.which.map_or(0, |which| usize::from(which[(y, x)]));
            let Some(color) = lines.colors.get(which) else {
                let got = format!("{}, and number {which}", lines.colors.len());
                return Err(Error::shape(
                    "colors",
                    got,
                    "one for each that is asked for",
                ));
            };
            let kept = (255 - ink).min((20 * 255 - RIM * rim) / 20);
            for (channel, color) in color.iter().enumerate() {
                let below = u32::from(picture[(y, x, channel)]);
                let mixed = share(below, kept) + share(u32::from(*color), ink);
                picture[(y, x, channel)] = mixed.min(255) as u8;
            }
        }
    }
    Ok(())
}

/// A level times a share of 255, rounded.
fn share(level: u32, share: u32) -> u32 {
    (level * share + 127) / 255
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_no_line_covers_stays(ink in 0u8..=255, rim in 0u8..=255, level in 0u8..=255, color in 0u8..=255) {
            let plane = |value| Array2::from_shape_fn((2, 3), |(y, _)| if y == 0 { value } else { 0 });
            let (inks, rims) = (plane(ink), plane(rim));
            let which = Array2::from_elem((2, 3), 1);
            let lines = Ink {
                ink: inks.view(), rim: rims.view(), which: Some(which.view()), colors: &[[1; 3], [color; 3]],
            };
            let mut picture = Array3::from_elem((2, 3, 3), level);
            lay_ink(picture.view_mut(), lines).unwrap();
            prop_assert_eq!(picture[(1, 2, 0)], level);
            let beside = (f64::from(255 - ink)).min((255.0 - 0.85 * f64::from(rim)).floor());
            let want = (f64::from(level) * beside + f64::from(color) * f64::from(ink)) / 255.0;
            prop_assert!((f64::from(picture[(0, 1, 2)]) - want.min(255.0)).abs() < 2.1);
        }
    }

    #[test]
    fn sizes_and_colors_that_are_not_there_are_told() {
        let (small, large) = (Array2::from_elem((2, 2), 9), Array2::from_elem((2, 3), 9));
        let mut picture = Array3::from_elem((2, 3, 3), 0);
        let lines = |ink| Ink {
            ink,
            rim: large.view(),
            which: None,
            colors: &[[0; 3]],
        };
        assert!(lay_ink(picture.view_mut(), lines(small.view())).is_err());
        let none = Ink {
            colors: &[],
            ..lines(large.view())
        };
        assert!(lay_ink(picture.view_mut(), none).is_err());
        assert!(lay_ink(picture.view_mut(), lines(large.view())).is_ok());
        let mut grey = Array3::from_elem((2, 3, 1), 0);
        assert!(lay_ink(grey.view_mut(), lines(large.view())).is_err());
    }
}
