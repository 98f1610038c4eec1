"""Masks of the pixels that count: from a picture file or corners, held to a size; pictures filled where none count."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks
from ..errors import CaptureError, OptionError, ShapeError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]

__all__ = ["FixedMask", "expect_size", "mask_of_frames", "polygon_mask", "read_mask", "read_polygon", "share"]

# Corners farther away are a mistake, and more than OpenCV draws.
_FARTHEST_PX = 1e5
# Fractional bits of the corners that OpenCV takes.
_FRACTION = 4
# Of a file of corners.
_MOST_BYTES = 1 << 20


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


def read_polygon(text: str) -> list[tuple[float, float]]:
    """Take the corners of a polygon from numbers, ``x0,y0,x1,y1,x2,y2``, or from a file that has them.

    A JSON file has a list of pairs; any other one a line ``x,y`` for each corner, the first line a header or not.

    Raises
    ------
    CaptureError
        If the file cannot be read.
    OptionError
        If there are not three corners of finite numbers within 100000 pixels.

    Examples
    --------
    >>> read_polygon("10,20, 110,20, 60.5,90")
    [(10.0, 20.0), (110.0, 20.0), (60.5, 90.0)]
    """
    file = Path(text)
    if file.suffix.lower() in (".json", ".csv", ".txt"):
        try:
            with file.open("rb") as opened:
                content = opened.read(_MOST_BYTES + 1).decode("utf-8-sig")
        except (OSError, ValueError) as error:
            raise CaptureError(f"{text}: cannot be read as corners: {error}") from None
        if len(content) > _MOST_BYTES:
            raise CaptureError(f"{text}: got a file above {_MOST_BYTES} bytes, expected corners")
        found = _json_corners(content) if file.suffix.lower() == ".json" else _lines_of_corners(content)
    else:
        numbers = _numbers(text.split(","))
        found = None if numbers is None or len(numbers) % 2 else [*zip(numbers[::2], numbers[1::2], strict=True)]
    if found is None:
        raise OptionError(
            f"polygon: got {text!r}, expected x0,y0,x1,y1,x2,y2 and so on, or a JSON or CSV file of corners"
        )
    if len(found) < 3:
        raise OptionError(
            f"polygon: got {len(found)} corner{'' if len(found) == 1 else 's'} in {text!r}, expected three or more"
        )
    if not (np.abs(found) <= _FARTHEST_PX).all():
        raise OptionError(f"polygon: got {text!r}, expected finite corners within {_FARTHEST_PX:.0f} pixels")
    return found


def _numbers(words: list[str]) -> list[float] | None:
    try:
        return [float(word) for word in words]
    except ValueError:
        return None


def _json_corners(content: str) -> list[tuple[float, float]] | None:
    import json

    try:
        pairs = np.array(json.loads(content), np.float64)
    except (ValueError, TypeError, RecursionError):
        return None
    return [(float(x), float(y)) for x, y in pairs] if pairs.ndim == 2 and pairs.shape[1] == 2 else None


def _lines_of_corners(content: str) -> list[tuple[float, float]] | None:
    rows = [_numbers(line.split(",")) for line in content.splitlines() if line.strip() and not line.startswith("#")]
    rows = rows[1:] if rows and rows[0] is None else rows
    corners = [(row[0], row[1]) for row in rows if row is not None and len(row) == 2]
    return corners if len(corners) == len(rows) else None


def polygon_mask(corners: Sequence[tuple[float, float]], size: tuple[int, int]) -> Mask:
    """Draw a polygon: True where a pixel is in it or on its edge, False elsewhere.

    Raises
    ------
    OptionError
        If no pixel of a picture of that width and height is in it.

    Examples
    --------
    >>> polygon_mask([(1, 1), (3, 1), (3, 2), (1, 2)], (5, 4)).astype(int)
    array([[0, 0, 0, 0, 0],
           [0, 1, 1, 1, 0],
           [0, 1, 1, 1, 0],
           [0, 0, 0, 0, 0]])
    """
    import cv2

    width, height = size
    drawn = np.zeros((height, width), np.uint8)
    at = np.rint(np.array(corners, np.float64) * (1 << _FRACTION)).astype(np.int32)
    cv2.fillPoly(drawn, [at], 1, shift=_FRACTION)
    if not drawn.any():
        raise OptionError(f"polygon: got corners {[*corners]}, expected some within the frames, {width} x {height}")
    return drawn.view(np.bool_)


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
