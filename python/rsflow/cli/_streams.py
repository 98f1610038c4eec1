"""Standard streams as a command finds them: closed, as under cron; broken, as by ``| head``; of a narrow encoding."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO

__all__ = ["give_up_output", "printable", "usable_streams"]


class _Messages:
    """Standard error that never fails: what nobody can read must not end the work."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write, if there still is somewhere to write to."""
        try:
            self._stream.write(text)
        except (OSError, ValueError):
            _lead_nowhere(self._stream)
        return len(text)

    def flush(self) -> None:
        """Flush, if there still is somewhere to write to."""
        try:
            self._stream.flush()
        except (OSError, ValueError):
            _lead_nowhere(self._stream)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def usable_streams() -> Iterator[None]:
    """Have standard streams that can be written to, and restore those there were.

    A closed one leads nowhere: were its number left free, the next file that is opened would get it, and messages of
    OpenCV or of a video library would be written into that file. What an encoding cannot say is escaped.
    """
    before = sys.stdin, sys.stdout, sys.stderr
    made: list[TextIO] = []
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            with contextlib.suppress(OSError):
                _hold(number)
            made.append(open(os.devnull, "w" if number else "r", encoding="utf-8"))  # noqa: PTH123, SIM115
            setattr(sys, name, made[-1])
    errors = [_escape(stream, "backslashreplace") for stream in (sys.stdout, sys.stderr)]
    sys.stderr = _Messages(sys.stderr)
    try:
        yield
    finally:
        sys.stdin, sys.stdout, sys.stderr = before
        for stream, old in zip((sys.stdout, sys.stderr), errors, strict=True):
            _escape(stream, old)
        for stream in made:
            stream.close()


def _escape(stream: TextIO | None, errors: str | None) -> str | None:
    """Set what a stream does with what its encoding cannot say, and give what it did before."""
    before: str | None = getattr(stream, "errors", None)
    reconfigure = getattr(stream, "reconfigure", None)
    if errors is not None and reconfigure is not None:
        with contextlib.suppress(OSError, ValueError):
            reconfigure(errors=errors)
    return before


def _hold(number: int) -> None:
    """Lead a file descriptor that is closed to nowhere."""
    try:
        os.fstat(number)
    except OSError:
        # The lowest free number is taken: those below are open already.
        os.open(os.devnull, os.O_RDWR)


def give_up_output() -> None:
    """Lead standard output nowhere, so that the interpreter does not fail on what is still buffered at its end."""
    _lead_nowhere(sys.stdout)


def _lead_nowhere(stream: TextIO) -> None:
    with contextlib.suppress(OSError, ValueError):
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, stream.fileno())
        os.close(nothing)


def printable(text: str) -> str:
    r"""Give `text` on one line, with what would move a terminal's cursor escaped.

    Examples
    --------
    >>> printable("a\nb \x1b[31m")
    'a b \\x1b[31m'
    """
    return "".join(mark if mark.isprintable() else repr(mark)[1:-1] for mark in " ".join(text.split()))
