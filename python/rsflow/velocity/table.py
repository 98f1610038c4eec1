"""Velocities in files: heights read per frame, a table, a plot."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import fields
from ..errors import DTypeError, FormatError, OptionError
from ..io.atomic import writing
from ..io.time_series import TIME_COLUMNS, first_wrong, read_table
from .result import Velocity

__all__ = ["COLUMNS", "Heights", "plot_velocity", "velocity_row", "write_velocity_csv"]

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
    "height_m",
    "dx_px",
    "dy_px",
    "n_points",
    "status",
    "std_without",
)

# Names of columns that say how exact the heights are: dropped in silence, the heights would seem more exact.
_DEVIATION = re.compile(
    r"(^|_)(std|stdev|stddev|sigma|deviation|var|variance|error|accuracy|uncertainty)(_|$)", re.IGNORECASE
)

# A pause between two heights that is longer than this many usual ones is told.
_PAUSE = 10.0

# Times in video files are rounded, to a millisecond at worst: the last frame may lie that far behind the last row.
_ROUNDING_S = 1e-3


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights over the ground by time or by frame, as a CSV file has them.

    Attributes
    ----------
    by : {"t_s", "frame"}
        What `keys` are.
    keys : (N,) float64
        Increasing.
    height_m : (N,) float64
        NaN where the file has none.

    Examples
    --------
    >>> import numpy as np
    >>> heights = Heights("t_s", np.array([0.0, 1.0]), np.array([0.2, 0.3]))
    >>> round(heights.at(frame=7, t_s=0.5), 3), heights.at(frame=7, t_s=2.0)
    (0.25, nan)
    """

    by: str
    keys: NDArray[np.float64]
    height_m: NDArray[np.float64]

    __repr__ = fields

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Heights:
        """Read a CSV with a column ``height_m`` and a column ``t_s`` (or ``t_ms``, ``t_us``, ``t_ns``) or ``frame``.

        Cells are parted by commas, semicolons or tabs; decimals have a point; lines that begin with ``#`` are comments.

        Parameters
        ----------
        path : path
            The file.

        Returns
        -------
        Heights

        Raises
        ------
        FormatError
            If a column is missing, another has deviations of the heights (an estimator takes one), a value is no
            number, keys do not increase, a height is not above 0, or there is no row; the message names file and line.
        OSError
            If the file cannot be read.
        """
        path = _checks.path("path", path)
        table = read_table(path, columns="height_m and one of t_s, frame")
        by = table.time_name() or ("frame" if "frame" in table.names else None)
        if by is None or "height_m" not in table.names:
            got = f"the columns {', '.join(table.names)[:80]}" if table.names else "no names of columns"
            raise FormatError(
                f"{path}: the first line has {got}, expected height_m and one of {', '.join(TIME_COLUMNS)}, frame"
            )
        stated = next((name for name in table.names if _DEVIATION.search(name)), None)
        if stated is not None:
            raise FormatError(
                f"{path}: got a column {stated[:40]}, expected no deviations, which are not read: give one for "
                "all heights (height_std_m=, --height-std) and leave the column out"
            )
        if not table.rows:
            raise FormatError(f"{path}: no row after the header, expected heights")
        place = table.names.index(by)
        if by == "frame":
            keys = table.numbers(place, by)
            at = first_wrong(keys)
            if at is None and (keys % 1).any():
                at = int(np.argmax(keys % 1 > 0))
            if at is not None:
                raise table.error(at, f"{by} is {keys[at]:g}, expected whole numbers, each later than the one before")
        else:
            keys = table.times(place, by)
        heights = table.numbers(table.names.index("height_m"), "height_m", empty=np.nan)
        wrong = (heights <= 0) | np.isinf(heights)
        if wrong.any():
            at = int(np.argmax(wrong))
            raise table.error(at, f"height_m is {heights[at]:g}, expected metres above 0")
        by = "frame" if by == "frame" else "t_s"
        return cls(by, keys, heights)

    @property
    def span(self) -> str:
        """What the table covers, in words."""
        if self.by == "t_s":
            return f"times from {self.keys[0]:g} to {self.keys[-1]:g} s"
        return f"{len(self.keys)} frames from {self.keys[0]:g} to {self.keys[-1]:g}, each by its own row"

    @property
    def notes(self) -> tuple[str, ...]:
        """Say where heights are much further apart than elsewhere: what is between is taken from a straight line."""
        if self.by != "t_s" or len(self.keys) < 3:
            return ()
        steps = np.diff(self.keys)
        at, usual = int(np.argmax(steps)), float(np.median(steps))
        if steps[at] <= _PAUSE * usual:
            return ()
        return (
            f"The heights have a pause of {steps[at]:.6g} s from {self.keys[at]:.6g} s on, where {usual:.6g} s are "
            "usual: between its ends they are taken from a straight line.",
        )

    def at(self, *, frame: int, t_s: float) -> float:
        """Height for a frame: the row of its number, or between the times before and after it; NaN outside.

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
        frame = _checks.integer("frame", frame)
        t_s = _checks.number("t_s", t_s, of="seconds", or_nan=True)
        if self.by == "t_s":
            first, last = float(self.keys[0]), float(self.keys[-1])
            if not first - _ROUNDING_S <= t_s <= last + _ROUNDING_S:
                return np.nan
            return float(np.interp(t_s, self.keys, self.height_m))
        place = int(np.searchsorted(self.keys, frame))
        return float(self.height_m[place]) if place < len(self.keys) and self.keys[place] == frame else np.nan


def velocity_row(velocity: Velocity, *, frame: int, height_m: float) -> dict[str, Any]:
    """Give the row of the table for one frame: numbers by the names of `COLUMNS`, the status as a word.

    Parameters
    ----------
    velocity : Velocity
        Of the frame.
    frame : int
        Its number.
    height_m : float
        The height it was computed with, in metres; NaN where none was known.

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
    height_m = _checks.number("height_m", height_m, of="metres", or_nan=True)
    known = {**velocity.to_dict(), "frame": frame, "height_m": height_m}
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
    >>> from rsflow.velocity import Velocity, VelocityStatus, velocity_row, write_velocity_csv
    >>> velocity = Velocity(0.1, 0.1, 0.03, 0.0, 0.0, np.eye(3) * 1e-6, VelocityStatus.OK, 90, -4.5, 0.0)
    >>> rows = [velocity_row(velocity, frame=1, height_m=0.2)]
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_velocity_csv(pathlib.Path(folder, "velocity.csv"), rows)
    ...     print(pathlib.Path(folder, "velocity.csv").read_text().splitlines()[0][:30])
    frame,t_s,dt_s,vx_m_s,vy_m_s,v
    """
    path, rows = _checks.path("path", path), _rows(rows)
    with writing(path) as partial, partial.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(COLUMNS) + "\n")
        for row in rows:
            file.write(",".join(_cell(row[name]) for name in COLUMNS) + "\n")


def _cell(value: object) -> str:
    return f"{value + 0.0:.9g}" if isinstance(value, float) else str(value)


def _rows(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Take the rows that `velocity_row` gives."""
    expected = "rows from velocity_row"
    found = list(_checks.iterable("rows", rows, expected))
    for row in found:
        if not isinstance(row, dict) or set(COLUMNS) - set(row):
            raise _checks.refused("rows", row, expected, DTypeError)
    return found


