"""CSV files of values over time or by frame: times of frames, heights, rates.

One reader for all, so that each accepts and refuses the same: UTF-8 with or without a byte order mark, any line ends,
cells parted by commas, semicolons or tabs, comments from ``#`` to the end of a line that begins with it, blank lines.
Decimals have a point. A column of times says its unit: ``t_s``, ``t_ms``, ``t_us`` or ``t_ns``.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from .limits import read_text

__all__ = ["TIME_COLUMNS", "Table", "doubtful_step", "first_wrong", "read_table"]

# Names of columns of times, and how many of their unit make a second.
TIME_COLUMNS: dict[str, float] = {"t_s": 1.0, "t_ms": 1e3, "t_us": 1e6, "t_ns": 1e9}

# Seconds between two rows that no recording has (two weeks; a tenth of a microsecond), and that few have: milliseconds
# of up to 200 pictures a second, taken for seconds, are 5 s apart or more.
_LONGEST_STEP_S = 1.2e6
_SHORTEST_STEP_S = 1e-7
_DOUBTFUL_STEP_S = 5.0

_CELLS = 4096


@dataclass(frozen=True)
class Table:
    """The cells of a CSV file.

    Attributes
    ----------
    path : Path
        The file.
    names : tuple of str
        Of the columns; empty where the file has no header.
    lines : list of int
        Line of the file on which each row stands, from 1.
    rows : list of list of str
        Cells without the blanks around them.
    """

    path: Path
    names: tuple[str, ...]
    lines: list[int]
    rows: list[list[str]]

    def time_name(self) -> str | None:
        """Give the name of the column of times, or None."""
        return next((name for name in TIME_COLUMNS if name in self.names), None)

    def numbers(self, place: int, name: str, *, empty: float | None = None) -> NDArray[np.float64]:
        """Give a column as numbers.

        Parameters
        ----------
        place : int
            Of the column.
        name : str
            For messages.
        empty : float, optional
            What an empty or missing cell stands for; None refuses it.

        Raises
        ------
        FormatError
            If a cell is no number; the message says its line, and that of a decimal comma.
        """
        values = np.empty(len(self.rows))
        for number, row in enumerate(self.rows):
            text = row[place] if place < len(row) else ""
            if not text and empty is not None:
                values[number] = empty
                continue
            try:
                values[number] = _number(text)
            except ValueError:
                hint = ": decimals have a point, not a comma" if _has_decimal_comma(text) else ""
                unit = " in seconds" if name == "t_s" else ""
                what = f"a time{unit}" if name in TIME_COLUMNS else f"a number for {name}"
                raise self.error(number, f"got {text[:40]!r}, expected {what}{hint}") from None
        return values

    def times(self, place: int, name: str, *, per_second: float | None = None) -> NDArray[np.float64]:
        """Give a column of times in seconds: finite, strictly increasing, in steps that may be.

        `per_second` says how many of its unit make a second, where the name does not.
        """
        values = self.numbers(place, name)
        wrong = first_wrong(values)
        if wrong is not None:
            at = self.rows[wrong][place]
            before = f" after {self.rows[wrong - 1][place]}" if wrong and math.isfinite(values[wrong]) else ""
            kind = "strictly increasing times" if before else "a finite time"
            raise self.error(wrong, f"{name}: got {at}{before}, expected {kind}")
        seconds = values / (TIME_COLUMNS[name] if per_second is None else per_second)
        doubt = doubtful_step(seconds)
        if doubt is not None and doubt[0]:
            raise FormatError(
                f"{self.path}: {name}: {doubt[1]}: name the column by its unit, {', '.join(TIME_COLUMNS)}"
            )
        return seconds

    def error(self, number: int, text: str) -> FormatError:
        """Make the error for a row."""
        return FormatError(f"{self.path}: row {self.lines[number]}: {text}")


def read_table(path: str | os.PathLike[str], *, columns: str) -> Table:
    """Read a CSV file.

    Parameters
    ----------
    path : path
        The file.
    columns : str
        What is expected in it, for messages.

    Raises
    ------
    FormatError
        If it is no regular file, no text, too long, has no row, or a row has more cells than the header.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    text = read_text(path)
    lines: list[int] = []
    rows: list[list[str]] = []
    delimiter = _delimiter(text)
    reader = csv.reader(_without_comments(text), delimiter=delimiter, strict=True)
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                lines.append(reader.line_num)
                rows.append([cell.strip() for cell in row])
                if len(row) > _CELLS:
                    raise FormatError(f"{path}: row {reader.line_num}: got {len(row)} cells, expected {columns}")
    except csv.Error as error:
        raise FormatError(f"{path}: row {reader.line_num}: not a CSV file: {error}") from None
    if not rows:
        raise FormatError(f"{path}: got an empty file, expected {columns}")
    names: tuple[str, ...] = ()
    if not all(_is_number(cell) or _has_decimal_comma(cell) for cell in rows[0] if cell):
        names = tuple(rows.pop(0))
        lines.pop(0)
        double = next((name for place, name in enumerate(names) if name and name in names[:place]), None)
        if double is not None:
            raise FormatError(f"{path}: got two columns that are called {double[:40]!r}, expected {columns}")
    table = Table(path, names, lines, rows)
    width = len(names) or len(rows[0])
    for number, row in enumerate(rows):
        if len(row) > width and any(row[width:]):
            hint = _comma_hint(row) if delimiter == "," else ""
            shown = ",".join(row)[:60]
            raise table.error(number, f"got {len(row)} cells, {shown!r}, expected {width}{hint}")
    return table


