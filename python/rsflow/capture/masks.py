"""Masks of the pixels that count: from a picture file, held to a size, and pictures filled where nothing counts."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks
from ..errors import CaptureError, ShapeError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]

__all__ = ["FixedMask", "expect_size", "mask_of_frames", "read_mask", "share"]


def read_mask(path: str | os.PathLike[str]) -> Mask:
    """Read a mask from a picture: True where it is not black in every channel.

    Raises
    ------
    CaptureError
        If the file cannot be read as one picture.
    """
    from ..io.limits import max_pixels_of
    from .pages import PictureFile

    if not Path(path).exists():
        raise CaptureError(f"{os.fspath(path)}: no such file or folder")
    file = PictureFile(Path(path), max_pixels_of(None))
    file.expect_one()
    picture = file.picture()
    # Alpha says nothing of light.
    bright = picture > 0 if picture.ndim == 2 else (picture[..., :3] > 0).any(axis=2)
    return np.asarray(bright, np.bool_)


def expect_size(name: str, mask: Mask, size: tuple[int, int] | None, of: str = "the frames") -> None:
    """Raise ShapeError where a mask has not the width and height of what it is of; None is not known yet."""
    height, width = mask.shape
    if size is not None and size != (width, height):
        raise ShapeError(f"{name}: got {width} x {height} pixels, expected those of {of}, {size[0]} x {size[1]}")


def mask_of_frames(
    mask: Mask | str | os.PathLike[str] | None, stream: Any, roi: tuple[int, int, int, int] | None
) -> Mask | None:
    """Give which pixels of the frames of `stream` count, from a mask of its whole pictures; None where all do."""
    if mask is None:
        return None
    name, pixels = ("mask", mask) if isinstance(mask, np.ndarray) else (f"mask {os.fspath(mask)}", read_mask(mask))
    expect_size(name, pixels, stream.source_size, "the pictures")
    if roi is None:
        return pixels.copy()
    x, y, width, height = roi
    return pixels[y : y + height, x : x + width].copy()


def share(where: Mask, mask: Mask | None) -> float:
    """Share of the pixels that count at which `where` holds."""
    among = where.size if mask is None else np.count_nonzero(mask)
    return float(np.count_nonzero(where)) / max(among, 1)


class FixedMask:
    """Pixels that count in every frame of a sensor, and how a picture is filled where they do not.

    Parameters
    ----------
    mask : (H, W) bool
        True where a pixel counts; copied.

    Examples
    --------
    >>> picture = np.array([[1, 2, 99, 4]], np.float32)
    >>> FixedMask(np.array([[True, True, False, True]])).fill(picture)
    >>> float(picture[0, 2]) in (2.0, 4.0)
    True
    """

    def __init__(self, mask: Mask) -> None:
        self.pixels: Mask = np.array(mask, order="C")
        self.pixels.flags.writeable = False
        holes = np.flatnonzero(~self.pixels)
        self._holes: NDArray[np.intp] = holes
        self._nearest: NDArray[np.intp] | None = None
        if 0 < len(holes) < mask.size:
            import cv2

            _, labels = cv2.distanceTransformWithLabels(
                (~self.pixels).view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
            )
            # Each pixel that counts has a label of its own.
            place = np.zeros(int(labels.max()) + 1, np.intp)
            counting = np.flatnonzero(self.pixels)
            flat = labels.reshape(-1)
            place[flat[counting]] = counting
            self._nearest = place[flat[holes]]

    def fill(self, picture: NDArray[Any]) -> None:
        """Give each pixel that does not count the value of the nearest one that does: nothing depends on it then."""
        flat = picture.reshape(-1)
        flat[self._holes] = 0 if self._nearest is None else flat[self._nearest]

    def filled(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Give a copy of a picture, filled."""
        copy = np.array(picture, order="C")
        self.fill(copy)
        return copy

    def expect_shape(self, shape: tuple[int, ...]) -> None:
        """Raise ShapeError where a frame has another shape."""
        _checks.mask("mask", self.pixels, shape)
