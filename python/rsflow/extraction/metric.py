"""Metres per second: the camera that fits the frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import OptionError

if TYPE_CHECKING:
    from ..camera.model import Camera

__all__ = ["fitting_camera"]


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