def first_wrong(times: NDArray[np.float64]) -> int | None:
    """Give the place of the first time that is not finite, or not later than the one before; None where all are."""
    wrong = ~np.isfinite(times)
    with np.errstate(invalid="ignore"):
        wrong[1:] |= ~(np.diff(times) > 0)
    return int(np.argmax(wrong)) if wrong.any() else None


def doubtful_step(seconds: NDArray[np.float64]) -> tuple[bool, str] | None:
    """Say whether the steps between times are in another unit, surely (True) or perhaps; None where they are not."""
    if len(seconds) < 2:
        return None
    steps = np.diff(seconds)
    # The median would hide one that is wrong.
    at, step, usual = int(np.argmax(steps)), float(steps.max()), float(np.median(steps))
    where = f"{step:.6g} s from one to the next, after number {at}"
    if step > _LONGEST_STEP_S:
        return True, f"got {where}, which are not seconds (nanoseconds?), expected times in seconds"
    if steps.min() < _SHORTEST_STEP_S:
        at = int(np.argmin(steps))
        return True, f"got {steps[at]:.6g} s from one to the next, after number {at}, expected times in seconds"
    if usual > _DOUBTFUL_STEP_S:
        return False, f"{usual:.6g} s from one to the next: are they microseconds or milliseconds?"
    if step > _DOUBTFUL_STEP_S:
        return False, f"{where}, where {usual:.6g} s are usual: a pause, or a wrong time?"
    return None


def _delimiter(text: str) -> str:
    """Semicolon or tab where the first line that is no comment has one, else comma."""
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            return next((mark for mark in (";", "\t") if mark in line), ",")
    return ","


def _without_comments(text: str) -> list[str]:
    # Blank lines take the place of comments, so that the numbers of lines stay.
    lines = text.splitlines(keepends=True)
    return ["\n" if line.lstrip().startswith("#") else line for line in lines]


def _number(text: str) -> float:
    # float() also takes 1_000 and digits of other scripts, which no program writes.
    if "_" in text or not text.isascii():
        raise ValueError(text)
    return float(text)


def _is_number(text: str) -> bool:
    try:
        _number(text)
    except ValueError:
        return False
    return True


def _has_decimal_comma(text: str) -> bool:
    whole, comma, part = text.partition(",")
    return bool(comma) and whole.lstrip("+-").isdigit() and part.isdigit()


def _comma_hint(cells: Sequence[Any]) -> str:
    pairs = zip(cells[0::2], cells[1::2], strict=False)
    return ": decimals have a point, not a comma" if any(_has_decimal_comma(f"{a},{b}") for a, b in pairs) else ""
