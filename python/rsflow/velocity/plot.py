"""The velocity over time as a plot."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import _checks
from ..errors import OptionError
from ..io.atomic import writing
from .table import table_rows

__all__ = ["plot_velocity"]


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
    rows = table_rows(rows)
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
