"""When a live source was away: what it shows then is not to be compared with what it showed before."""

from __future__ import annotations

import math
import statistics
from collections import deque

__all__ = ["GapRule"]

# A source that was not opened again was away for more than so many seconds, and so many of the intervals so far: a
# slow camera has no gaps.
_LEAST_S, _INTERVALS = 1.0, 5.0
_REMEMBERED = 15


class GapRule:
    """Count the gaps of a live source.

    Attributes
    ----------
    count : int
        Gaps so far.

    Examples
    --------
    >>> rule = GapRule()
    >>> for t_s in (0.0, 0.1, 0.2, 1.4, 1.5):
    ...     rule.take(t_s)
    >>> rule.count
    1
    """

    def __init__(self) -> None:
        self.count = 0
        self._last_s = math.nan
        self._intervals: deque[float] = deque(maxlen=_REMEMBERED)

    def take(self, t_s: float, *, reopened: bool = False) -> None:
        """Take the time of the next frame, of a source that was opened again before it or was not."""
        interval, self._last_s = t_s - self._last_s, t_s
        if math.isnan(interval):
            return
        usual = statistics.median(self._intervals) if self._intervals else math.inf
        if reopened or interval > max(_LEAST_S, _INTERVALS * usual):
            self.count += 1
        else:
            self._intervals.append(interval)
