"""Parts of a picture around what moves: where they are, masks with soft edges, and pictures laid over pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import _display
from ..errors import ShapeError
from .regions import pixels

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import Any

    from numpy.typing import NDArray

    U8 = NDArray[np.uint8]
    F32 = NDArray[np.float32]
    # Left, top, right and bottom of a part, the last two behind it.
    Part = tuple[int, int, int, int]

__all__ = ["boxes_of", "canvas", "cut", "hatched", "hatching", "laid_over", "parts_around", "softened"]

# Width of an edge that is smooth.
_EDGE_PX = 2.0

# Two parts are one where that costs at most so many pixels more.
_WASTE = 1.2


def canvas(shape: tuple[int, ...], image: NDArray[Any], picture: NDArray[Any] | None) -> U8:
    """Make a picture to draw on: of the frame, or of the one in colour that is given for it."""
    out = _display.displayed(image if picture is None else picture)
    if out.shape[:2] != shape:
        raise ShapeError(f"picture: got shape {out.shape[:2]}, expected that of the frame, {shape}")
    return out


def boxes_of(mask: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Give boxes (left, top, width, height) around the regions of a mask."""
    import cv2

    contours, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    boxes = [cv2.boundingRect(contour) for contour in contours]
    return [(int(left), int(top), int(wide), int(high)) for left, top, wide, high in boxes]


def parts_around(boxes: Iterable[tuple[int, int, int, int]], shape: tuple[int, ...], margin: int) -> list[Part]:
    """Parts of a picture that hold these boxes (left, top, width, height) with a margin; none overlaps another."""
    height, width = shape[:2]
    parts: list[Part] = []
    for left, top, wide, high in boxes:
        part = (
            max(left - margin, 0),
            max(top - margin, 0),
            min(left + wide + margin, width),
            min(top + high + margin, height),
        )
        if part[0] >= part[2] or part[1] >= part[3]:
            continue
        # A part that has grown may reach others.
        while True:
            other = next((other for other in parts if _joins(part, other)), None)
            if other is None:
                break
            parts.remove(other)
            part = _around(part, other)
        parts.append(part)
    return parts


def _around(one: Part, other: Part) -> Part:
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _joins(one: Part, other: Part) -> bool:
    if one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]:
        return True
    return _area(_around(one, other)) <= _WASTE * (_area(one) + _area(other))


def _area(part: Part) -> int:
    return (part[2] - part[0]) * (part[3] - part[1])


def cut(part: Part) -> tuple[slice, slice]:
    """Rows and columns of a part."""
    return slice(part[1], part[3]), slice(part[0], part[2])


def softened(mask: NDArray[np.bool_], reach: int) -> F32:
    """Give a mask from 0 to 1 whose edge is smooth and two pixels wide: steps of up to `reach` pixels are gone."""
    import cv2

    size = 2 * reach + 1
    blurred = cv2.GaussianBlur(mask.view(np.uint8) * np.uint8(255), (size, size), 0)
    # The blur of a straight edge rises by one over 2.5 of its deviations for each pixel; OpenCV says what these are.
    sigma = 0.3 * ((size - 1) * 0.5 - 1) + 0.8
    steep = 2.5 * sigma / _EDGE_PX
    return np.asarray(np.clip(np.arange(256) / 255 * steep + 0.5 * (1 - steep), 0, 1).astype(np.float32)[blurred])


def laid_over(below: U8, above: U8, share: F32) -> U8:
    """Mix two pictures; `share` of the upper one, from 0 to 1, for each pixel."""
    import cv2

    return np.asarray(cv2.blendLinear(below, above, 1 - share, share), np.uint8)


def hatching(rows: NDArray[np.int32], columns: NDArray[np.int32]) -> U8:
    """Grey levels of the hatching at some pixels of a picture: what is not known."""
    return np.where((rows + columns) % 8 < 2, 110, 70).astype(np.uint8)


def hatched(picture: U8, known: NDArray[np.bool_], origin: tuple[int, int] = (0, 0)) -> U8:
    """Draw hatching in place where nothing is known; `origin` is the (x, y) of a part of a picture."""
    rows, columns = pixels(~known)
    picture[rows, columns] = hatching(rows + origin[1], columns + origin[0])[:, None]
    return picture
