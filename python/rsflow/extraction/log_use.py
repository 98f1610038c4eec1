"""What of a log the frames of a source could use: a log of another time or of another clip is told, not passed over."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..errors import OptionError

if TYPE_CHECKING:
    from ..capture.stream import Frames

__all__ = ["LogUse"]


class LogUse:
    """Counts for how many frames a log had something.

    Parameters
    ----------
    name : str
        Of the option, for messages.
    path : str
        Of the log.
    what : str
        What it has one of for a frame: a height, a rate.
    log : Heights, Rates or Attitudes
    """

    def __init__(self, name: str, path: str, what: str, log: Any) -> None:
        self._name, self._path, self._what, self._span = name, path, what, log.span
        self._by = getattr(log, "by", "t_s")
        keys = log.keys if hasattr(log, "keys") else log.t_s
        self._first, self._last = float(keys[0]), float(keys[-1])
        self._known = self._unknown = 0
        self._asked: list[tuple[int, float]] = []

    def count(self, frame: int, t_s: float, known: bool) -> None:
        """Take a frame, and whether the log had something for it."""
        self._known += known
        # A rate is one of two frames: the first has none.
        self._unknown += not known and (bool(self._asked) or self._name != "rates")
        # The first and the last.
        self._asked = [*self._asked[:1], (frame, t_s)]

    def counts(self) -> tuple[int, int, list[tuple[int, float]]]:
        """Give what `go_on` needs."""
        return self._known, self._unknown, self._asked

    def go_on(self, counts: tuple[int, int, list[tuple[int, float]]]) -> None:
        """Be as after the frames that were counted."""
        self._known, self._unknown, self._asked = counts

    def expect_some(self, stream: Frames, log_start_s: float) -> None:
        """Raise OptionError where it is plain before the first frame that none of `stream` can have one."""
        count = stream.count
        if count is None or count == 0:
            return
        taken = range(stream._start, stream._start + count * stream._stride, stream._stride)
        # A container's own count and rate may be wrong by some: only what is far off is plain.
        slack = max(10, count // 4)
        if self._by == "frame":
            far = self._first > taken[-1] + slack or self._last < taken[0]
        elif stream.frame_rate and stream.timestamps in ("file", "given", "rate"):
            first, last = taken[0] / stream.frame_rate, (taken[-1] + slack) / stream.frame_rate
            far = self._first - log_start_s > 2 * last + 1 or self._last - log_start_s < first / 2 - 1
        else:
            return
        if far:
            raise self._error(f"{stream.source} has {count} frames, from {taken[0]} to {taken[-1]}", log_start_s)

    def missed(self, log_start_s: float) -> OptionError | None:
        """Give the error that frames were asked for and none had one, or None."""
        if self._known or len(self._asked) < 2:
            return None
        (first, begin), (last, end) = self._asked[0], self._asked[-1]
        return self._error(f"the frames from {first} to {last} are at times from {begin:g} to {end:g} s", log_start_s)

    def gaps(self) -> str:
        """Say for how many frames there was none; empty where for none."""
        if not self._unknown:
            return ""
        return f"{self._unknown} frames have no {self._what}: {self._path} has {self._span}"

    def _error(self, frames: str, log_start_s: float) -> OptionError:
        clock = ""
        if self._by == "t_s":
            clock = "; log_start_s (--log-start) says what the log's clock shows at the source's time 0"
            clock += f", {log_start_s:g} s now" if log_start_s else ""
        return OptionError(
            f"{self._name}: got {self._path} with {self._span}, expected {self._what}s of the frames, but {frames}: no "
            f"frame has a {self._what}{clock}"
        )
