"""What is believed of the things that are followed: a row of arrays for each."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .regions_seen import BINS, SAMPLES

F64 = NDArray[np.float64]

SEEN, MERGED, HIDDEN = 0, 1, 2
STATES = ("seen", "merged", "hidden")


class Followed:
    """Arrays with a row for each thing, in the order in which they were first seen.

    Attributes
    ----------
    id : (n,) int64
        Its number, 0 as long as it has none.
    listed : (n,) bool
        Whether it counts as a thing.
    place, velocity : (n, 2) float64
        In the picture at hand, over the ground, in pixels and pixels per frame.
    variance : (n, 2, 3) float64
        Of the place, of place with velocity, of the velocity, along each axis.
    informed, flowing : (n,) bool
        Whether its velocity was ever measured, and by the motion in it.
    proved : (n,) bool
        Whether it has gone its own size, as the motion in it says too.
    size, area : (n, 2), (n,) float64
        Width and height of its box, and its number of pixels, smoothed.
    box : (n, 4) float64
        The box of what was seen of it last.
    centre : (n, 2) float64
        The centre of what was seen of it last.
    pixels : (n,) float64
        How much was seen of it last.
    age, missed, first : (n,) int64
        In how many frames it was seen, for how many it has been hidden, in which it was first seen.
    state : (n,) int64
        How it is seen in this frame: `SEEN`, `MERGED` with others into one region, `HIDDEN`.
    key, kin : (n,) int64
        Tells it from all others, and that which it was a part of, 0 for none.
    apart : (n,) int64
        In how many frames more it was seen apart from that than together with it.
    alone, within : (n,) int64
        In how many frames it was seen by itself, and for how many it has gone along within another one.
    histogram : (n, 16) float64
        Shares of its grey levels, smoothed.
    patch : (n, 256, 6) float32
        Samples of its picture: weight, x and y in the picture at hand, level, and how that changes along x and y.
    surprise : (n,) float64
        Mean squared innovation over its variance, smoothed.
    way, reach : (n, 2), (n,) float64
        From where it was first seen to where it is, over the ground, and the longest that was.
    corner : (n, 2) float64
        Where on its way its path was lengthened last.
    carried, alongside : (n, 2) float64
        Sum of the motion in it, and its way in the frames where that was known.
    steps : (n,) float64
        Sum of the lengths of its steps from frame to frame.
    path, travelled : (n,) float64
        Length of its path over the ground, in the picture's pixels and by steps of a tenth of its size, and in pixels
        of the first frame.
    ground : (n, 2) float64
        Its place in the first frame's picture.
    motion, scatter : (n, 2) float64
        How far its picture went in the last frame, NaN where it does not say, and the variance of that by its changes.
    contrast : (n,) float64
        The most, in levels of 256, that its picture has differed within itself or from what it would be at rest.
    parts : (n,) float64
        How much says by its shape that it is two things.
    strips : (n, 2, 2) float64
        How far its right half has moved against its left one, and its lower against its upper one.
    """

    _ROWS: ClassVar[dict[str, tuple[type, tuple[int, ...]]]] = {
        **dict.fromkeys(
            ("id", "age", "missed", "first", "state", "key", "kin", "apart", "alone", "within"), (np.int64, ())
        ),
        **dict.fromkeys(("listed", "informed", "flowing", "proved"), (np.bool_, ())),
        **dict.fromkeys(
            (
                "place",
                "velocity",
                "size",
                "centre",
                "way",
                "corner",
                "carried",
                "alongside",
                "ground",
                "motion",
                "scatter",
            ),
            (np.float64, (2,)),
        ),
        **dict.fromkeys(
            ("area", "pixels", "surprise", "reach", "travelled", "path", "steps", "parts", "contrast"), (np.float64, ())
        ),
        "variance": (np.float64, (2, 3)),
        "strips": (np.float64, (2, 2)),
        "box": (np.float64, (4,)),
        "histogram": (np.float64, (BINS,)),
        "patch": (np.float32, (SAMPLES, 6)),
    }

    id: NDArray[np.int64]
    age: NDArray[np.int64]
    missed: NDArray[np.int64]
    first: NDArray[np.int64]
    state: NDArray[np.int64]
    key: NDArray[np.int64]
    kin: NDArray[np.int64]
    apart: NDArray[np.int64]
    alone: NDArray[np.int64]
    within: NDArray[np.int64]
    listed: NDArray[np.bool_]
    informed: NDArray[np.bool_]
    flowing: NDArray[np.bool_]
    proved: NDArray[np.bool_]
    place: F64
    velocity: F64
    size: F64
    centre: F64
    way: F64
    corner: F64
    carried: F64
    alongside: F64
    ground: F64
    motion: F64
    scatter: F64
    area: F64
    pixels: F64
    surprise: F64
    reach: F64
    travelled: F64
    path: F64
    steps: F64
    parts: F64
    contrast: F64
    variance: F64
    strips: F64
    box: F64
    histogram: F64
    patch: NDArray[np.float32]

    def __init__(self) -> None:
        self.keys = 0
        for name, (dtype, shape) in self._ROWS.items():
            setattr(self, name, np.zeros((0, *shape), dtype))

    def __len__(self) -> int:
        return len(self.id)

    def names(self) -> tuple[str, ...]:
        """Names of the arrays."""
        return tuple(self._ROWS)

    def next_keys(self, count: int) -> NDArray[np.int64]:
        """Give keys that no thing has had."""
        self.keys += count
        return np.arange(self.keys - count + 1, self.keys + 1)

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Forget those that are not among `which`."""
        if not which.all():
            for name in self._ROWS:
                setattr(self, name, getattr(self, name)[which])

    def append(self, count: int, **values: Any) -> None:
        """Add things; what is not given is zero."""
        for name, (dtype, shape) in self._ROWS.items():
            new: NDArray[Any] = np.zeros((count, *shape), dtype)
            if name in values:
                new[...] = values[name]
            setattr(self, name, np.concatenate([getattr(self, name), new]))
