"""When the rows of a sensor's log stand, and where it has a hole: what heights, rates and attitudes share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..errors import OptionError
from ..io.time_series import first_wrong

__all__ = ["HOLE_STEPS", "Timeline", "log_times"]

F64 = NDArray[np.float64]

# A step between two rows longer than so many usual ones (their median) is a hole: three rows that were lost in a row.
HOLE_STEPS = 4.0
# A frame may lie so many usual steps before the first row or behind the last, and no more than so many seconds: clocks
# are rounded, to a millisecond at worst, and a log rarely ends with the very frame.
_EDGE_STEPS, _EDGE_S, _ROUNDING_S = 0.5, 0.01, 1e-3


def log_times(name: str, value: object) -> F64:
    """Take the times of a log's rows: finite, strictly increasing, one at least."""
    times = _checks.array(name, value, ("N",), "(N,) times in seconds, each later than the one before").astype(
        np.float64
    )
    if not len(times):
        raise OptionError(f"{name}: got no times, expected one at least")
    wrong = first_wrong(times)
    if wrong is not None:
        raise OptionError(
            f"{name}: got {times[wrong]:g} at {wrong}, expected finite times, each later than the one before"
        )
    return times


@dataclass(frozen=True)
class Timeline:
    """Increasing times of rows, and the longest step between two that is no hole.

    Attributes
    ----------
    t_s : (N,) float64
    longest_s : float
        A longer step is a hole.
    edge_s : float
        How far outside of all rows the nearest one still holds.
    """

    t_s: F64
    longest_s: float
    edge_s: float

    @classmethod
    def of(cls, t_s: F64, known: NDArray[np.bool_]) -> Timeline:
        """Take the times of all rows, and which of them have a value: one without is as one that was lost."""
        usual = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.0
        return cls(t_s[known], HOLE_STEPS * usual, max(min(_EDGE_STEPS * usual, _EDGE_S), _ROUNDING_S))

    def between(self, t_s: float) -> tuple[int, float] | None:
        """Give the row before a time and the share of the way to the next; None outside of all rows and in a hole."""
        count = len(self.t_s)
        if not count or not self.t_s[0] - self.edge_s <= t_s <= self.t_s[-1] + self.edge_s:
            return None
        at = int(np.searchsorted(self.t_s, t_s, side="right")) - 1
        if at < 0:
            return 0, 0.0
        if at >= count - 1:
            return count - 1, 0.0
        step = float(self.t_s[at + 1] - self.t_s[at])
        share = float(t_s - self.t_s[at]) / step
        return (at, share) if step <= self.longest_s or share == 0.0 else None

    def inside(self, begin_s: float, end_s: float) -> slice | None:
        """Give the rows strictly inside of an interval; None where it reaches out of the log or into a hole."""
        if not len(self.t_s) or not begin_s < end_s:
            return None
        if begin_s < self.t_s[0] - self.edge_s or end_s > self.t_s[-1] + self.edge_s:
            return None
        first = int(np.searchsorted(self.t_s, begin_s, side="right"))
        last = int(np.searchsorted(self.t_s, end_s, side="left"))
        # The steps that the interval touches: from the row at or before its begin to that at or behind its end.
        touched = np.diff(self.t_s[max(first - 1, 0) : last + 1])
        return None if touched.size and touched.max() > self.longest_s else slice(first, last)

    def holes(self) -> tuple[int, float, float]:
        """Give how many holes there are, where the longest begins and how long it is."""
        steps = np.diff(self.t_s)
        if not steps.size or not (steps > self.longest_s).any():
            return 0, np.nan, 0.0
        at = int(np.argmax(steps))
        return int((steps > self.longest_s).sum()), float(self.t_s[at]), float(steps[at])

    def told(self, what: str) -> str:
        """Say in a sentence where `what` has holes; empty where it has none."""
        count, begin, length = self.holes()
        if not count:
            return ""
        usual = self.longest_s / HOLE_STEPS
        many = "a hole" if count == 1 else f"{count} holes, the longest"
        return (
            f"The {what} have {many} of {length:.6g} s from {begin:.6g} s on, where {usual:.6g} s from row to row are "
            "usual: there nothing is known of them."
        )
