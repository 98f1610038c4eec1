//! How two planes lie to each other, and where in the window a pixel is.

use std::ops::Range;

use super::filters::RADIUS;
use crate::frame::Plane;

/// Two planes, and how they lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair<'a> {
    pub(super) prev: &'a Plane,
    pub(super) next: &'a Plane,
    /// 1 where a pixel may be used, 0 where not; the sizes are those of the planes.
    pub(super) prev_weight: Option<&'a Plane>,
    pub(super) next_weight: Option<&'a Plane>,
    /// Where `next` begins, in pixels of `prev`.
    pub(super) origin: [isize; 2],
    /// The pixels of `prev` that may be used.
    pub(super) window: [(usize, usize); 2],
}

impl Pair<'_> {
    /// The pixels of `prev`, along one axis, that both planes show with room for the taps.
    pub(super) fn overlap(&self, axis: usize, shift: isize) -> Range<usize> {
        let (prev, next) = if axis == 0 {
            (self.prev.width(), self.next.width())
        } else {
            (self.prev.height(), self.next.height())
        };
        let radius = RADIUS as isize;
        let offset = shift - self.origin[axis];
        let (low, high) = self.window[axis];
        let start = (low as isize).max(radius).max(radius - offset);
        let end = (high as isize)
            .min(prev as isize - radius)
            .min(next as isize - radius - offset);
        start as usize..end.max(start) as usize
    }
}

/// From pixels of the region to the place in the window, -1 to 1, halfway between the two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct WindowAxis {
    start: f64,
    step: f64,
}

impl WindowAxis {
    pub(super) fn new(window: (usize, usize), start: usize, shift: isize) -> Self {
        let middle = (window.0 + window.1) as f64 / 2.0;
        let step = 2.0 / (window.1 - window.0) as f64;
        // Half of the displacement, so that swapping the frames changes nothing.
        Self {
            start: (start as f64 + 0.5 + shift as f64 / 2.0 - middle) * step,
            step,
        }
    }

    /// From one pixel to the next.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// The place of pixel `index` of the region.
    pub(super) fn at(&self, index: usize) -> f64 {
        self.start + self.step * index as f64
    }

    /// The same for a position in pixels, from the border of the first.
    pub(super) fn of(&self, position: f64) -> f64 {
        self.start + self.step * (position - 0.5)
    }
}
