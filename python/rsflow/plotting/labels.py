"""Where labels stand beside what they name: inside of the picture, and none over another."""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import drawing

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy as np
    from numpy.typing import NDArray

    Box = tuple[int, int, int, int]

__all__ = ["draw_labels"]

# Between a label and its box, and around its letters, in pixels.
_GAP, _AROUND = 1, 3
# Letters on a colour that is brighter than this level are dark.
_BRIGHT = 110
_DARK: drawing.Color = (0, 0, 0)
_LIGHT: drawing.Color = (255, 255, 255)


def _meets(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _places(box: Box, wide: int, high: int) -> Iterable[tuple[int, int]]:
    """Upper left corners around and in a box (left, top, right, bottom), the best first."""
    left, top, right, bottom = box
    above, below = top - _GAP - high, bottom + _GAP
    yield from ((left, above), (right - wide, above), (left, below), (right - wide, below))
    yield from ((right + _GAP, top), (left - _GAP - wide, top), (left + _GAP, top + _GAP))
    for row in (1, 2, 3):
        yield from ((left, above - row * high), (right + _GAP, top + row * high), (left, below + row * high))


def placed(
    boxes: Sequence[Box], texts: Sequence[str], shape: tuple[int, ...], taken: Iterable[Box] = ()
) -> list[tuple[int, int] | None]:
    """Lower left corner of each text, beside its box (left, top, right, bottom); None where there is no room.

    Earlier ones choose first; what is `taken` stays free.
    """
    height, width = shape[:2]
    size = drawing.size_for(shape)
    used = list(taken)
    out: list[tuple[int, int] | None] = []
    for box, text in zip(boxes, texts, strict=True):
        wide, high = (length + 2 * _AROUND for length in drawing.text_size(text, size=size))
        found = None
        for x, y in _places(box, wide, high):
            # Along an edge of the picture a label moves aside before it goes elsewhere.
            x = min(max(x, 0), width - wide)
            place = (x, y, x + wide, y + high)
            if x >= 0 and y >= 0 and y + high <= height and not any(_meets(place, other) for other in used):
                used.append(place)
                found = (x + _AROUND, y + high - _AROUND)
                break
        out.append(found)
    return out


def draw_labels(
    picture: NDArray[np.uint8], boxes: Sequence[Box], texts: Sequence[str], colors: Sequence[drawing.Color]
) -> None:
    """Write each text beside its box (left, top, right, bottom) on a tag of its colour, in place.

    What finds no room is left out.
    """
    size = drawing.size_for(picture.shape)
    for corner, text, color in zip(placed(boxes, texts, picture.shape), texts, colors, strict=True):
        if corner is not None:
            wide, high = drawing.text_size(text, size=size)
            (x, y), around = corner, _AROUND
            picture[y - high - around : y + around, x - around : x + wide + around] = color
            blue, green, red = color
            ink = _DARK if 0.114 * blue + 0.587 * green + 0.299 * red > _BRIGHT else _LIGHT
            drawing.put_text(picture, text, corner, size=size, color=ink, rim=False)
