//! The masks that a caller gives.

use ndarray::ArrayView2;

use crate::error::Result;
use crate::frame::expect_size;

/// Which pixels of both frames may be used: true where one counts.
///
/// A pixel is used where it counts and where its target does. An overlay that is fixed to the sensor is given as both.
///
/// ```
/// use lk_core::Masks;
/// use ndarray::Array2;
///
/// let mut keep = Array2::from_elem((48, 64), true);
/// keep.slice_mut(ndarray::s![..8, ..]).fill(false);
/// let fixed = Masks::default().prev(keep.view()).next(keep.view());
/// assert!(fixed.of_prev().is_some() && Masks::default().of_next().is_none());
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct Masks<'a> {
    prev: Option<ArrayView2<'a, bool>>,
    next: Option<ArrayView2<'a, bool>>,
}

impl<'a> Masks<'a> {
    /// Those of `prev` that count.
    #[must_use]
    pub fn prev(self, mask: impl Into<Option<ArrayView2<'a, bool>>>) -> Self {
        Self {
            prev: mask.into(),
            ..self
        }
    }

    /// Those of `next` that count.
    #[must_use]
    pub fn next(self, mask: impl Into<Option<ArrayView2<'a, bool>>>) -> Self {
        Self {
            next: mask.into(),
            ..self
        }
    }

    /// The mask of `prev`.
    #[must_use]
    pub fn of_prev(&self) -> Option<ArrayView2<'a, bool>> {
        self.prev
    }

    /// The mask of `next`.
    #[must_use]
    pub fn of_next(&self) -> Option<ArrayView2<'a, bool>> {
        self.next
    }

    /// Hold both to the (rows, columns) of the frames.
    pub(crate) fn expect_size(&self, frames: (usize, usize)) -> Result<()> {
        for (name, mask) in [("mask", self.prev), ("next_mask", self.next)] {
            if let Some(mask) = mask {
                expect_size(name, mask.dim(), "the frames", frames)?;
            }
        }
        Ok(())
    }
}
