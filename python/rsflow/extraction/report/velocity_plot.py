"""The velocity over time, with its band: for the report page, and as a file of its own."""

from __future__ import annotations

import numpy as np

from ..series import Series
from .drawing import Drawing
from .time_plot import Curve, time_plot

__all__ = ["abscissa", "axes_text", "velocity_plot"]

# Beyond this times are in minutes.
_LONG_S = 600.0


def abscissa(series: Series) -> tuple[np.ndarray, str]:
    """Give what plots are over, and its label: times, or numbers of frames where the source has no times."""
    t = series["t_s"]
    if not np.isfinite(t).all():
        return series["frame"], "number of the frame"
    if len(t) and t[-1] - t[0] > _LONG_S:
        return t / 60, "time in min"
    return t, "time in s"


def velocity_plot(velocity: Series, *, mounted: bool) -> Drawing:
    """Draw the three velocities; `mounted` says that their axes are a body's and not the picture's."""
    x, x_label = abscissa(velocity)
    valid = np.isfinite(velocity["vx_m_s"])
    valid[0] = True
    names = ("vx", "vy", "vz") if mounted else ("vx, right", "vy, down in the picture", "vz, along the line of sight")
    curves = [
        Curve(name, velocity[f"v{axis}_m_s"], velocity[f"v{axis}_std_m_s"])
        for name, axis in zip(names, "xyz", strict=True)
    ]
    return time_plot(x, curves, title="velocity over time", y_label="m/s", x_label=x_label, valid=valid, y_least=1e-3)


def axes_text(mounted: bool) -> str:
    """Say in which axes velocities are, and what the bands are."""
    axes = "In the axes of the body that the camera is mounted on."
    if not mounted:
        axes = (
            "In the camera's axes: a camera that moves to its right has vx above 0 while the picture flows to the left."
        )
    return f"{axes} Bands are one standard deviation."
