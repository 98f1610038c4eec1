"""Tracks of a sequence as a table: one row for each point and frame."""

from __future__ import annotations

import csv
import os

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._extras import require
from ..io.atomic import writing
from .result import Tracks

__all__ = ["TrackTable"]

# Decimals in a CSV: a thousandth of a pixel is below what any window can tell; a microsecond of time.
_DECIMALS = {"t_s": 6, "x_px": 3, "y_px": 3, "dx_px": 3, "dy_px": 3, "vx_px_s": 2, "vy_px_s": 2}
_DEFAULT_DECIMALS = 4


class TrackTable:
    """One row for each point and frame, in columns.

    Attributes
    ----------
    columns : dict of str to ndarray
        ``frame, t_s, id, age, x_px, y_px, dx_px, dy_px, vx_px_s, vy_px_s, std_x_px, std_y_px, residual, status``:
        position, motion since the frame before, speed, standard deviations of the position, residual in grey levels
        and the status by name. What was not measured is NaN.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> y, x = np.mgrid[0:120, 0:160]
    >>> picture = (120 + 60 * np.sin(x * x / 900 + y / 5) * np.cos(y * y / 700 - x / 6)).astype(np.uint8)
    >>> tracker = rsflow.PointTracker(max_corners=20, record=True)
    >>> for k in range(3):
    ...     tracks = tracker.update(np.roll(picture, 2 * k, axis=1), t_s=0.1 * k)
    >>> table = tracker.to_table()
    >>> speeds = table.columns["vx_px_s"][table.columns["status"] == "tracked"]
    >>> float(np.median(speeds).round())
    20.0
    >>> sorted(set(table.columns["frame"].tolist()))
    [0, 1, 2]
    """

    NAMES = (
        "frame",
        "t_s",
        "id",
        "age",
        "x_px",
        "y_px",
        "dx_px",
        "dy_px",
        "vx_px_s",
        "vy_px_s",
        "std_x_px",
        "std_y_px",
        "residual",
        "status",
    )

    def __init__(self) -> None:
        self._parts: list[dict[str, NDArray[np.generic]]] = []

    def __repr__(self) -> str:
        frames = len({int(part["frame"][0]) for part in self._parts if len(part["frame"])})
        return f"TrackTable({len(self)} rows of {frames} frame{'' if frames == 1 else 's'})"

    def __len__(self) -> int:
        return sum(len(part["frame"]) for part in self._parts)

    def add(self, tracks: Tracks, *, frame: int, t_s: float, dt_s: float) -> None:
        """Add the rows of one frame.

        Parameters
        ----------
        tracks : Tracks
            What `PointTracker.update` gave.
        frame : int
            The frame's index.
        t_s, dt_s : float
            Its time, and the time since the frame before, in seconds; NaN where unknown.
        """
        _checks.instance("tracks", tracks, Tracks, "the Tracks of a PointTracker")
        frame = _checks.integer("frame", frame)
        t_s = _checks.number("t_s", t_s, of="seconds", or_nan=True)
        dt_s = _checks.number("dt_s", dt_s, of="seconds", or_nan=True)
        known = tracks.to_table()
        motion = tracks.displacement
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            speed = motion / dt_s if dt_s > 0 else np.full_like(motion, np.nan)
        count = len(tracks)
        known |= {
            "frame": np.full(count, frame, dtype=np.int64),
            "t_s": np.full(count, t_s, dtype=np.float64),
            "vx_px_s": speed[:, 0],
            "vy_px_s": speed[:, 1],
        }
        self._parts.append({name: known[name] for name in self.NAMES})

    def to_dict(self) -> dict[str, NDArray[np.generic]]:
        """Give the columns, for ``pandas.DataFrame``; the same as `columns`.

        Returns
        -------
        dict of str to ndarray

        Examples
        --------
        >>> import numpy as np, rsflow
        >>> tracker = rsflow.PointTracker(record=True)
        >>> _ = tracker.update(np.zeros((60, 80), np.uint8))
        >>> list(tracker.to_table().to_dict())[:4]
        ['frame', 't_s', 'id', 'age']
        """
        return self.columns

    def clear(self) -> None:
        """Forget all rows."""
        self._parts.clear()

    @property
    def columns(self) -> dict[str, NDArray[np.generic]]:
        """The columns, by name."""
        if not self._parts:
            return {name: np.zeros(0) for name in self.NAMES}
        return {name: np.concatenate([part[name] for part in self._parts]) for name in self.NAMES}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table.

        Parameters
        ----------
        path : path
            ``.csv``, or ``.parquet`` (``pip install 'rsflow-motion[parquet]'``).

        Raises
        ------
        OptionError
            If the suffix is another.
        MissingExtraError
            If pyarrow is not installed and the suffix is ``.parquet``.
        OSError
            If the file cannot be written; an older file of that name then stays.
        """
        path = _checks.file_name("path", path, (".csv", ".parquet"))
        if path.suffix.lower() == ".parquet":
            arrow = require("pyarrow", extra="parquet", purpose="writing Parquet")
            parquet = require("pyarrow.parquet", extra="parquet", purpose="writing Parquet")
            table = arrow.table({name: arrow.array(values) for name, values in self.columns.items()})
            with writing(path) as partial:
                parquet.write_table(table, partial)
        else:
            with writing(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(self.NAMES)
                for part in self._parts:
                    writer.writerows(zip(*(_texts(name, part[name]) for name in self.NAMES), strict=True))


def _texts(name: str, values: NDArray[np.generic]) -> list[str]:
    """Write a column as text."""
    if values.dtype.kind != "f":
        return [str(value) for value in values.tolist()]
    decimals = _DECIMALS.get(name, _DEFAULT_DECIMALS)
    return [f"{value:.{decimals}f}" for value in values.tolist()]
