"""Which things of two parts that overlap are the same, and what their rows say once the parts are one.

A thing of the later part is one of the earlier part where their boxes agree in the frames that both parts saw: of all
pairs the best first, by the mean of the boxes' overlap (intersection over union) in those frames of the overlap in
which either was there, at least `LEAST_AGREEMENT`. It keeps the earlier number, and its age and way go on from there.
Every other thing of the later part gets the next free number, in the order of its own.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_AGREEMENT", "Joint", "added", "pairs"]

# Boxes of one thing in two runs agree to some pixels of their edge; those of neighbours hardly overlap.
LEAST_AGREEMENT = 0.3

# Frames before the cut that are looked at: the later part has been at work for long enough.
_FRAMES = 10

Box = tuple[float, float, float, float]


def pairs(earlier: Iterable[Mapping[str, Any]], later: Iterable[Mapping[str, Any]]) -> dict[int, int]:
    """Give the number in the earlier part of each thing of the later part that it has too.

    Parameters
    ----------
    earlier, later : iterable of mappings
        Rows of things in the frames of the overlap: ``frame``, ``id``, ``left_px``, ``top_px``, ``width_px``,
        ``height_px``.
    """
    before, after = _boxes(earlier), _boxes(later)
    frames = sorted({frame for boxes in after.values() for frame in boxes})[-_FRAMES:]
    if not frames:
        return {}
    agreements = []
    for old, old_boxes in before.items():
        for new, new_boxes in after.items():
            there = [frame for frame in range(frames[0], frames[-1] + 1) if frame in old_boxes or frame in new_boxes]
            shares = [_overlap(old_boxes.get(frame), new_boxes.get(frame)) for frame in there]
            if shares and (mean := sum(shares) / len(shares)) >= LEAST_AGREEMENT:
                agreements.append((-mean, old, new))
    found: dict[int, int] = {}
    for _, old, new in sorted(agreements):
        if new not in found and old not in found.values():
            found[new] = old
    return found


def _boxes(rows: Iterable[Mapping[str, Any]]) -> dict[int, dict[int, Box]]:
    boxes: dict[int, dict[int, Box]] = defaultdict(dict)
    for row in rows:
        left, top, width, height = (float(row[name]) for name in ("left_px", "top_px", "width_px", "height_px"))
        boxes[int(row["id"])][int(row["frame"])] = (left, top, left + width, top + height)
    return boxes


def _overlap(a: Box | None, b: Box | None) -> float:
    if a is None or b is None:
        return 0.0
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0 or height <= 0:
        return 0.0
    both = width * height
    return both / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - both)


@dataclass
class Joint:
    """What changes in the rows of a part: numbers, what is added up over a thing's life, places over the ground.

    Parameters
    ----------
    numbers : dict of int to int
        The number of each thing, by its number in the part; one that is missing gets the next.
    next_id : int
        The next free number.
    added : dict of int to dict of str to float
        What is added to columns, by the number in the part.
    to_first : (3, 3) array, optional
        From the picture over which the part has its places to that of the first frame.
    """

    numbers: dict[int, int]
    next_id: int
    added: dict[int, dict[str, float]] = field(default_factory=dict)
    to_first: NDArray[np.float64] | None = None

    def changed(self, row: dict[str, str]) -> dict[str, Any]:
        """Give a row of ``objects.csv`` as the whole has it."""
        old = int(row["id"])
        if old not in self.numbers:
            self.numbers[old] = self.next_id
            self.next_id += 1
        new: dict[str, Any] = {**row, "id": self.numbers[old]}
        for name, value in self.added.get(old, {}).items():
            if row.get(name):
                new[name] = int(row[name]) + int(value) if name == "age_frames" else float(row[name]) + value
        if self.to_first is not None and row.get("x_ground_px"):
            x, y, w = self.to_first @ (float(row["x_ground_px"]), float(row["y_ground_px"]), 1.0)
            new["x_ground_px"], new["y_ground_px"] = float(x / w), float(y / w)
        return new


# Columns that add up over the life of a thing.
_ADDED = ("age_frames", "travelled_px", "travelled_m")


def added(
    numbers: Mapping[int, int], earlier: Mapping[int, Mapping[str, Any]], later: Mapping[int, Mapping[str, Any]]
) -> dict[int, dict[str, float]]:
    """Give what is added to the columns of things that go on, from their rows in the last frame before the cut."""
    found: dict[int, dict[str, float]] = {}
    for new, old in numbers.items():
        before, after = earlier.get(old), later.get(new)
        if before is None or after is None:
            continue
        found[new] = {name: _number(before.get(name)) - _number(after.get(name)) for name in _ADDED}
    return found


def _number(value: Any) -> float:
    value = float(value) if value not in (None, "") else 0.0
    return value if np.isfinite(value) else 0.0
