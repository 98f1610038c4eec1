"""Points of a clip followed from each frame to the next, kept as pixels until the camera is known."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..capture import Frame
from ..errors import OptionError, ShapeError
from ..tracking import detect_corners, track_points

__all__ = ["Pair", "follow", "follow_clip"]

F64 = NDArray[np.float64]

# Corners a frame: more cost time and say the same again, since their windows overlap.
_CORNERS = 200
# Deviation in pixels that sampling and quantisation leave in a point and that its own covariance does not show.
_FLOOR_PX = 0.02
# Fewer points than this do not show which of them are wrong.
LEAST_POINTS = 12


@dataclass(frozen=True, eq=False)
class Pair:
    """Points of two successive frames.

    Attributes
    ----------
    start_s, stop_s : float
        Times of the frames.
    before, after : (N, 2) float64
        Pixels as taken.
    std_px : (N,) float64
        Of each displacement, along one axis.
    """

    start_s: float
    stop_s: float
    before: F64
    after: F64
    std_px: F64

    @property
    def dt_s(self) -> float:
        """Time between the frames."""
        return self.stop_s - self.start_s


def follow(
    prev: NDArray[Any],
    after: NDArray[Any],
    mask: NDArray[np.bool_] | None = None,
    *,
    corners: int = _CORNERS,
    initial: Any = None,
) -> tuple[F64, F64, F64]:
    """Follow corners of one frame into another: pixels before and after (N, 2), and deviations (N,)."""
    window = int(np.clip((min(prev.shape) // 5) | 1, 9, 21))
    points = detect_corners(prev, max_corners=corners, quality=0.002, min_distance=max(6, window // 2), mask=mask)
    if len(points) == 0:
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    start = None if initial is None else initial(points.astype(np.float64)).astype(np.float32)
    tracks = track_points(prev, after, points, window_size=window, mask=mask, next_mask=mask, initial=start)
    good = tracks.valid
    variance = np.trace(tracks.covariance[good].astype(np.float64), axis1=1, axis2=2) / 2
    return (
        points[good].astype(np.float64),
        tracks.points[good].astype(np.float64),
        np.sqrt(variance + _FLOOR_PX**2),
    )


def follow_clip(
    clip: Iterable[Frame], mask: NDArray[np.bool_] | None = None
) -> tuple[list[Pair], tuple[int, int], int]:
    """Follow points through a clip; pairs with enough of them, (width, height), and how many frames there were."""
    pairs: list[Pair] = []
    previous: Frame | None = None
    count = 0
    size = (0, 0)
    for frame in clip:
        count += 1
        if not np.isfinite(frame.t_s):
            raise OptionError("source: got frames without times, expected times or a frame rate")
        if previous is None:
            size = (frame.image.shape[1], frame.image.shape[0])
            if mask is not None:
                _checks.mask("mask", mask, frame.image.shape[:2])
        elif frame.image.shape != previous.image.shape:
            got, expected = frame.image.shape, previous.image.shape
            raise ShapeError(f"source: got a frame of shape {got}, expected that of the frame before, {expected}")
        elif frame.t_s > previous.t_s:
            before, after, std = follow(previous.image, frame.image, mask)
            if len(before) >= LEAST_POINTS:
                pairs.append(Pair(previous.t_s, frame.t_s, before, after, std))
        previous = frame
    return pairs, size, count
