"""When a live source was away: then the frame before is of too long ago to be compared with."""

from __future__ import annotations

import statistics
from collections import deque

__all__ = ["GapRule"]

# A gap is longer than so many seconds, and than so many of the intervals so far: a slow camera has none.
_LEAST_S, _INTERVALS = 0.5, 5.0
_REMEMBERED = 15


class GapRule:
    """Say before each frame whether it comes after a gap.

    Parameters
    ----------
    live : bool
        Of a live source; a file has no gaps, whatever its times are.

    Examples
    --------
    >>> rule = GapRule(True)
    >>> [rule.before(t_s) for t_s in (0.0, 0.1, 0.2, 1.2, 1.3)]
    [False, False, False, True, False]
    """

    def __init__(self, live: bool) -> None:
        self._live = live
        self._last_s: float | None = None
        self._intervals: deque[float] = deque(maxlen=_REMEMBERED)

    def before(self, t_s: float) -> bool:
        """Take the time of the next frame."""
        last_s, self._last_s = self._last_s, t_s
        if not self._live or last_s is None:
            return False
        interval = t_s - last_s
        usual = statistics.median(self._intervals) if self._intervals else 0.0
        if interval > max(_LEAST_S, _INTERVALS * usual) and self._intervals:
            return True
        self._intervals.append(interval)
        return False
