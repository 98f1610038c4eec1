"""Which columns of a log hold what: our own names, and those of PX4's and ArduPilot's exports."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from ..io.time_series import TIME_COLUMNS, Table, first_wrong, read_table

__all__ = ["ORIGINS", "Columns", "Log", "read_log"]

F64 = NDArray[np.float64]

# Whose tables are known; "" has our own names.
ORIGINS = ("", "PX4", "ArduPilot")

# Names of columns of times in microseconds, the first that is there counts: when a value was measured, when it was
# logged. A log of both PX4 and ArduPilot counts them since the autopilot was started.
_CLOCKS = {"PX4": ("timestamp_sample", "timestamp"), "ArduPilot": ("SampleUS", "TimeUS")}
_MICROSECONDS = 1e6
# Several sensors of one kind stand in one table of ArduPilot's, told apart by this column.
_INSTANCES = ("I", "Instance")


@dataclass(frozen=True)
class Columns:
    """Columns that belong together.

    Attributes
    ----------
    names : tuple of str
    origin : {"", "PX4", "ArduPilot"}
        Whose names they are; those programs count time in columns of their own, and in axes forward, right, down.
    """

    names: tuple[str, ...]
    origin: str = ""

    def __str__(self) -> str:
        return f"{', '.join(self.names)}{f' ({self.origin})' if self.origin else ''}"


@dataclass(frozen=True)
class Log:
    """A table whose columns of values and of times are known.

    Attributes
    ----------
    table : Table
    columns : Columns
    clock : str
        Name of the column of times; or ``frame``.
    t_s : (N,) float64
        Times in seconds; or numbers of frames.
    notes : tuple of str
        Which of several sensors was taken.
    """

    table: Table
    columns: Columns
    clock: str
    t_s: F64
    notes: tuple[str, ...] = ()

    def column(self, name: str) -> F64:
        """Give a column as numbers, NaN where a cell is empty."""
        return self.table.numbers(self.table.names.index(name), name, empty=np.nan)

    def optional(self, name: str) -> F64 | None:
        """Give a column as `column` does, or None where the table has none of that name."""
        return self.column(name) if name in self.table.names else None

    def values(self) -> F64:
        """Give the columns of values side by side, (N, names)."""
        return np.stack([self.column(name) for name in self.columns.names], axis=1)


def read_log(path: str | os.PathLike[str], what: str, known: Sequence[Columns], *, by_frame: bool = False) -> Log:
    """Read a CSV with one of the sets of columns that are known, the first that is there.

    Parameters
    ----------
    path : path
        The file.
    what : str
        What is read, in the plural, for messages.
    known : sequence of Columns
        The names that may be there.
    by_frame : bool
        Whether a column ``frame`` serves in place of times.

    Raises
    ------
    FormatError
        If a column is missing, a value is no number, times do not increase, or there is no row; the message names file
        and line.
    OSError
        If the file cannot be read.
    """
    table = read_table(path, columns=_expected(known, by_frame))
    found = next((columns for columns in known if set(columns.names) <= set(table.names)), None)
    clock = None if found is None else _clock(table, found.origin, by_frame)
    if found is None or clock is None:
        got = f"the columns {', '.join(table.names)[:80]}" if table.names else "no names of columns"
        raise FormatError(f"{path}: the first line has {got}, expected {_expected(known, by_frame)}")
    if not table.rows:
        raise FormatError(f"{path}: no row after the header, expected {what}")
    table, notes = _one_instance(table) if found.origin == "ArduPilot" else (table, ())
    if clock == "frame":
        return Log(table, found, clock, _frames(table), notes)
    place = table.names.index(clock)
    return Log(table, found, clock, table.times(place, clock, per_second=TIME_COLUMNS.get(clock, _MICROSECONDS)), notes)


def _expected(known: Sequence[Columns], by_frame: bool) -> str:
    own = next(columns for columns in known if not columns.origin)
    more = "; or a table of PX4's or ArduPilot's, see docs/how-to/sensor_logs.md"
    others = [str(columns) for columns in known if not columns.origin and columns is not own]
    names = " or ".join([str(own), *others])
    return f"{names} and one of {', '.join(TIME_COLUMNS)}{', frame' if by_frame else ''}{more}"


def _clock(table: Table, origin: str, by_frame: bool) -> str | None:
    """Name of the column of times, or None."""
    own = table.time_name() or ("frame" if by_frame and "frame" in table.names else None)
    if own is not None:
        return own
    for name in _CLOCKS.get(origin, ()):
        # PX4 leaves the time of a sample at 0 in messages that have none.
        if name in table.names and (name == _CLOCKS[origin][-1] or _increases(table, name)):
            return name
    return None


def _increases(table: Table, name: str) -> bool:
    try:
        return first_wrong(table.numbers(table.names.index(name), name)) is None
    except FormatError:
        return False


def _frames(table: Table) -> F64:
    keys = table.numbers(table.names.index("frame"), "frame")
    at = first_wrong(keys)
    if at is None and (keys % 1).any():
        at = int(np.argmax(keys % 1 > 0))
    if at is not None:
        raise table.error(at, f"frame is {keys[at]:g}, expected whole numbers, each later than the one before")
    return keys


def _one_instance(table: Table) -> tuple[Table, tuple[str, ...]]:
    """Take the rows of the first sensor, where the table has several."""
    name = next((name for name in _INSTANCES if name in table.names), None)
    if name is None:
        return table, ()
    numbers = table.numbers(table.names.index(name), name)
    first = numbers[0]
    if (numbers == first).all():
        return table, ()
    taken = [number for number, value in enumerate(numbers) if value == first]
    less = dataclasses.replace(table, lines=[table.lines[k] for k in taken], rows=[table.rows[k] for k in taken])
    others = ", ".join(f"{value:g}" for value in np.unique(numbers[numbers != first])[:8])
    return less, (f"{table.path} has several sensors: {name} {first:g} was taken, not {others}.",)
