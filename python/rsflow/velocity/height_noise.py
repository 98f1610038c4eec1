"""How exact a height between two rows of a log is.

Three parts. The noise of each row by itself: it averages between two rows, and is what the fifth differences of the
series show, at most what was stated. What all rows have in common, the rest of what was stated: it stays. And what a
straight line cuts off of a series that is bent, from the second differences around the place, less their noise.

docs/explanation/algorithms.md, section "Logs of sensors: heights, rates and attitudes at a frame".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .timeline import Timeline

__all__ = ["HeightNoise"]

F64 = NDArray[np.float64]

# Second differences to each side that tell how the series is bent at a place.
_REACH = 4
# A scatter of so many times what was stated is told, and counts instead; from so many differences on it can be seen.
_MORE_THAN_STATED = 1.5
_LEAST_SEEN = 12
# Order of the differences that show noise: a heave of 1 Hz, measured at 20 Hz, has a thousandth of its height in them.
_ORDER = 5
# Deviation of normal noise to the median of its size.
_TO_DEVIATION = 1.4826


@dataclass(frozen=True)
class HeightNoise:
    """What a log of heights shows of its own noise.

    Attributes
    ----------
    height_m : (N,) float64
        Of the rows that have one.
    stated_m : (N,) float64 or None
        What was stated of each.
    own_m, shared_m : (N,) float64
        Deviation of a row by itself, and what it has in common with the next; NaN where none was stated.
    bend : (N,) float64
        Root mean square of the second divided differences around each row, in m/s^2.
    seen_m : float
        Scatter from row to row that a smooth motion does not explain; NaN where there are too few rows to see it.
    step_s : (N - 1,) float64
    """

    height_m: F64
    stated_m: F64 | None
    own_m: F64
    shared_m: F64
    bend: F64
    seen_m: float
    step_s: F64

    @classmethod
    def of(cls, line: Timeline, height_m: F64, stated_m: F64 | None) -> HeightNoise:
        """See what rows at the times of `line` tell."""
        seen = _scatter(line, height_m)
        stated = np.full(len(height_m), np.nan) if stated_m is None else stated_m
        total = stated
        if np.isfinite(seen) and np.isfinite(stated).any() and seen > _MORE_THAN_STATED * np.nanmedian(stated):
            total = np.maximum(stated, seen)
        # Too few rows to see it: then all of it stays.
        own = np.fmin(total, seen if np.isfinite(seen) else 0.0)
        shared = np.sqrt(np.maximum(total**2 - own**2, 0.0))
        bend = _bend(line, height_m, np.where(np.isfinite(own), own, seen if np.isfinite(seen) else 0.0))
        return cls(height_m, stated_m, own, shared, bend, seen, np.diff(line.t_s))

    def std_at(self, row: int, share: float) -> float:
        """Give the deviation at a share of the way from a row to the next."""
        if share == 0.0:
            return float(np.hypot(self.own_m[row], self.shared_m[row]))
        near, far = 1.0 - share, share
        own = np.hypot(near * self.own_m[row], far * self.own_m[row + 1])
        shared = near * self.shared_m[row] + far * self.shared_m[row + 1]
        cut_off = max(self.bend[row], self.bend[row + 1]) * near * far * self.step_s[row] ** 2
        return float(np.sqrt(own**2 + shared**2 + cut_off**2))

    def told(self, what: str) -> str:
        """Say where the rows scatter by more than was stated, or by how much where nothing was."""
        if not np.isfinite(self.seen_m) or self.stated_m is None or not np.isfinite(self.stated_m).any():
            return ""
        usual = float(np.nanmedian(self.stated_m))
        if self.seen_m <= _MORE_THAN_STATED * usual:
            return ""
        return (
            f"The {what} scatter by {self.seen_m:.2g} m from row to row, with a standard deviation of {usual:.2g} m "
            "stated: the larger one counts."
        )


def _differences(line: Timeline, values: F64, order: int) -> tuple[F64, F64]:
    """Divided differences of `order`, and the sum of the squares of what they weight rows with; NaN over holes."""
    count = len(values) - order
    if count <= 0:
        return np.empty(0), np.empty(0)
    times = np.stack([line.t_s[k : k + count] for k in range(order + 1)])
    rows = np.stack([values[k : k + count] for k in range(order + 1)])
    apart = times[:, None] - times[None, :]
    apart[np.arange(order + 1), np.arange(order + 1)] = 1.0
    weights = 1.0 / apart.prod(axis=1)
    whole = (np.diff(times, axis=0) <= line.longest_s).all(axis=0)
    return np.where(whole, (weights * rows).sum(axis=0), np.nan), (weights**2).sum(axis=0)


def _scatter(line: Timeline, height_m: F64) -> float:
    """Give the deviation of white noise that has the high differences that are seen; NaN where they are too few."""
    high, gain = _differences(line, height_m, _ORDER)
    normal = high / np.sqrt(gain)
    normal = normal[np.isfinite(normal)]
    return float(_TO_DEVIATION * np.median(np.abs(normal))) if len(normal) >= _LEAST_SEEN else np.nan


def _bend(line: Timeline, height_m: F64, own_m: F64) -> F64:
    """Root mean square of the second differences around each row, less what noise makes of them."""
    second, gain = _differences(line, height_m, 2)
    bend = np.zeros(len(height_m))
    if not len(second):
        return bend
    excess = np.where(np.isfinite(second), second**2 - gain * own_m[1:-1] ** 2, 0.0)
    known = np.isfinite(second).astype(np.float64)
    window = np.ones(2 * _REACH + 1)
    sums = np.convolve(excess, window, mode="full")[_REACH : _REACH + len(second)]
    counts = np.convolve(known, window, mode="full")[_REACH : _REACH + len(second)]
    bend[1:-1] = np.sqrt(np.maximum(sums, 0.0) / np.maximum(counts, 1.0))
    bend[0], bend[-1] = bend[1], bend[-2]
    return bend
