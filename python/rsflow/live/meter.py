"""How late figures are, and how many there are in a second: quantiles of a run of any length in little memory."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

__all__ = ["Delays", "Rate"]

# Bins of one per cent each, from 0.1 ms to 1000 s.
_LEAST_S, _GROWTH, _BINS = 1e-4, 1.01, 1620
# The rate is over the frames of so many seconds.
_WINDOW_S = 1.0


class Delays:
    """Count delays in bins of one per cent.

    Examples
    --------
    >>> delays = Delays()
    >>> for milliseconds in range(1, 101):
    ...     delays.add(milliseconds / 1000)
    >>> [round(1000 * delays.quantile(share)) for share in (0.5, 0.95, 0.99)]
    [50, 95, 99]
    """

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, np.int64)

    def add(self, seconds: float) -> None:
        """Count one; what is not known (NaN) is not counted."""
        if math.isfinite(seconds):
            place = math.log(max(seconds, _LEAST_S) / _LEAST_S) / math.log(_GROWTH)
            self._counts[min(int(place), _BINS - 1)] += 1

    def quantile(self, share: float) -> float:
        """Give a quantile in seconds; NaN of none."""
        total = int(self._counts.sum())
        if not total:
            return math.nan
        place = int(np.searchsorted(np.cumsum(self._counts), max(1, math.ceil(share * total))))
        return float(_LEAST_S * _GROWTH ** (place + 0.5))


class Rate:
    """Events per second over the last second.

    Examples
    --------
    >>> rate = Rate()
    >>> [round(rate.add(0.1 * frame), 3) for frame in range(4)][1:]
    [10.0, 10.0, 10.0]
    """

    def __init__(self) -> None:
        self._times: deque[float] = deque()

    def add(self, now_s: float) -> float:
        """Count one at a time of the clock; give the rate, NaN of a first one."""
        times = self._times
        times.append(now_s)
        while len(times) > 2 and now_s - times[0] > _WINDOW_S:
            times.popleft()
        span = now_s - times[0]
        return (len(times) - 1) / span if span > 0 else math.nan
