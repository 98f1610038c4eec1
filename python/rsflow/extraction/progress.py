"""Progress on standard error: frames done, frames per second, time left; silent where nobody watches."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any, TextIO

__all__ = ["Progress", "clock"]

# Seconds between two refreshes of the plain line: seldom enough to cost nothing, often enough to look alive.
_REFRESH_S = 0.2


def clock(seconds: float) -> str:
    """Write a duration as ``1:02:03`` or ``2:03``."""
    whole = max(0, round(seconds))
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class Progress:
    """A progress bar over frames, by tqdm where it is installed, else one plain line.

    Parameters
    ----------
    total : int, optional
        Number of frames; None where the source does not know it.
    label : str
        Stands before the bar.
    stream : text stream, optional
        Where to draw; standard error by default.
    enabled : bool, optional
        By default only when `stream` is a terminal.
    """

    def __init__(
        self,
        total: int | None,
        label: str = "",
        *,
        stream: TextIO | None = None,
        enabled: bool | None = None,
    ) -> None:
        self.total = total
        self.label = label
        self.done = 0
        self._stream = sys.stderr if stream is None else stream
        # Under cron there may be no standard error at all.
        self.enabled = self._stream is not None and (self._stream.isatty() if enabled is None else enabled)
        self._begin = time.monotonic()
        self._drawn = -1.0
        self._length = 0
        self._bar: Any = None
        if self.enabled:
            try:
                from tqdm import tqdm
            except ModuleNotFoundError:
                return
            self._bar = tqdm(total=total, desc=label, unit=" frames", file=self._stream, dynamic_ncols=True, leave=True)

    @property
    def frames_per_second(self) -> float:
        """Mean rate since the beginning."""
        return self.done / max(time.monotonic() - self._begin, 1e-9)

    def advance(self, frames: int = 1) -> None:
        """Count `frames` more as done."""
        self.done += frames
        if self._bar is not None:
            self._bar.update(frames)
        elif self.enabled and time.monotonic() - self._drawn > _REFRESH_S:
            self._draw()

    def _draw(self) -> None:
        self._drawn = time.monotonic()
        rate = self.frames_per_second
        elapsed = clock(self._drawn - self._begin)
        if self.total:
            left = clock(max(self.total - self.done, 0) / max(rate, 1e-9))
            text = f"{self.label}: {self.done}/{self.total} frames, {rate:.1f} frames/s, {elapsed} gone, {left} left"
        else:
            text = f"{self.label}: {self.done} frames, {rate:.1f} frames/s, {elapsed} gone"
        # A shorter text must cover the longer one before it.
        self._stream.write("\r" + text.ljust(self._length))
        self._stream.flush()
        self._length = len(text)

    def close(self) -> None:
        """Draw the last state and end the line."""
        if self._bar is not None:
            if self.total and self.done > self.total:
                self._bar.total = self.done
            self._bar.close()
        elif self.enabled:
            self._draw()
            self._stream.write("\n")
            self._stream.flush()
        self.enabled = False
        self._bar = None

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
