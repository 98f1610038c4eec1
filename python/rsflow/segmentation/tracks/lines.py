"""Lines that things cross."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ... import _checks
from ...errors import OptionError
from ..object_table import TrackedObject

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["CountingLine"]

# A thing is on a side of the line when its centre is so far from it, in pixels and as a share of its size: what
# trembles on the line does not cross it.
_LEAST_PX, _LEAST_SHARE = 2.0, 0.1
# What is remembered of so many things at most; the ones seen last are kept.
_MOST = 4096


class CountingLine:
    """Count the things whose centres cross a line, both ways.

    The line stands in the picture of the first frame, on the ground: where the camera moves it is carried along.

    Parameters
    ----------
    x0, y0, x1, y1 : float
        Its ends in pixels.

    Attributes
    ----------
    to_right, to_left : int
        How many crossed it, seen from its first end to its second one.

    Raises
    ------
    OptionError
        If an end is no number, or both are the same.

    Examples
    --------
    >>> from rsflow.objects import CountingLine, TrackedObject
    >>> line = CountingLine(50, 100, 50, 0)
    >>> for x in (30, 40, 49.9, 50.2, 60):
    ...     line.update([TrackedObject(1, x, 40, (x - 5, 30, 10, 20), 200, 10, 0, 3)])
    >>> line.to_right, line.to_left
    (1, 0)
    """

    def __init__(self, x0: float, y0: float, x1: float, y1: float) -> None:
        start = _checks.number("x0", x0, of="pixels"), _checks.number("y0", y0, of="pixels")
        self.ends = (*start, _checks.number("x1", x1, of="pixels"), _checks.number("y1", y1, of="pixels"))
        if self.ends[:2] == self.ends[2:]:
            raise OptionError(f"x1, y1: got {self.ends[2:]}, the first end, expected another point")
        self.to_right = self.to_left = 0
        # By number of the thing: where it was on a side for sure, and which.
        self._sides: dict[int, tuple[float, float, bool]] = {}

    def __repr__(self) -> str:
        x0, y0, x1, y1 = self.ends
        return f"CountingLine({x0:g}, {y0:g}, {x1:g}, {y1:g}): {self.to_right} to the right, {self.to_left} to the left"

    def update(self, objects: Iterable[TrackedObject]) -> None:
        """Take the things of the next frame, seen or hidden.

        Parameters
        ----------
        objects : iterable of TrackedObject
        """
        x0, y0, x1, y1 = self.ends
        length = math.hypot(x1 - x0, y1 - y0)
        along_x, along_y = (x1 - x0) / length, (y1 - y0) / length
        for thing in _checks.iterable("objects", objects, "TrackedObjects"):
            x, y = place(_checks.instance("objects", thing, TrackedObject, "TrackedObjects"))
            # To the right of the line, as the picture shows it.
            off = along_x * (y - y0) - along_y * (x - x0)
            if not abs(off) >= max(_LEAST_PX, _LEAST_SHARE * max(thing.box[2:])):
                continue
            before = self._sides.pop(thing.id, None)
            self._sides[thing.id] = x, y, off > 0
            if before is None or before[2] == (off > 0):
                continue
            # Where on the line its way from the other side crosses it.
            was = along_x * (before[1] - y0) - along_y * (before[0] - x0)
            share = was / (was - off)
            crossed_x, crossed_y = before[0] + share * (x - before[0]), before[1] + share * (y - before[1])
            at = along_x * (crossed_x - x0) + along_y * (crossed_y - y0)
            if 0 <= at <= length:
                if off > 0:
                    self.to_right += 1
                else:
                    self.to_left += 1
        while len(self._sides) > _MOST:
            del self._sides[next(iter(self._sides))]

    def text(self) -> str:
        """Say in a sentence how many crossed it.

        Returns
        -------
        str

        Examples
        --------
        >>> CountingLine(0, 5, 9, 5).text()
        '0 crossed 0,5,9,5 to the right, 0 to the left.'
        """
        ends = ",".join(f"{end:g}" for end in self.ends)
        return f"{self.to_right} crossed {ends} to the right, {self.to_left} to the left."

    def to_dict(self) -> dict[str, Any]:
        """Give ends and counts by name.

        Returns
        -------
        dict of str to float or int

        Examples
        --------
        >>> CountingLine(0, 5, 9, 5).to_dict()
        {'x0_px': 0.0, 'y0_px': 5.0, 'x1_px': 9.0, 'y1_px': 5.0, 'to_right': 0, 'to_left': 0}
        """
        names = ("x0_px", "y0_px", "x1_px", "y1_px")
        return dict(zip(names, self.ends, strict=True)) | {"to_right": self.to_right, "to_left": self.to_left}


def place(thing: TrackedObject) -> tuple[float, float]:
    """Where a thing is over the ground; in the picture where that is not known."""
    if math.isfinite(thing.x_ground_px + thing.y_ground_px):
        return thing.x_ground_px, thing.y_ground_px
    return thing.x, thing.y
