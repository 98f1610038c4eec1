"""How far each thing went by its own picture: samples of it are laid over the next frame.

Dense flow inside of a small thing is often that of the ground around it. Samples that lie on the thing alone, begun
from where it is expected, are not drawn to the ground.

docs/explanation/algorithms.md, section "Things that move: ObjectTracker".
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import _core

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .followed import Followed
    from .regions_seen import Regions

    F64 = NDArray[np.float64]


@dataclasses.dataclass
class Ridden:
    """What the pictures of the things say of a frame; NaN and infinite variance where they say nothing.

    Attributes
    ----------
    motion, variance : (n, 2) float64
        Since the frame before, against the still surroundings, in pixels.
    contrast : (n,) float64
        Deviation of its levels, or root of the mean square of what they are off at rest if that is larger.
    """

    motion: F64
    variance: F64
    contrast: F64


def smoothed(image: NDArray[Any]) -> NDArray[Any]:
    """Give a frame in levels of 256, lightly smoothed, with what is not finite as 0."""
    import cv2

    if image.dtype == np.uint8:
        return np.asarray(cv2.GaussianBlur(image, (5, 5), 1.0))
    levels = np.nan_to_num(np.asarray(image, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    if image.dtype == np.uint16:
        levels = levels / np.float32(257)
    return np.asarray(cv2.GaussianBlur(levels, (5, 5), 1.0), np.float32)


def ride(
    things: Followed,
    regions: Regions,
    region: NDArray[np.intp],
    levels: NDArray[Any] | None,
    mask: NDArray[np.bool_],
    steps: float,
) -> Ridden:
    """Lay the samples of each thing over the frame at hand.

    `region` is that of each thing, -1 for none. The things are where they are predicted.
    """
    count = len(things)
    if levels is None or not count:
        return Ridden(np.full((count, 2), np.nan), np.full((count, 2), np.inf), np.zeros(count))
    starts = _starts(things, regions, region, steps)
    sizes = things.size.max(axis=1)
    return Ridden(*_core.ride(things.patch, starts, sizes, levels, mask))


def _starts(things: Followed, regions: Regions, region: NDArray[np.intp], steps: float) -> F64:
    """Give motions of each thing to begin from, (n, 4, 2): predicted, none, to its region, by the flow in that."""
    predicted = things.velocity * steps
    starts = np.zeros((len(things), 4, 2))
    starts[:, 0] = starts[:, 2] = starts[:, 3] = predicted
    has = np.flatnonzero(region >= 0)
    if len(has):
        own = region[has]
        starts[has, 2] = regions.centre[own] - (things.place[has] - predicted[has])
        flow = regions.motion[own]
        starts[has, 3] = np.where(np.isfinite(flow), flow, predicted[has])
    return starts


def go_along(things: Followed, ridden: Ridden, shift: F64) -> None:
    """Take the samples to where they are now; `shift` is how far things have gone whose samples do not say."""
    moved = np.where(np.isfinite(ridden.motion), ridden.motion, shift)
    things.patch[:, :, 1] += moved[:, :1]
    things.patch[:, :, 2] += moved[:, 1:]
