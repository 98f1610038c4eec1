"""Velocities in a table: a row a frame."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from .. import _checks
from ..errors import DTypeError
from ..io.atomic import writing
from .result import Velocity

__all__ = ["COLUMNS", "table_rows", "velocity_row", "write_velocity_csv", "write_velocity_parquet"]

COLUMNS: tuple[str, ...] = (
    "frame",
    "t_s",
    "dt_s",
    "vx_m_s",
    "vy_m_s",
    "vz_m_s",
    "vx_std_m_s",
    "vy_std_m_s",
    "vz_std_m_s",
    "cov_xy_m2_s2",
    "cov_xz_m2_s2",
    "cov_yz_m2_s2",
    "height_m",
    "height_std_m",
    "rate_x_rad_s",
    "rate_y_rad_s",
    "rate_z_rad_s",
    "rate_x_std_rad_s",
    "rate_y_std_rad_s",
    "rate_z_std_rad_s",
    "dx_px",
    "dy_px",
    "n_points",
    "status",
    "std_without",
    "doubts",
)

_COVARIANCES = {"cov_xy_m2_s2": (0, 1), "cov_xz_m2_s2": (0, 2), "cov_yz_m2_s2": (1, 2)}


def velocity_row(velocity: Velocity, *, frame: int, height_m: float | None = None) -> dict[str, Any]:
    """Give the row of the table for one frame: numbers by the names of `COLUMNS`, the status as a word.

    Parameters
    ----------
    velocity : Velocity
        Of the frame.
    frame : int
        Its number.
    height_m : float, optional
        The height in metres, NaN where none was known; by default that of the velocity.

    Returns
    -------
    dict
        A value for each of `COLUMNS`.

    Examples
    --------
    >>> import rsflow
    >>> from rsflow.velocity import velocity_row
    >>> flight = rsflow.synthetic.flight(frames=3, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2)
    >>> rows = [
    ...     velocity_row(estimator.update(frame.image, frame.t_s), frame=frame.index, height_m=0.2) for frame in flight
    ... ]
    >>> [(row["frame"], row["status"]) for row in rows]
    [(0, 'first_frame'), (1, 'ok'), (2, 'ok')]
    """
    _checks.instance("velocity", velocity, Velocity, "a Velocity")
    frame = _checks.integer("frame", frame)
    height_m = _checks.number_or_none("height_m", height_m, of="metres", or_nan=True)
    known: dict[str, Any] = {**velocity.to_dict(), "frame": frame, "doubts": "; ".join(velocity.doubts)}
    known |= {"height_m": velocity.height_m if height_m is None else height_m, "height_std_m": velocity.height_std_m}
    for axis, rate, variance in zip("xyz", velocity.rate_rad_s, np.diag(velocity.rate_covariance), strict=True):
        known |= {f"rate_{axis}_rad_s": float(rate), f"rate_{axis}_std_rad_s": float(np.sqrt(variance))}
    for name, (i, k) in _COVARIANCES.items():
        known[name] = float(velocity.covariance[i, k])
    return {name: known[name] for name in COLUMNS}


def write_velocity_csv(path: str | os.PathLike[str], rows: Sequence[dict[str, Any]]) -> None:
    """Write rows of `velocity_row` as CSV, numbers with 9 digits, ``nan`` and ``inf`` by name.

    Parameters
    ----------
    path : path
        The file; its folder is made if it is missing.
    rows : sequence of dict
        From `velocity_row`.

    Raises
    ------
    OSError
        If the file cannot be written; one of that name stays as it was.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.velocity import Velocity, VelocityStatus, velocity_row, write_velocity_csv
    >>> velocity = Velocity(0.1, 0.1, 0.03, 0.0, 0.0, np.eye(3) * 1e-6, VelocityStatus.OK, 90, -4.5, 0.0)
    >>> rows = [velocity_row(velocity, frame=1, height_m=0.2)]
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_velocity_csv(pathlib.Path(folder, "velocity.csv"), rows)
    ...     print(pathlib.Path(folder, "velocity.csv").read_text().splitlines()[0][:30])
    frame,t_s,dt_s,vx_m_s,vy_m_s,v
    """
    path, rows = _checks.path("path", path), table_rows(rows)
    with writing(path) as partial, partial.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(COLUMNS) + "\n")
        for row in rows:
            file.write(",".join(_cell(row[name]) for name in COLUMNS) + "\n")


def write_velocity_parquet(path: str | os.PathLike[str], rows: Sequence[dict[str, Any]]) -> None:
    """Write rows of `velocity_row` as Parquet, with the columns of the CSV; numbers keep all their digits.

    Parameters
    ----------
    path : path
        The file; its folder is made if it is missing.
    rows : sequence of dict
        From `velocity_row`.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed (``pip install 'rsflow-motion[parquet]'``).
    OSError
        If the file cannot be written; one of that name stays as it was.

    Examples
    --------
    >>> import numpy as np, pathlib, tempfile
    >>> from rsflow.velocity import Velocity, VelocityStatus, velocity_row, write_velocity_parquet
    >>> velocity = Velocity(0.1, 0.1, 0.03, 0.0, 0.0, np.eye(3) * 1e-6, VelocityStatus.OK, 90, -4.5, 0.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "velocity.parquet")
    ...     write_velocity_parquet(path, [velocity_row(velocity, frame=1, height_m=0.2)])
    ...     path.read_bytes()[:4]
    b'PAR1'
    """
    from .._extras import require

    path, rows = _checks.path("path", path), table_rows(rows)
    arrow = require("pyarrow", extra="parquet", purpose="writing Parquet")
    parquet = require("pyarrow.parquet", extra="parquet", purpose="writing Parquet")
    table = arrow.table({name: [row[name] for row in rows] for name in COLUMNS})
    with writing(path) as partial:
        parquet.write_table(table, partial)


def _cell(value: object) -> str:
    if isinstance(value, float):
        return f"{value + 0.0:.9g}"
    text = str(value)
    return '"' + text.replace('"', '""') + '"' if any(mark in text for mark in ',"\n') else text


def table_rows(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Take the rows that `velocity_row` gives."""
    expected = "rows from velocity_row"
    found = list(_checks.iterable("rows", rows, expected))
    for row in found:
        if not isinstance(row, dict) or set(COLUMNS) - set(row):
            raise _checks.refused("rows", row, expected, DTypeError)
    return found
