"""Stages that work at the same time in threads of their own: those of their calls, and how soon Python hands over."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from . import _core

__all__ = ["share_threads", "soon_handed_over"]

# The motion between two frames in one thread, what moves and the velocity in another.
_STAGES = 2
# Python lets a thread that comes back from a call wait for so long while another one computes; by default ten times as
# long, which is a fifth of a frame's time for each call.
_HANDED_OVER_S = 0.0005

_lock = threading.Lock()
_runs = 0
_before_s = 0.0


def share_threads() -> None:
    """Let the calls of this thread keep to it where there are no more threads than stages."""
    _core.share_threads(_STAGES)


@contextmanager
def soon_handed_over() -> Iterator[None]:
    """Let Python's threads hand over sooner meanwhile; after the last of several runs it is as before."""
    global _runs, _before_s
    with _lock:
        if _runs == 0:
            _before_s = sys.getswitchinterval()
            sys.setswitchinterval(min(_before_s, _HANDED_OVER_S))
        _runs += 1
    try:
        yield
    finally:
        with _lock:
            _runs -= 1
            if _runs == 0:
                sys.setswitchinterval(_before_s)
