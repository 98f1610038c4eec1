"""What is measured: the calls of rsflow and of OpenCV, and how to read the motion from what they give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..flow import dense_flow
from ..shift import estimate_shift
from ..tracking import track_points

__all__ = ["Method", "dense_methods", "point_methods", "shift_methods"]

Array = NDArray[Any]


@dataclass(frozen=True)
class Method:
    """A call to time, and how to read the motion from its result; NaN where it says that it has none."""

    name: str
    call: Callable[[Array, Array], Any]
    motion: Callable[[Any], Array]


def dense_methods() -> list[Method]:
    """Give what computes dense flow."""
    import cv2

    # Every pixel counts, whether `valid` or not: OpenCV has no such mask, and the same pixels must be compared.
    methods = [
        Method(f"rsflow dense_flow, {preset}", partial(dense_flow, preset=preset), np.asarray)
        for preset in ("fast", "balanced", "accurate")
    ]
    for preset in ("ultrafast", "fast", "medium"):
        number = getattr(cv2, f"DISOPTICAL_FLOW_PRESET_{preset.upper()}", None)
        number = getattr(cv2, f"DISOpticalFlow_PRESET_{preset.upper()}", number)
        if number is not None and hasattr(cv2, "DISOpticalFlow_create"):
            # Made once: it keeps its memory from call to call.
            dis: Any = cv2.DISOpticalFlow_create(number)
            methods.append(Method(f"OpenCV DIS, {preset}", partial(_dis, dis), np.asarray))
    if hasattr(cv2, "calcOpticalFlowFarneback"):
        methods.append(Method("OpenCV Farneback", _farneback, np.asarray))
    return methods


def _dis(dis: Any, prev: Array, after: Array) -> Any:
    return dis.calc(prev, after, None)


def _farneback(prev: Array, after: Array) -> Any:
    import cv2

    # The settings of OpenCV's own sample: pyramid of halves, 3 levels, window 15, 3 iterations, polynomials of 5.
    empty: Any = None
    return cv2.calcOpticalFlowFarneback(prev, after, empty, 0.5, 3, 15, 3, 5, 1.2, 0)


def point_methods(points: Array) -> list[Method]:
    """Give what tracks `points`."""
    import cv2

    def ours(tracks: Any) -> Array:
        return np.where(tracks.valid[:, None], tracks.points - points, np.nan)

    def track(prev: Array, after: Array) -> Any:
        return track_points(prev, after, points)

    def lean(prev: Array, after: Array) -> Any:
        return track_points(prev, after, points, max_forward_backward=None, illumination="none")

    def opencv(prev: Array, after: Array) -> Any:
        empty: Any = None
        return cv2.calcOpticalFlowPyrLK(prev, after, points, empty)

    def theirs(found: Any) -> Array:
        return np.where(found[1].reshape(-1, 1) == 1, found[0] - points, np.nan)

    return [
        Method("rsflow track_points", track, ours),
        Method("rsflow track_points, steady light, no check back", lean, ours),
        Method("OpenCV calcOpticalFlowPyrLK", opencv, theirs),
    ]


def shift_methods(size: tuple[int, int]) -> list[Method]:
    """Give what finds one displacement of a window of `size`."""
    import cv2

    hann = cv2.createHanningWindow(size, cv2.CV_32F)

    def opencv(prev: Array, after: Array) -> Any:
        # It takes floats alone, so that the conversion is part of its time.
        return cv2.phaseCorrelate(prev.astype(np.float32), after.astype(np.float32), hann)

    return [
        Method("rsflow estimate_shift", estimate_shift, lambda shift: np.array([[shift.dx, shift.dy]])),
        Method("OpenCV phaseCorrelate, Hann window", opencv, lambda found: np.array([found[0]])),
    ]
