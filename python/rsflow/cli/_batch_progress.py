"""How far a batch has come, on standard error: a bar by tqdm at a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rsflow.extraction.progress import clock

if TYPE_CHECKING:
    from rsflow.batch import BatchItem

__all__ = ["BatchProgress"]

# Seconds between two plain lines while nothing ends.
_EVERY_S = 30.0


class BatchProgress:
    """Tell of each source that ends, and how far all have come, in sources and fractions of them.

    Parameters
    ----------
    total : int
        Sources.
    quiet : bool
        Tell nothing.
    """

    def __init__(self, total: int, *, quiet: bool) -> None:
        self._total, self._quiet = total, quiet
        self._ended = 0
        self._begin = self._told = time.monotonic()
        self._bar: Any = None
        if not quiet and sys.stderr is not None and sys.stderr.isatty():
            try:
                from tqdm import tqdm
            except ModuleNotFoundError:
                return
            self._bar = tqdm(total=total, desc="batch", unit=" sources", dynamic_ncols=True, bar_format=_BAR)

    def ended(self, item: BatchItem) -> None:
        """Tell what became of a source."""
        self._ended += 1
        if self._quiet:
            return
        error = f": {item.error}" if item.error else ""
        self._line(f"[{self._ended}/{self._total}] {item.source}: {item.status}{error}")

    def advanced(self, done: float, total: int) -> None:
        """Tell how far all have come."""
        if self._bar is not None:
            self._bar.n = round(done, 2)
            self._bar.refresh()
        elif not self._quiet and time.monotonic() - self._told > _EVERY_S and 0 < done < total:
            gone = time.monotonic() - self._begin
            share = done / total
            left = gone / share - gone
            sources = f"{total} source{'' if total == 1 else 's'}"
            percent = math.floor(100 * share)
            self._line(f"rsflow batch: {percent} % of {sources}, {clock(gone)} gone, about {clock(left)} left")

    def _line(self, text: str) -> None:
        self._told = time.monotonic()
        if self._bar is not None:
            self._bar.write(text, file=sys.stderr)
        else:
            print(text, file=sys.stderr, flush=True)

    def __enter__(self) -> BatchProgress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()


_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:g}/{total}{unit} [{elapsed} gone, {remaining} left]"
