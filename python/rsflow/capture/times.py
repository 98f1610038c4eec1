"""Times of frames that a user gives: a list, or a CSV file."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import number, path, shown
from ..errors import CaptureError, DTypeError, FormatError, OptionError, ShapeError
from ..io.time_series import TIME_COLUMNS, doubtful_step, first_wrong, read_table

__all__ = ["given_times"]

_EXPECTED = "one finite time in seconds for each frame"


def given_times(times: Any) -> NDArray[np.float64]:
    """Give the times in seconds, checked: finite and strictly increasing."""
    if isinstance(times, (str, os.PathLike)):
        path("times", times, "times or a CSV file")
        return _times_of_csv(times)
    if isinstance(times, np.ma.MaskedArray) and np.ma.getmaskarray(times).any():
        masked = int(np.argmax(np.ma.getmaskarray(times)))
        raise OptionError(f"times: got a masked value for frame {masked}, expected {_EXPECTED}")
    values = _listed(times)
    if values.ndim != 1:
        raise ShapeError(f"times: got shape {values.shape}, expected {_EXPECTED}")
    if values.dtype.kind not in "iuf" and values.size:
        raise DTypeError(f"times: got dtype {values.dtype}, expected {_EXPECTED}")
    seconds = values.astype(np.float64)
    at = first_wrong(seconds)
    if at is not None and not math.isfinite(seconds[at]):
        raise OptionError(f"times: got {seconds[at]} for frame {at}, expected {_EXPECTED}")
    if at is not None:
        raise OptionError(
            f"times: got {seconds[at]} s for frame {at} after {seconds[at - 1]} s, expected strictly increasing times"
        )
    doubt = doubtful_step(seconds)
    if doubt is not None and doubt[0]:
        raise OptionError(f"times: {doubt[1]}")
    return seconds


def _listed(times: Any) -> NDArray[Any]:
    """Give the values; each of a list must be a number by itself, as numpy would turn text and flags into numbers."""
    if isinstance(times, np.ndarray):
        return times
    try:
        values = list(times)
    except Exception:
        # No list, or one whose own methods fail.
        raise DTypeError(f"times: got {shown(times)}, expected {_EXPECTED}, or a CSV file") from None
    if any(isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim) for value in values):
        raise ShapeError(f"times: got a list of lists or arrays, expected {_EXPECTED}")
    return np.array(
        [number(f"times: frame {place}", value, of="seconds", or_nan=True) for place, value in enumerate(values)]
    )


def _times_of_csv(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    columns = f"a CSV with a column {', '.join(TIME_COLUMNS)}"
    try:
        table = read_table(path, columns=columns)
    except FileNotFoundError:
        raise CaptureError(f"times: no such file: {path}") from None
    name = table.time_name()
    if name is not None:
        return table.times(table.names.index(name), name)
    if table.names or max(len([cell for cell in row if cell]) for row in table.rows) > 1:
        first = ", ".join(table.names or table.rows[0])[:80]
        got = f"the columns {first}" if table.names else f"{len(table.rows[0])} columns without names, {first!r}"
        hint = "" if table.names else " (decimals have a point, not a comma)"
        raise FormatError(f"{path}: got {got}, expected one that is called {' or '.join(TIME_COLUMNS)}{hint}")
    return table.times(0, "t_s")