def plot_velocity(path: str | os.PathLike[str], rows: Sequence[dict[str, Any]], *, title: str = "") -> None:
    """Draw the velocity over time with two standard deviations, and the speed over ground.

    Parameters
    ----------
    path : path
        PNG, SVG or PDF, by its suffix.
    rows : sequence of dict
        From `velocity_row`.
    title : str
        Above the plot.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    OptionError
        If there are no rows.

    Examples
    --------
    >>> import rsflow
    >>> from rsflow.velocity import plot_velocity, velocity_row
    >>> flight = rsflow.synthetic.flight(frames=3, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2)
    >>> rows = [
    ...     velocity_row(estimator.update(frame.image, frame.t_s), frame=frame.index, height_m=0.2) for frame in flight
    ... ]
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot_velocity(pathlib.Path(folder, "velocity.svg"), rows, title="a flight")
    ...     pathlib.Path(folder, "velocity.svg").stat().st_size > 10_000
    True
    """
    from .._extras import require

    path = _checks.file_name("path", path, (".png", ".svg", ".pdf"))
    rows = _rows(rows)
    title = _checks.text("title", title)
    if not rows:
        raise OptionError("rows: got none, expected a row for each frame")
    figure_module = require("matplotlib.figure", extra="plot", purpose="drawing the velocity")
    figure = figure_module.Figure(figsize=(9.0, 6.0), layout="constrained")
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    t = np.array([row["t_s"] for row in rows])
    for name, color in (("vx", "C0"), ("vy", "C1"), ("vz", "C2")):
        v = np.array([row[f"{name}_m_s"] for row in rows])
        std = np.array([row[f"{name}_std_m_s"] for row in rows])
        std = np.where(np.isfinite(std), std, np.nan)
        axes.plot(t, v, color=color, linewidth=1.2, marker=".", markersize=3, label=name)
        axes.fill_between(t, v - 2 * std, v + 2 * std, color=color, alpha=0.2, linewidth=0)
    axes.axhline(0.0, color="0.7", linewidth=0.8, zorder=0)
    axes.set_ylabel("velocity of the camera (m/s)")
    band = "band: 2 standard deviations"
    without = next((row["std_without"] for row in rows if row["std_without"]), "")
    if without:
        band += f", without {without.replace('_', ' ').replace('+', ', ')}: not stated"
    # Above the axes, where it covers nothing.
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, title=band, fontsize="small")
    if title:
        axes.set_title(title, loc="left")
    speed = np.hypot([row["vx_m_s"] for row in rows], [row["vy_m_s"] for row in rows])
    below.plot(t, speed, color="0.2", linewidth=1.2, marker=".", markersize=3)
    blind = np.array([not np.isfinite(value) for value in speed])
    blind[0] = False
    if blind.any():
        below.plot(
            t[blind], np.zeros(int(blind.sum())), "x", color="C3", markersize=5, clip_on=False, label="not measured"
        )
        below.legend(loc="upper right", fontsize="small")
    highest = float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0
    below.set_ylim(0.0, 1.3 * highest if highest > 0 else 1.0)
    below.set_ylabel("speed over ground (m/s)")
    below.set_xlabel("time (s)")
    with writing(path) as partial:
        figure.savefig(partial, dpi=120)
