"""The ways of things as the picture at hand would show them: the camera's motion takes them along."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ...segmentation.result import MotionSegmentation

    F64 = NDArray[np.float64]

__all__ = ["Paths"]

# Places of a thing that are kept, and for how many frames after it was last seen.
_PLACES, _LINGERS = 150, 45
# The determinant of a motion that turns the picture into nothing.
_LEAST_SCALE = 1e-9


class Paths:
    """Where each thing was in the last frames.

    Examples
    --------
    >>> import rsflow
    >>> segmenter, paths = rsflow.MotionSegmenter(camera_motion="moving"), Paths()
    >>> for frame in rsflow.synthetic.flight_with_object(frames=6):
    ...     paths.follow(segmenter.update(frame.image))
    >>> {number: len(path) > 1 for number, path in paths.shown().items()}
    {1: True}
    """

    def __init__(self) -> None:
        self._paths: dict[int, deque[F64]] = {}
        self._missed: dict[int, int] = {}
        # From the picture in which the paths are kept to the one at hand.
        self._motion: F64 = np.eye(3)

    def follow(self, seen: MotionSegmentation) -> None:
        """Take what a frame shows."""
        if self._paths:
            self._motion = np.asarray(seen.camera_motion, np.float64) @ self._motion
        elif len(seen.objects):
            self._motion = np.eye(3)
        if not self._paths and not seen.objects:
            return
        for number in list(self._missed):
            self._missed[number] += 1
            if self._missed[number] > _LINGERS:
                del self._missed[number], self._paths[number]
        if seen.objects:
            if not abs(np.linalg.det(self._motion)) > _LEAST_SCALE:
                # No camera's motion: what was drawn so far cannot be carried on.
                self._paths.clear()
                self._missed.clear()
                self._motion = np.eye(3)
            back = np.asarray(np.linalg.inv(self._motion), np.float64)
            places = _mapped(np.array([(thing.x, thing.y) for thing in seen.objects], np.float64), back)
            for thing, place in zip(seen.objects, places, strict=True):
                self._paths.setdefault(thing.id, deque(maxlen=_PLACES)).append(place)
                self._missed[thing.id] = 0

    def shown(self) -> dict[int, F64]:
        """Give the path of each thing, (n, 2), in the picture at hand; of two places at least."""
        found = {number: np.array(path) for number, path in self._paths.items() if len(path) > 1}
        return {
            number: places[np.isfinite(places).all(axis=1)]
            for number, path in found.items()
            if len(places := _mapped(path, self._motion)) > 1
        }


def _mapped(points: F64, motion: F64) -> F64:
    x, y, w = motion @ np.vstack([points.T, np.ones(len(points))])
    with np.errstate(divide="ignore", invalid="ignore"):
        out: F64 = np.stack([x / w, y / w], axis=1)
    return out
