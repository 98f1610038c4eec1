"""Who writes: a mark of this process, and whether the process of a mark still runs."""

from __future__ import annotations

import functools
import os
import sys
import zlib
from pathlib import Path

__all__ = ["is_alive", "is_here", "this_process"]


def this_process() -> str:
    """Mark of this process: its number, its machine, and when it was started.

    Examples
    --------
    >>> from rsflow.io.processes import is_alive, this_process
    >>> is_alive(this_process())
    True
    """
    pid = os.getpid()
    _, started = _state(pid)
    return f"{pid}-{_machine(pid):x}-{started}"


def is_here(mark: str) -> bool:
    """Whether the process of a mark is of this machine."""
    return int(mark.split("-")[1], 16) == _machine(os.getpid())


def is_alive(mark: str) -> bool:
    """Whether the process of a mark runs; True too where that cannot be known, as of another machine."""
    number, _, started = mark.split("-")
    pid = int(number)
    if not is_here(mark):
        return True
    if pid == os.getpid() and started == _state(pid)[1]:
        return True
    # On Windows the signal 0 is Ctrl-C.
    if sys.platform == "win32":
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        # It runs for another user.
        pass
    state, now = _state(pid)
    # A process that has ended and was not yet waited for; or another one that got the number of a dead one.
    return state not in ("Z", "X") and (now == "0" or started in ("0", now))


def _state(pid: int) -> tuple[str, str]:
    """State of a process and its start in ticks since the machine's; "?" and "0" where the system does not say."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
        return fields[0].decode(), fields[19].decode()
    except (OSError, IndexError):
        return "?", "0"


@functools.cache
def _machine(pid: int) -> int:
    """Check sum of the names of this machine and of its space of process numbers, as a container has its own."""
    name = os.uname().nodename if hasattr(os, "uname") else os.environ.get("COMPUTERNAME", "")
    try:
        space = os.readlink("/proc/self/ns/pid")  # noqa: PTH115
    except OSError:
        space = ""
    return zlib.crc32(f"{name} {space}".encode())
