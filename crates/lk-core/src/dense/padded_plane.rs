//! Planes whose rows have room on both sides, so that sixteen lanes may start anywhere and reach over the border.

use crate::error::Result;
use crate::memory::resize;
use crate::parallel::RowsMut;
use crate::simd::LANES;

/// Elements before the first and at least as many after the last pixel of a row.
pub(super) const PAD: usize = LANES;

/// From one padded row of `width` pixels to the next: room for a whole number of pairs of lanes.
pub(super) fn stride(width: usize) -> usize {
    width.next_multiple_of(2 * LANES) + 2 * PAD
}

/// Groups of lanes that hold a row of `width` pixels.
pub(super) fn groups(width: usize) -> usize {
    width.div_ceil(LANES)
}

/// Rows of `f32` with room on both sides; what stands there is up to whoever wrote the row.
#[derive(Debug, Default)]
pub(super) struct PaddedPlane {
    width: usize,
    height: usize,
    stride: usize,
    data: Vec<f32>,
}

impl PaddedPlane {
    /// Take a new size and keep the memory; the content is unspecified afterwards.
    pub(super) fn resize(&mut self, width: usize, height: usize) -> Result<()> {
        let stride = stride(width);
        let size = stride.saturating_mul(height);
        if self.data.len() < size {
            resize("values of dense flow", &mut self.data, size, 0.0)?;
        }
        (self.width, self.height, self.stride) = (width, height, stride);
        Ok(())
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    pub(super) fn height(&self) -> usize {
        self.height
    }

    /// Row `y` with its room.
    #[inline(always)]
    pub(super) fn padded(&self, y: usize) -> &[f32] {
        &self.data[y * self.stride..(y + 1) * self.stride]
    }

    /// Row `y`.
    #[inline(always)]
    pub(super) fn row(&self, y: usize) -> &[f32] {
        &self.padded(y)[PAD..PAD + self.width]
    }

    /// Row `y` with its room, to write.
    pub(super) fn padded_mut(&mut self, y: usize) -> &mut [f32] {
        &mut self.data[y * self.stride..(y + 1) * self.stride]
    }

    /// Take size and content of `other`.
    pub(super) fn copy_from(&mut self, other: &Self) -> Result<()> {
        self.resize(other.width, other.height)?;
        let size = self.stride * self.height;
        self.data[..size].copy_from_slice(&other.data[..size]);
        Ok(())
    }

    /// Set every element.
    pub(super) fn fill(&mut self, value: f32) {
        self.data[..self.stride * self.height].fill(value);
    }

    /// All rows with their room, to divide between threads.
    pub(super) fn rows_mut(&mut self) -> RowsMut<'_, f32> {
        RowsMut::new(&mut self.data[..self.stride * self.height], self.stride)
    }
}

/// Repeat the first and the last of `width` pixels into the room of a padded row.
#[inline(always)]
pub(super) fn extend(row: &mut [f32], width: usize) {
    let (first, last) = (row[PAD], row[PAD + width - 1]);
    row[..PAD].fill(first);
    row[PAD + width..].fill(last);
}
