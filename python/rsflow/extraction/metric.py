"""Metres per second: the camera that fits the frames, and the height of each."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import OptionError

if TYPE_CHECKING:
    from ..camera.model import Camera
    from ..capture.stream import Frames

__all__ = ["HeightOf", "fitting_camera"]


def fitting_camera(camera: Any, stream: Any, roi: tuple[int, int, int, int] | None) -> tuple[Camera, str]:
    """Give the camera of the frames of `stream`: resized and cropped as they are.

    Parameters
    ----------
    camera : Camera or path
        Of the whole picture, in the size it was calibrated at.
    stream : Frames
        Open, its `source_size` known.
    roi : (x, y, width, height), optional
        What the frames are cropped to.

    Returns
    -------
    camera : Camera
    note : str
        What had to be done, for the report; empty where it fitted as it was.

    Raises
    ------
    OptionError
        If the camera's picture has another shape than the source's: then it is another camera's.
    """
    from ..camera.model import Camera

    size = stream.source_size
    if not isinstance(camera, Camera):
        camera = Camera.load(Path(camera), size=size)
    note = ""
    if size is not None and camera.size != tuple(size):
        width, height = size
        if not _resized(camera.size, (width, height)):
            raise OptionError(
                f"camera: got one that is calibrated at {camera.width} x {camera.height} pixels, expected the shape of "
                f"{stream.source}, {width} x {height}, which cannot be this camera's uncropped picture; where it is "
                "cropped, crop the camera (Camera.cropped) and save it"
            )
        note = f"The camera, calibrated at {camera.width} x {camera.height} pixels, was scaled to {width} x {height}."
        camera = camera.scaled(width, height)
    return (camera if roi is None else camera.cropped(roi)), note


def _resized(old: tuple[int, int], new: tuple[int, int]) -> bool:
    """Say whether a picture of one size can be one of the other resized: its sides as their ratio rounds."""
    if (old[0] == new[0]) != (old[1] == new[1]):
        return False
    return abs(new[1] - old[1] * new[0] / old[0]) < 1.0 or abs(new[0] - old[0] * new[1] / old[1]) < 1.0


class HeightOf:
    """Height over the ground at a frame: constant, or from a CSV (see `rsflow.velocity.Heights`)."""

    def __init__(self, height_m: float | str | os.PathLike[str]) -> None:
        from ..velocity import Heights

        self._path = os.fspath(height_m) if isinstance(height_m, (str, os.PathLike)) else None
        self._constant = math.nan if isinstance(height_m, (str, os.PathLike)) else float(height_m)
        self._heights = Heights.read(self._path) if self._path is not None else None
        self._known = 0
        self._asked: list[tuple[int, float]] = []

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be said of the heights in the CSV."""
        return () if self._heights is None else self._heights.notes

    def at(self, frame: int, t_s: float) -> float:
        """Give the height in metres, NaN where the CSV has none."""
        if self._heights is None:
            return self._constant
        height = self._heights.at(frame=frame, t_s=t_s)
        self._known += math.isfinite(height)
        # The first and the last.
        self._asked = [*self._asked[:1], (frame, t_s)]
        return height

    def counts(self) -> tuple[int, list[tuple[int, float]]]:
        """Give what `go_on` needs."""
        return self._known, self._asked

    def go_on(self, counts: tuple[int, list[tuple[int, float]]]) -> None:
        """Be as after the frames that were counted."""
        self._known, self._asked = counts

    def expect_some(self, stream: Frames) -> None:
        """Raise OptionError where it is plain before the first frame that none of `stream` has a height."""
        count = stream.count
        if self._heights is None or count is None or count == 0:
            return
        keys, taken = self._heights.keys, range(stream._start, stream._start + count * stream._stride, stream._stride)
        # A container's own count and rate may be wrong by some: only what is far off is plain.
        slack = max(10, count // 4)
        if self._heights.by == "frame":
            far = keys[0] > taken[-1] + slack or keys[-1] < taken[0]
        elif stream.frame_rate and stream.timestamps in ("file", "given", "rate"):
            first, last = taken[0] / stream.frame_rate, (taken[-1] + slack) / stream.frame_rate
            far = keys[0] > 2 * last + 1 or keys[-1] < first / 2 - 1
        else:
            return
        if far:
            raise self._error(f"{stream.source} has {count} frames, from {taken[0]} to {taken[-1]}")

    def missed(self) -> OptionError | None:
        """Give the error that frames were asked for and none had a height, or None."""
        if self._heights is None or self._known or not self._asked:
            return None
        (first, begin), (last, end) = self._asked[0], self._asked[-1]
        return self._error(f"the frames from {first} to {last} are at times from {begin:g} to {end:g} s")

    def _error(self, frames: str) -> OptionError:
        assert self._heights is not None
        return OptionError(
            f"height_m: got {self._path} with {self._heights.span}, expected heights of the frames, but {frames}: no "
            "frame has a height"
        )
