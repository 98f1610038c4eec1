"""Heights or ranges from a log, and how exact each is at the time of a frame."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import fields
from ..errors import FormatError
from . import height_noise
from .log_columns import Columns, Log, read_log
from .timeline import Timeline, log_times

__all__ = ["Heights"]

F64 = NDArray[np.float64]

COLUMNS = (
    Columns(("height_m",)),
    Columns(("range_m",)),
    Columns(("current_distance",), "PX4"),
    Columns(("Dist",), "ArduPilot"),
)
# Columns of deviations that are read, by that of the values.
_STATED = {"height_m": "height_std_m", "range_m": "range_std_m"}

# Other names of columns that say how exact the heights are: dropped in silence, the heights would seem more exact.
_DEVIATION = re.compile(
    r"(^|_)(std|stdev|stddev|sigma|deviation|var|variance|error|accuracy|uncertainty)(_|$)", re.IGNORECASE
)

# The direction of a range finder that looks down, in PX4 and in ArduPilot, and the state of one that has an echo.
_DOWN, _GOOD = 25, 4


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights over the ground, or ranges to it, by time or by frame, as a CSV file has them.

    Between two rows a height is on the straight line. Its deviation is that of the rows, and what the series is seen to
    be bent: two rows whose noise is independent tell the height between them better than each, what they have in common
    stays, and a bend that straight lines cut off adds. In a hole, a step of more than four usual ones, there is none.

    Attributes
    ----------
    by : {"t_s", "frame"}
        What `keys` are.
    keys : (N,) float64
        Increasing.
    height_m : (N,) float64
        Perpendicular distances from the ground, or ranges along the optical axis; NaN where the file has none.
    std_m : (N,) float64, optional
        Their standard deviations; NaN where a row states none, None where none does.
    kind : {"height", "range"}
        What `height_m` holds.
    remarks : tuple of str
        What was found when the file was read.

    Examples
    --------
    >>> import numpy as np
    >>> heights = Heights("t_s", np.array([0.0, 1.0, 2.0]), np.array([0.2, 0.3, 0.4]), np.full(3, 0.01))
    >>> round(heights.at(frame=7, t_s=0.5), 3), heights.at(frame=7, t_s=3.0)
    (0.25, nan)
    >>> round(heights.std_at(frame=7, t_s=0.5), 4)
    0.01
    """

    by: Literal["t_s", "frame"]
    keys: F64
    height_m: F64
    std_m: F64 | None = None
    kind: Literal["height", "range"] = "height"
    remarks: tuple[str, ...] = ()

    __repr__ = fields

    def __post_init__(self) -> None:
        _checks.choice("by", self.by, ("t_s", "frame"))
        _checks.choice("kind", self.kind, ("height", "range"))
        keys = log_times("keys", self.keys)
        expected = f"({len(keys)},) metres, one for each of keys"
        heights = _checks.array("height_m", self.height_m, (len(keys),), expected).astype(np.float64)
        heights[~(np.isfinite(heights) & (heights > 0))] = np.nan
        object.__setattr__(self, "keys", keys)
        object.__setattr__(self, "height_m", heights)
        if self.std_m is not None:
            std = _checks.array("std_m", self.std_m, (len(keys),), expected).astype(np.float64)
            std[~(np.isfinite(std) & (std >= 0))] = np.nan
            object.__setattr__(self, "std_m", std)

    @classmethod
    def read(cls, path: str | os.PathLike[str], *, std_m: float | None = None) -> Heights:
        """Read a CSV with a column ``height_m`` or ``range_m``, and one of times or ``frame``.

        Times are in ``t_s``, ``t_ms``, ``t_us`` or ``t_ns``. A column ``height_std_m`` (``range_std_m``) has the
        standard deviation of each row. Of PX4's logs (``ulog2csv``) the table ``distance_sensor``
        (``current_distance``, with its ``variance`` and ``signal_quality``) is read with its own times, of ArduPilot's
        (``mavlogdump.py --format csv --types RFND``) ``Dist`` with ``Stat``. Cells are parted by commas, semicolons or
        tabs; decimals have a point; lines that begin with ``#`` are comments. A height of 0, or a range without an
        echo, is one that is not known.

        Parameters
        ----------
        path : path
            The file.
        std_m : float, optional
            Standard deviation of every row, where the file states none.

        Returns
        -------
        Heights

        Raises
        ------
        FormatError
            If a column is missing, a value is no number, keys do not increase, half of the heights are not above 0,
            deviations stand in a column of another name or are given twice, or there is no row; the message names file
            and line.
        OSError
            If the file cannot be read.
        """
        path = _checks.path("path", path)
        std_m = _checks.number_or_none("std_m", std_m, least=0, of="metres")
        log = read_log(path, "heights", COLUMNS, by_frame=True)
        name = log.columns.names[0]
        heights, remarks = _known(log, log.column(name))
        std = _deviations(log, heights, std_m)
        kind: Literal["height", "range"] = "height" if name == "height_m" else "range"
        by: Literal["t_s", "frame"] = "frame" if log.clock == "frame" else "t_s"
        return cls(by, log.t_s, heights, std, kind, (*log.notes, *remarks))

    @property
    def span(self) -> str:
        """What the table covers, in words."""
        if self.by == "t_s":
            return f"times from {self.keys[0]:g} to {self.keys[-1]:g} s"
        return f"{len(self.keys)} frames from {self.keys[0]:g} to {self.keys[-1]:g}, each by its own row"

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know of them, in sentences: their holes, and where they scatter by more than is stated."""
        if self.by != "t_s":
            return self.remarks
        scatter = self._noise.told(f"{self.kind}s")
        return tuple(text for text in (*self.remarks, self._line.told(f"{self.kind}s"), scatter) if text)

    @cached_property
    def _is_known(self) -> NDArray[np.bool_]:
        return np.isfinite(self.height_m)

    @cached_property
    def _line(self) -> Timeline:
        return Timeline.of(self.keys, self._is_known)

    @cached_property
    def _noise(self) -> height_noise.HeightNoise:
        stated = None if self.std_m is None else self.std_m[self._is_known]
        return height_noise.HeightNoise.of(self._line, self.height_m[self._is_known], stated)

    def at(self, *, frame: int, t_s: float) -> float:
        """Height for a frame: the row of its number, or on the line between two times; NaN outside and in a hole.

        Parameters
        ----------
        frame : int
            Number of the frame in its source.
        t_s : float
            Its time in seconds.

        Returns
        -------
        float
            Metres.
        """
        frame, t_s = _place(frame, t_s)
        if self.by == "frame":
            row = self._row(frame)
            return np.nan if row is None else float(self.height_m[row])
        found = self._line.between(t_s)
        if found is None:
            return np.nan
        at, share = found
        heights = self._noise.height_m
        return float(heights[at] if share == 0.0 else (1.0 - share) * heights[at] + share * heights[at + 1])

    def std_at(self, *, frame: int, t_s: float) -> float:
        """Give the standard deviation of `at`; NaN where none was stated for its rows, or there is no height.

        Parameters
        ----------
        frame : int
            Number of the frame in its source.
        t_s : float
            Its time in seconds.

        Returns
        -------
        float
            Metres.
        """
        frame, t_s = _place(frame, t_s)
        if self.std_m is None:
            return np.nan
        if self.by == "frame":
            row = self._row(frame)
            return np.nan if row is None or np.isnan(self.height_m[row]) else float(self.std_m[row])
        found = self._line.between(t_s)
        return np.nan if found is None else self._noise.std_at(*found)

    def _row(self, frame: int) -> int | None:
        place = int(np.searchsorted(self.keys, frame))
        return place if place < len(self.keys) and self.keys[place] == frame else None


def _place(frame: object, t_s: object) -> tuple[int, float]:
    return _checks.integer("frame", frame), _checks.number("t_s", t_s, of="seconds", or_nan=True)


def _known(log: Log, heights: F64) -> tuple[F64, tuple[str, ...]]:
    """Heights with NaN where there is none, and how many that are; half of them or more are an error."""
    name = log.columns.names[0]
    heights = heights.copy()
    wrong = (heights <= 0) | np.isinf(heights)
    if name == "Dist" and (state := log.optional("Stat")) is not None:
        wrong |= state != _GOOD
    if name == "current_distance":
        for limit, below in (("min_distance", True), ("max_distance", False)):
            end = log.optional(limit)
            if end is not None:
                wrong |= (end > 0) & ((heights < end) if below else (heights > end))
        if (quality := log.optional("signal_quality")) is not None:
            wrong |= quality == 0
    for direction in ("orientation", "Orient"):
        if log.columns.origin and (looks := log.optional(direction)) is not None and (looks == _DOWN).any():
            wrong |= looks != _DOWN
    if 2 * wrong.sum() >= len(heights):
        at = int(np.argmax(wrong))
        raise log.table.error(at, f"{name} is {heights[at]:g}, expected metres above 0")
    heights[wrong] = np.nan
    count = int(wrong.sum())
    what = "height above 0" if name == "height_m" else "echo"
    told = f"{count} of {len(heights)} rows of {log.table.path} have no {what}: there the height is not known."
    return heights, (told,) if count else ()


def _deviations(log: Log, heights: F64, std_m: float | None) -> F64 | None:
    """Read the deviation of each row, from its column or as it is given for all."""
    path, names, value = log.table.path, log.table.names, log.columns.names[0]
    own = _STATED.get(value)
    std = None
    if value == "current_distance" and (variance := log.optional("variance")) is not None:
        # PX4 writes 0 where the range finder does not tell its variance.
        std = np.sqrt(np.where(variance > 0, variance, np.nan))
        std = None if np.isnan(std).all() else std
    if own in names:
        std = log.column(own)
        wrong = (std < 0) | np.isinf(std)
        if wrong.any():
            at = int(np.argmax(wrong))
            raise log.table.error(at, f"{own} is {std[at]:g}, expected metres from 0 on")
    elif not log.columns.origin:
        other = next((name for name in names if _DEVIATION.search(name)), None)
        if other is not None:
            raise FormatError(
                f"{path}: got a column {other[:40]}, expected the deviations of {value} in one called {own}, or one "
                "for all rows (height_std_m=, --height-std) and no such column"
            )
    if std_m is None:
        return std
    if own in names:
        raise FormatError(f"{path}: got a column {own} and {std_m:g} m for all rows, expected one of them")
    return np.full(len(heights), std_m)
