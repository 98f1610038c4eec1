//! What light is fitted to.

use crate::segment::morphology::Size;

/// A picture beside its reference: planes of one size, and which of their pixels tell of light.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair<'a> {
    /// What the picture is held to, of `size` pixels.
    pub(crate) reference: &'a [f32],
    /// The picture.
    pub(crate) image: &'a [f32],
    /// 1 where both show the same still thing, as far as is known, else 0.
    pub(crate) still: &'a [u8],
    /// Columns and rows.
    pub(crate) size: Size,
    /// Grey levels at and beyond which a sensor does not follow: pixels there, of either, tell nothing.
    pub(crate) range: [f32; 2],
}

impl Pair<'_> {
    /// What both have at a pixel that counts.
    pub(super) fn at(&self, index: usize) -> Option<[f32; 2]> {
        let values = [self.reference[index], self.image[index]];
        let inside = |value: f32| value > self.range[0] && value < self.range[1];
        (self.still[index] == 1 && values.into_iter().all(inside)).then_some(values)
    }
}
