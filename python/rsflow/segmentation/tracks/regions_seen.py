"""What a frame's mask shows: its regions, with the motion and the grey levels in them."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import _core

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F64 = NDArray[np.float64]

# Samples of a region, and bins of their grey levels.
SAMPLES, BINS = 256, 16


@dataclasses.dataclass
class Regions:
    """The regions of a mask, in the order of their first pixels.

    Attributes
    ----------
    labels : (height, width) int32
        The region at each pixel, from 1, 0 where there is none that is large enough.
    label : (n,) int
        The label of each region.
    box : (n, 4) float64
        Left, top, right and bottom of its pixels, the last two beyond it.
    area : (n,) float64
    centre : (n, 2) float64
        Of its pixels.
    motion : (n, 2) float64
        Median of the motion in it, NaN where less than 30 % of it is known.
    motion_variance : (n, 2) float64
        Variance of that median.
    histogram : (n, 16) float64
        Shares of its grey levels; all zero without a picture.
    picture : (n, 256, 6) float32
        Samples of its picture, as `Followed.patch` has them; all zero without one.
    image : (height, width) array or None
        The frame.
    """

    labels: NDArray[np.int32]
    label: NDArray[np.intp]
    box: F64
    area: F64
    centre: F64
    motion: F64
    motion_variance: F64
    histogram: F64
    picture: NDArray[np.float32]
    image: NDArray[Any] | None

    def __len__(self) -> int:
        return len(self.label)

    @property
    def size(self) -> F64:
        """Width and height of each box, (n, 2)."""
        return self.box[:, 2:] - self.box[:, :2]


def observe(
    mask: NDArray[np.bool_],
    motion: NDArray[np.floating] | None,
    image: NDArray[Any] | None,
    min_area: int,
    levels: NDArray[Any] | None = None,
) -> Regions:
    """Take a mask apart into its regions of at least `min_area` pixels; `levels` is the frame smoothed."""
    vectors = None if motion is None else np.ascontiguousarray(motion, np.float32)
    labels, (box, area, centre), (medians, variance), shares, picture = _core.observe_regions(
        mask, min_area, vectors, image, levels
    )
    label = np.arange(1, len(area) + 1)
    return Regions(labels, label, box, area, centre, medians, variance, shares, picture, image)


def histograms(grey: NDArray[Any], inside: NDArray[np.bool_]) -> F64:
    """Shares of grey levels in each row, of those `inside`."""
    dtype = grey.dtype
    if dtype == np.uint8:
        bins = (grey >> 4).astype(np.intp)
    else:
        levels = np.nan_to_num(grey.astype(np.float64))
        top = 65536.0 if dtype == np.uint16 else 256.0
        bins = np.clip(levels * (BINS / top), 0, BINS - 1).astype(np.intp)
    row = np.arange(len(grey))[:, None] * BINS
    total = np.bincount((row + bins)[inside], minlength=len(grey) * BINS).reshape(-1, BINS).astype(np.float64)
    out: F64 = total / np.maximum(total.sum(axis=1, keepdims=True), 1)
    return out
