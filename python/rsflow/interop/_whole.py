"""What is written to a file and appears only when it is whole."""

from __future__ import annotations

import contextlib
from types import TracebackType
from typing import Self


class Whole:
    """A writer for a ``with`` block: closed at its end, and discarded where it ends in an error or is never closed."""

    def close(self) -> None:
        """End it and put it in its place."""
        raise AssertionError

    def discard(self) -> None:
        """End it and keep nothing."""
        raise AssertionError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        else:
            self.discard()

    def __del__(self) -> None:
        # One that was never closed: nothing was finished, and nothing is kept.
        with contextlib.suppress(Exception):
            self.discard()
