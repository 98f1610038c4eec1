"""Objects that hold a handle of OpenCV or FFmpeg, whose threads and locks a child of a fork does not have.

In such a child a handle must not even be released: that waits for threads that are not there, or crashes.
"""

from __future__ import annotations

import ctypes
import os
import threading
import weakref
from typing import Any, Self

from ..errors import RsflowError

__all__ = ["OfProcess", "opening"]

# Held while a library is imported, opens or closes a file, and over each fork: Python's lock of the module and those of
# the library must be free in the child.
opening = threading.RLock()

_living: weakref.WeakSet[OfProcess] = weakref.WeakSet()


class OfProcess:
    """Base of what holds such handles in its attributes: for the process alone that made it."""

    _process: int

    def __new__(cls, *_: Any, **__: Any) -> Self:
        """Remember the process before there is a handle."""
        made = super().__new__(cls)
        made._process = os.getpid()
        _living.add(made)
        return made

    @property
    def _elsewhere(self) -> bool:
        """Whether this is another process than the one that made it."""
        return self._process != os.getpid()

    def _expect_here(self, what: str) -> None:
        """Raise RsflowError in another process."""
        if self._elsewhere:
            raise RsflowError(
                f"{what}: got a call in process {os.getpid()}, a fork of process {self._process} that opened it, "
                "which alone can go on with it: open it anew here"
            )


def _keep_for_ever() -> None:
    """In a child: whatever the interpreter drops, at its end too, the handles of the parent are never released."""
    for held in list(_living):
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(held))
    opening.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=opening.acquire, after_in_parent=opening.release, after_in_child=_keep_for_ever)
