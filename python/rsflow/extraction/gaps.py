"""The sum of steps some of which could not be measured: filled with the best estimate there is, and what it is worth.

A step that is missing is not a step of zero. It is taken from a second estimate of the same motion where there is one,
else carried on between the measured steps before and after it. A second estimate is held against the steps that were
measured, where both are known. What is carried on is an assumption, nothing constrains the motion in a gap: its
deviation is that of a motion which may stop, turn round or go several times as fast, however smooth the rest is.

docs/explanation/algorithms.md, section "The path, and how it drifts".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MEASURED", "NEIGHBOURS", "SECOND", "UNKNOWN", "UNSEEN", "Filled", "fill"]

F64 = NDArray[np.float64]

# Where a step comes from.
MEASURED, SECOND, NEIGHBOURS, UNKNOWN = range(4)

# Steps known twice that it takes to say how far the two estimates differ.
_LEAST_PAIRS = 8
# The second estimate is never taken to be better than this, in pixels a step.
_SECOND_LEAST = 0.05
# Stretches of measured steps that it takes to say how well a gap is carried over.
_LEAST_STRETCHES = 4
# A stretch that cannot be measured is rarely as smooth as those that can.
_ROUGHER = 2.0
# Deviation of the motion in a gap, to the speed beside it: two of them reach from -5 to +7 times that speed.
UNSEEN = 3.0
# A picture that rests beside a gap may have moved in it too: the least speed that is reckoned with, in pixels a step.
_LEAST_SPEED = 1.0


@dataclass(frozen=True)
class Filled:
    """Steps with every gap filled as well as it can be.

    Attributes
    ----------
    steps : (N, 2) float64
        NaN where nothing is known at all.
    source : (N,) int8
        `MEASURED`, `SECOND`, `NEIGHBOURS` or `UNKNOWN`.
    variance : (N, 2) float64
        Of the sum up to and with each step; infinite from the first step on that is `UNKNOWN`.
    """

    steps: F64
    source: NDArray[np.int8]
    variance: F64

    @property
    def sums(self) -> F64:
        """Where the steps lead, (N, 2)."""
        return np.cumsum(self.steps, axis=0)

    def count(self, source: int) -> int:
        """How many steps come from `source`."""
        return int(np.count_nonzero(self.source == source))


def fill(steps: F64, variance: F64, duration: F64, second: F64 | None = None, check: F64 | None = None) -> Filled:
    """Fill the steps that are NaN.

    Parameters
    ----------
    steps, variance : (N, 2) float64
        What was measured; NaN in both columns where it was not.
    duration : (N,) float64
        Time of each step; where any is not above 0, all steps count as equally long.
    second : (N, 2) float64, optional
        Another estimate of the same steps, NaN where there is none.
    check : (N, 2) float64, optional
        A third one, by which the second is judged where it stands alone.
    """
    known: NDArray[np.bool_] = np.asarray(np.isfinite(steps).all(axis=1))
    source = np.where(known, MEASURED, UNKNOWN).astype(np.int8)
    filled = np.where(known[:, None], steps, np.nan)
    independent = np.where(known[:, None], variance, 0.0)
    shared = np.zeros_like(filled)
    if second is not None and len(steps):
        own, common = _second_worth(filled, second, second if check is None else check)
        here = ~known & np.asarray(np.isfinite(second).all(axis=1))
        filled[here], source[here] = second[here], SECOND
        independent[here], shared[here] = own[here] ** 2, common[here]
    time = duration if np.isfinite(duration).all() and (duration > 0).all() else np.ones(len(steps))
    for first, last in _gaps(source):
        carried = _carried(filled / time[:, None], first, last)
        if carried is None:
            independent[first:last] = np.inf
            continue
        filled[first:last], source[first:last] = carried * time[first:last, None], NEIGHBOURS
    # Judged by what is known before any gap is carried over.
    real = np.isin(source, (MEASURED, SECOND))
    rates = np.where(real[:, None], filled / time[:, None], np.nan)
    for first, last in _gaps(np.where(real, MEASURED, source).astype(np.int8)):
        if source[first] == NEIGHBOURS:
            error = _carry_error(rates, last - first, open_end=first == 0 or last == len(rates))
            span = float(time[first:last].sum())
            # The variance grows through the gap; all of it is there at its end.
            share = (np.cumsum(time[first:last]) / span) ** 2
            likely = _ROUGHER * error * span / (last - first)
            total = np.maximum(likely, UNSEEN * _speed(filled, real, time, first, last) * span) ** 2
            independent[first:last] = np.diff(share, prepend=0.0)[:, None] * total
    return Filled(filled, source, np.cumsum(independent, axis=0) + np.cumsum(shared, axis=0) ** 2)


def _speed(filled: F64, real: NDArray[np.bool_], time: F64, first: int, last: int) -> float:
    """Speed to reckon with in a gap: the fastest of that at its ends, the mean where it is known, and the least."""
    speeds = np.hypot(*filled.T) / time
    ends = [speeds[at] for at in (first - 1, last) if 0 <= at < len(speeds)]
    return float(max(*ends, speeds[real].mean(), _LEAST_SPEED * len(time) / time.sum()))


def _second_worth(steps: F64, second: F64, check: F64) -> tuple[F64, F64]:
    """Deviation of each second estimate by itself, and what it may have in common with the others, signed."""
    apart = (second - steps)[np.isfinite(second - steps).all(axis=1)]
    doubt = np.nan_to_num(0.5 * (second - check))
    if len(apart) >= _LEAST_PAIRS:
        own = np.sqrt((apart**2).mean(axis=0))
        bias = apart.mean(axis=0)
        common = np.sign(doubt + (doubt == 0)) * (np.abs(bias) + own / np.sqrt(len(apart)))
    else:
        # Nothing to hold it against: each may be wrong by as much as the two estimates of the flow differ.
        own, common = np.sqrt((4 * doubt**2).mean(axis=0)), np.zeros(2)
    return np.broadcast_to(np.maximum(own, _SECOND_LEAST), second.shape), doubt + common


def _gaps(source: NDArray[np.int8]) -> list[tuple[int, int]]:
    """Ranges of steps that are neither measured nor known from the second estimate."""
    missing = np.concatenate([[False], ~np.isin(source, (MEASURED, SECOND)), [False]])
    edges = np.flatnonzero(missing[1:] != missing[:-1])
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _carried(rates: F64, first: int, last: int) -> F64 | None:
    """Rates between those before and after a gap; the nearer one's where the gap is open; None where there is none."""
    before = rates[first - 1] if first > 0 else None
    after = rates[last] if last < len(rates) else None
    if before is None and after is None:
        return None
    before, after = (after if before is None else before), (before if after is None else after)
    assert before is not None
    assert after is not None
    share = (np.arange(1, last - first + 1) / (last - first + 1))[:, None]
    result: F64 = before + share * (after - before)
    return result


