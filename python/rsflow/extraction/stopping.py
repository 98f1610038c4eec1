"""Ctrl-C and SIGTERM as a wish to stop after the frame at hand, so that what is finished can be kept."""

from __future__ import annotations

import _thread
import signal
import threading
from types import FrameType, TracebackType
from typing import Any

__all__ = ["StopRequest", "tell", "told"]

# How often this process was told to stop by another one, which needs no signal.
_told = 0


def tell() -> None:
    """Ask what runs in this process to stop, as a signal would; from any thread, and also of what is yet to begin."""
    global _told
    _told += 1
    if _told > 1:
        # Does nothing where no StopRequest is at hand to take it.
        _thread.interrupt_main(signal.SIGTERM)


def told() -> bool:
    """Whether `tell` was called."""
    return _told > 0


class StopRequest:
    """Within its ``with`` block the first signal is only counted; a second one interrupts at once.

    Outside of the main thread, where Python cannot take signals, and where the caller ignores a signal, nothing
    changes.

    Parameters
    ----------
    interrupts : bool
        False: a second signal, and any further one, is only counted too.
    """

    def __init__(self, *, interrupts: bool = True) -> None:
        self._interrupts = interrupts
        self._signals = 0
        self._before: dict[int, Any] = {}

    @property
    def count(self) -> int:
        """How often a stop was asked for."""
        return self._signals + _told

    @property
    def requested(self) -> bool:
        """Whether a stop was asked for."""
        return self.count > 0

    def _take(self, number: int, frame: FrameType | None) -> None:
        self._signals += 1
        if self.count > 1 and self._interrupts:
            raise KeyboardInterrupt

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) not in (signal.SIG_IGN, None):
                    self._before[number] = signal.signal(number, self._take)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()
