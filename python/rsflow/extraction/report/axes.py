"""What all plots share: colours, round ticks, curves thinned so that peaks stay, and places in shares of an axis."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "COLOURS",
    "MOST_COLUMNS",
    "Range",
    "columns",
    "envelope",
    "label",
    "pieces",
    "simplified",
    "thinned",
    "ticks",
]

# Okabe and Ito (2008): told apart with every kind of colour vision. The page has paler ones of these in the dark.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")

# A plot has so many columns: more are not told apart on any screen.
MOST_COLUMNS = 800

F64 = NDArray[np.float64]


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Give round numbers (1, 2 or 5 times a power of ten apart) from `low` to `high`, about `count` of them."""
    if not high > low:
        return [low]
    raw = (high - low) / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(index * step, 12) for index in range(first, last + 1)]


def label(value: float) -> str:
    """Write a number as it stands at an axis."""
    return f"{value + 0.0:.6g}".replace("-", "\u2212")


@dataclass(frozen=True)
class Range:
    """From where to where an axis reaches; one that begins where it ends is widened."""

    low: float
    high: float

    @classmethod
    def of(cls, low: float, high: float) -> Range:
        """Take both ends."""
        if high > low:
            return cls(low, high)
        half = max(abs(low) * 0.1, 0.5)
        return cls(low - half, high + half)

    def share(self, value: float) -> float:
        """Give where a value stands, 0 at the low end and 1 at the high one."""
        return (value - self.low) / (self.high - self.low)

    def shares(self, values: F64) -> F64:
        """Give where values stand."""
        return (values - self.low) / (self.high - self.low)


def columns(count: int, limit: int = MOST_COLUMNS) -> NDArray[np.intp]:
    """Give where each of at most `limit` columns of `count` values begins."""
    return np.unique(np.linspace(0, count, min(count, limit), endpoint=False).astype(np.intp))


def thinned(x: F64, y: F64, limit: int = MOST_COLUMNS) -> tuple[F64, F64]:
    """Thin a curve to the least and the greatest value of each column, in their order, so that no peak is lost.

    A column without any value is NaN, a gap.
    """
    if len(x) <= 2 * limit:
        return x, y
    begins = columns(len(y), limit)
    known = np.isfinite(y)
    # NaN loses against every number.
    least = np.where(known, y, np.inf)
    most = np.where(known, y, -np.inf)
    column = np.repeat(np.arange(len(begins)), np.diff([*begins, len(y)]))
    first = []
    for values, reduced in ((least, np.minimum.reduceat(least, begins)), (most, np.maximum.reduceat(most, begins))):
        at = np.flatnonzero(values == reduced[column])
        # The first of those that are as small, or as great.
        chosen = begins.copy()
        chosen[column[at][::-1]] = at[::-1]
        first.append(chosen)
    index = np.sort(np.stack(first, axis=1), axis=1).ravel()
    index = index[np.concatenate([[True], np.diff(index) > 0])]
    return x[index], y[index]


def envelope(x: F64, low: F64, high: F64, limit: int = MOST_COLUMNS) -> tuple[F64, F64, F64]:
    """Thin a band to the lowest and the highest of each column; NaN where a column has none."""
    if len(x) <= 2 * limit:
        return x, low, high
    begins = columns(len(x), limit)
    known = np.isfinite(low) & np.isfinite(high)
    least = np.minimum.reduceat(np.where(known, low, np.inf), begins)
    most = np.maximum.reduceat(np.where(known, high, -np.inf), begins)
    empty = ~np.isfinite(least)
    return x[begins], np.where(empty, np.nan, least), np.where(empty, np.nan, most)


def pieces(x: F64, y: F64) -> list[NDArray[np.intp]]:
    """Give the runs of finite neighbours: what was not measured is a gap in the curve."""
    index = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    return np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(index) else []


def simplified(x: F64, y: F64, least: float) -> tuple[F64, F64]:
    """Leave out points of a way that are nearer than `least` to the one before that stays; both ends stay."""
    keep, last = [0], (float(x[0]), float(y[0]))
    for number, place in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        if number and (math.dist(place, last) >= least or number == len(x) - 1):
            keep.append(number)
            last = place
    return x[keep], y[keep]