def _carry_error(rates: F64, length: int, *, open_end: bool) -> F64:
    """Root mean square error of the sum of rates over a gap of `length`, (2,), from stretches that are known.

    Where no stretch is so long, that of the longest there is grows with the power of 3/2 of the length, as it does for
    a rate that walks at random. Infinite where nothing can be held against it.
    """
    known: NDArray[np.bool_] = np.asarray(np.isfinite(rates).all(axis=1))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]])))
    runs = edges[1::2] - edges[::2]
    beside = 1 if open_end else 2
    # Of sums from the start on each stretch is a difference: gaps of minutes in films of hours are judged at once.
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(np.where(known[:, None], rates, 0.0), axis=0)])
    for size in range(min(length, int(runs.max(initial=0)) - beside), 0, -1):
        reach = size + beside
        if np.maximum(runs - reach + 1, 0).sum() < _LEAST_STRETCHES:
            continue
        begins = np.concatenate([np.arange(at, at + run - reach + 1) for at, run in zip(edges[::2], runs, strict=True)])
        ends = rates[begins] if open_end else 0.5 * (rates[begins] + rates[begins + reach - 1])
        error = sums[begins + size + 1] - sums[begins + 1] - size * ends
        return np.asarray(np.sqrt((error**2).mean(axis=0)) * (length / size) ** 1.5, dtype=np.float64)
    return np.full(2, np.inf)
