//! A frame, ready to be compared.

use ndarray::ArrayView2;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane, scale_by};
use crate::grey::GreyRange;
use crate::presmooth;
use crate::pyramid::Pyramid;

use super::gaps;
use super::hot_pixels::greys_without;

/// A frame's pyramid, without what is masked or not finite.
#[derive(Debug, Default)]
pub(super) struct Source {
    /// Its grey levels are those of the frame times `scale`.
    pub(super) pyramid: Pyramid,
    pub(super) scale: f32,
    /// Of the pixels that count, as they came.
    pub(super) greys: GreyRange,
    /// 1 where the frame is finite and not masked; of no size where it is everywhere.
    pub(super) counts: Plane,
    /// The frame as it came, where it may be read once more with another mask; else of no size.
    pub(super) raw: Plane,
}

/// How a frame is read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading<'a> {
    pub(super) levels: usize,
    /// The side tap of the smoothing.
    pub(super) side: f32,
    /// False where the frame counts for nothing.
    pub(super) mask: Option<ArrayView2<'a, bool>>,
}

impl Source {
    /// Read `frame`, whose grey levels are `greys`, times `scale`.
    pub(super) fn read<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        (greys, scale): (GreyRange, f32),
        Reading { levels, side, mask }: Reading<'_>,
        execution: &Execution,
    ) -> Result<()> {
        (self.greys, self.scale) = (greys, scale);
        self.counts.resize(0, 0)?;
        self.raw.resize(0, 0)?;
        if mask.is_none() && greys.stay_within(scale, gaps::LARGEST) {
            return self
                .pyramid
                .rebuild_smoothed(frame, levels, (scale, side), execution);
        }
        // What does not count is filled before it can spread.
        let (height, width) = frame.dim();
        self.pyramid.resize([width, height], levels)?;
        let finest = &mut self.pyramid.levels_mut()[0];
        finest.copy_scaled(frame, scale, execution)?;
        if let Some(mask) = mask {
            gaps::cut(finest, mask);
        }
        if let Some(limits) = greys.limits() {
            gaps::cut_beyond(finest, limits.map(|limit| limit * scale));
        }
        gaps::fill(finest, &mut self.counts)?;
        presmooth::smooth(finest, side, execution)?;
        self.pyramid.reduce_again(execution)
    }

    /// Keep `frame`, which was read, as it came.
    pub(super) fn keep<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        execution: &Execution,
    ) -> Result<()> {
        self.raw.copy_scaled(frame, 1.0, execution)
    }

    /// Read the frame once more, if it was kept and another mask changes what counts of it.
    pub(super) fn mask_anew(&mut self, reading: Reading<'_>, execution: &Execution) -> Result<()> {
        if self.raw.width() == 0 || self.counts_as(reading.mask) {
            return Ok(());
        }
        let raw = std::mem::take(&mut self.raw);
        let view = ArrayView2::from_shape((raw.height(), raw.width()), raw.data())
            .map_err(|error| Error::shape("frame", error.to_string(), "a whole plane"))?;
        let greys = greys_without(view, reading.mask);
        self.read(view, (greys, greys.scale()), reading, execution)?;
        self.raw = raw;
        Ok(())
    }

    /// Whether the frame that was kept counts where `mask` and its grey levels say.
    fn counts_as(&self, mask: Option<ArrayView2<'_, bool>>) -> bool {
        let (width, height) = (self.raw.width(), self.raw.height());
        (0..height).all(|y| {
            let counts = (self.counts.width() > 0).then(|| self.counts.row(y));
            let raw = self.raw.row(y);
            (0..width).all(|x| {
                let has = counts.is_none_or(|counts| counts[x] > 0.0);
                let is_level = gaps::is_level(raw[x] * self.scale)
                    && self
                        .greys
                        .limits()
                        .is_none_or(|[low, high]| (low..=high).contains(&raw[x]));
                has == (is_level && mask.is_none_or(|mask| mask[(y, x)]))
            })
        })
    }

    /// Take another scale: that of a frame that was the second of a pair and is now the first.
    pub(super) fn rescale(&mut self, scale: f32) {
        if scale == self.scale {
            return;
        }
        for plane in self.pyramid.levels_mut() {
            // Two factors: their product may be no `f32`.
            scale_by(plane.data_mut(), self.scale.recip());
            scale_by(plane.data_mut(), scale);
        }
        self.scale = scale;
    }
}
