//! Where to start points: the corners whose window fixes a displacement best.
//!
//! J. Shi and C. Tomasi, "Good features to track", CVPR 1994: the smaller eigenvalue of the structure tensor, the
//! largest of its 3 x 3 neighbourhood, best first, none closer to a better one than the least distance.
//!
//! `docs/explanation/algorithms.md`, section "Corners: detect_corners".

mod options;
mod response;
mod select;

use ndarray::ArrayView2;

pub use options::{Corner, CornerOptions};

use crate::error::{Error, Result};
use crate::frame::{Frame, Pixel, Plane, expect_size};
use crate::parallel::for_each_band;
use crate::scratch::with_scratch;
use crate::support::Support;
use response::TensorRows;
use select::Selection;

/// Memory that is kept from frame to frame.
#[derive(Debug, Default)]
pub struct CornerDetector {
    plane: Plane,
    support: Support,
    response: Plane,
    selection: Selection,
}

/// The corners of `frame`, the best first; `mask` is true where a pixel counts: a corner is one, and is made of gradients
/// of such pixels alone.
///
/// # Errors
///
/// [`Error::Shape`](crate::Error::Shape) if the mask does not fit; those of [`CornerOptions::validate`] and of the
/// execution.
///
/// ```
/// use lk_core::ndarray::Array2;
/// use lk_core::{CornerOptions, detect_corners};
///
/// // A bright square on dark ground has four.
/// let inside = |at: usize| (20..40).contains(&at);
/// let frame = Array2::from_shape_fn((60, 60), |(y, x)| if inside(x) && inside(y) { 200u8 } else { 20 });
/// let corners = detect_corners(frame.view(), None, &CornerOptions::default())?;
/// assert_eq!(corners.len(), 4);
/// let [x, y] = corners[0].position;
/// assert!((x - 19.5).abs().min((x - 39.5).abs()) < 1.5 && (y - 19.5).abs().min((y - 39.5).abs()) < 1.5);
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn detect_corners<T: Pixel>(
    frame: Frame<'_, T>,
    mask: Option<ArrayView2<'_, bool>>,
    options: &CornerOptions,
) -> Result<Vec<Corner>> {
    let mut corners = Vec::new();
    CornerDetector::default().detect(frame, mask, options, &mut corners)?;
    Ok(corners)
}

impl CornerDetector {
    /// The same as [`detect_corners`]; `corners` is replaced.
    ///
    /// # Errors
    ///
    /// Those of [`detect_corners`].
    pub fn detect<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        mask: Option<ArrayView2<'_, bool>>,
        options: &CornerOptions,
        corners: &mut Vec<Corner>,
    ) -> Result<()> {
        options.validate()?;
        if let Some(mask) = mask {
            expect_size("mask", mask.dim(), "the frame", frame.dim())?;
        }
        let mut plane = std::mem::take(&mut self.plane);
        let copied = plane.copy_from(frame, &options.execution);
        let mut support = std::mem::take(&mut self.support);
        let taken = copied.and_then(|()| support.take_present(frame, mask, &options.execution));
        let result = taken.and_then(|()| {
            let support = (!options.mask_corners_only).then_some(&support);
            self.detect_where(&plane, support, mask, options, corners)
        });
        (self.plane, self.support) = (plane, support);
        if result.as_ref().is_err_and(Error::is_memory) {
            *self = Self::default();
        }
        result
    }

    /// Make room for so many local maxima of the response.
    pub(crate) fn reserve(&mut self, maxima: usize) -> Result<()> {
        self.selection.reserve(maxima)
    }

    /// The same on a plane, such as the finest level of a pyramid.
    ///
    /// # Errors
    ///
    /// Those of [`detect_corners`].
    pub fn detect_in(
        &mut self,
        plane: &Plane,
        mask: Option<ArrayView2<'_, bool>>,
        options: &CornerOptions,
        corners: &mut Vec<Corner>,
    ) -> Result<()> {
        self.detect_where(plane, None, mask, options, corners)
    }

    /// The same with gradients of the pixels of `support` alone.
    pub(crate) fn detect_where(
        &mut self,
        plane: &Plane,
        support: Option<&Support>,
        mask: Option<ArrayView2<'_, bool>>,
        options: &CornerOptions,
        corners: &mut Vec<Corner>,
    ) -> Result<()> {
        options.validate()?;
        corners.clear();
        let (width, height) = (plane.width(), plane.height());
        if let Some(mask) = mask {
            expect_size("mask", mask.dim(), "the frame", (height, width))?;
        }
        if width < 3 || height < 3 {
            return Ok(());
        }
        self.respond(plane, support, options)?;
        self.selection
            .choose(&self.response, mask, options, corners)
    }

    /// Fill the response of every pixel.
    fn respond(
        &mut self,
        plane: &Plane,
        support: Option<&Support>,
        options: &CornerOptions,
    ) -> Result<()> {
        let (width, height) = (plane.width(), plane.height());
        self.response.resize(width, height)?;
        // A row costs some 30 operations a pixel; this many pixels cost well above what a hand-over does.
        let min_rows = (16_384 / width).max(options.block_size);
        for_each_band(
            &options.execution,
            height,
            min_rows,
            self.response.rows_mut(),
            |rows, mut part| {
                with_scratch(TensorRows::room(width, options), |memory| {
                    let mut tensor = TensorRows::new(width, options, support, memory);
                    for (local, y) in rows.enumerate() {
                        tensor.respond(plane, y, part.row_mut(local));
                    }
                })
            },
        )
    }
}
