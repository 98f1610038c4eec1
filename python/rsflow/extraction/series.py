"""Columns of numbers that grow a row at a time, to be plotted and summed up."""

from __future__ import annotations

import math
import sys
from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["Series", "runs"]


class Series:
    """Columns of float64, eight bytes a value, beside counts of the words in the text columns."""

    def __init__(self, names: Iterable[str], words: Iterable[str] = ()) -> None:
        self._numbers = {name: array("d") for name in names}
        self._words: dict[str, list[str]] = {name: [] for name in words}

    def append(self, row: Mapping[str, object]) -> None:
        """Add a row; a number that is missing or None is NaN."""
        for name, column in self._numbers.items():
            value = row.get(name)
            column.append(float(value) if isinstance(value, (int, float, np.number)) else float("nan"))
        for name, words in self._words.items():
            words.append(str(row.get(name, "")))

    def append_cells(self, columns: Sequence[str], cells: Sequence[str]) -> None:
        """Add a row as a table has it."""
        for name, text in zip(columns, cells, strict=True):
            if name in self._words:
                # Few words stand in many rows.
                self._words[name].append(sys.intern(text))
            else:
                self._numbers[name].append(float(text) if text else math.nan)

    def __len__(self) -> int:
        return max((len(column) for column in self._numbers.values()), default=0)

    def __contains__(self, name: object) -> bool:
        return name in self._numbers

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return np.array(self._numbers[name], np.float64)

    def words(self, name: str) -> list[str]:
        """Give the values of a text column."""
        return self._words[name]

    def counts(self, name: str) -> dict[str, int]:
        """How often each word stands in a text column, the most frequent first."""
        return dict(Counter(self._words[name]).most_common())


def runs(frames: NDArray[np.float64], wanted: NDArray[np.bool_], *, limit: int = 6) -> str:
    """Write the frames where `wanted` holds as ranges: ``3, 7-12, 40``; an ellipsis beyond `limit` ranges."""
    index = np.flatnonzero(wanted)
    if len(index) == 0:
        return ""
    pieces = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
    texts = [
        f"{frames[piece[0]]:.0f}" if len(piece) == 1 else f"{frames[piece[0]]:.0f}-{frames[piece[-1]]:.0f}"
        for piece in pieces[:limit]
    ]
    return ", ".join(texts) + (", ..." if len(pieces) > limit else "")
