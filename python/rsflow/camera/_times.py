"""Times of frames that a user gives: a list, or a CSV file."""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CaptureError, FormatError, OptionError


def given_times(times: Any) -> NDArray[np.float64]:
    """Give the times in seconds, checked: finite and strictly increasing."""
    where = "times"
    if isinstance(times, (str, os.PathLike)):
        where = str(times)
        values = _times_of_csv(Path(times))
    else:
        values = np.asarray(times, dtype=np.float64)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise OptionError(f"{where}: got shape {values.shape}, expected one finite time in seconds for each frame")
    back = np.flatnonzero(np.diff(values) <= 0)
    if back.size:
        i = int(back[0])
        raise OptionError(
            f"{where}: got {values[i + 1]} s for frame {i + 1} after {values[i]} s, expected strictly increasing times"
        )
    return values


def _times_of_csv(path: Path) -> NDArray[np.float64]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row and not row[0].lstrip().startswith("#")]
    except FileNotFoundError:
        raise CaptureError(f"times: no such file: {path}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path}: not a CSV file: {error}") from None
    if not rows:
        raise FormatError(f"{path}: got an empty file, expected a CSV with a column t_s")
    header = [cell.strip() for cell in rows[0]]
    column = header.index("t_s") if "t_s" in header else None
    if column is None and len(header) > 1:
        raise FormatError(f"{path}: got the columns {', '.join(header)}, expected one that is called t_s")
    values = []
    for number, row in enumerate(rows[0 if column is None else 1 :], start=1 if column is None else 2):
        try:
            values.append(float(row[column or 0]))
        except (ValueError, IndexError):
            raise FormatError(f"{path}: row {number}: got {','.join(row)!r}, expected a time in seconds") from None
    return np.array(values)
