"""The plots of the page that are of every frame: the displacement, the flow, the light, the velocity."""

from __future__ import annotations

import numpy as np

from ..series import Series
from ..summary import way_of
from .material import Material
from .parts import Plot
from .path_plot import path_plot
from .time_plot import Curve, time_plot
from .velocity_plot import abscissa, axes_text, velocity_plot

__all__ = ["displacement", "flow_plots", "ground_path", "light", "picture_way", "velocities"]


def _told(material: Material) -> tuple[Series, np.ndarray, str, np.ndarray] | None:
    motion = material.series["motion"]
    if len(motion) < 2:
        return None
    valid = np.isfinite(motion["dx_px"])
    valid[0] = True
    return motion, *abscissa(motion), valid


def displacement(material: Material) -> list[Plot]:
    """Draw the displacement from frame to frame."""
    told = _told(material)
    if told is None:
        return []
    motion, x, x_label, valid = told
    drawn = time_plot(
        x,
        [
            Curve("dx, to the right", motion["dx_px"], motion["dx_std_px"]),
            Curve("dy, down", motion["dy_px"], motion["dy_std_px"]),
        ],
        title="displacement over time",
        y_label="px per frame",
        x_label=x_label,
        valid=valid,
        y_least=0.2,
    )
    return [
        Plot(
            "Displacement of the picture from frame to frame",
            drawn,
            "One vector for the whole picture, robust against what moves on its own. Bands are one standard deviation."
            + (" The camera stood still: what is left are errors." if material.still else ""),
        )
    ]


def picture_way(material: Material) -> list[Plot]:
    """Draw where the picture as a whole has gone, where the camera moved."""
    told = _told(material)
    if told is None or material.still:
        return []
    motion, x, x_label, valid = told
    ways = _ways(motion)
    drawn = time_plot(
        x,
        [Curve("x, to the right", *ways[0]), Curve("y, down", *ways[1])],
        title="summed displacement over time",
        y_label="px since the start",
        x_label=x_label,
        valid=valid,
        y_least=1.0,
    )
    return [
        Plot(
            "Where the picture has gone",
            drawn,
            "Sum of the displacements. Where none was measured it goes on with the camera's motion from the dense "
            "flow, else as beside, which is an assumption that its band allows for; it ends where neither is known."
            " Bands are one standard deviation of the sum.",
        )
    ]


def _ways(motion: Series) -> list[tuple[np.ndarray, np.ndarray]]:
    """Sum and its deviation along each axis; NaN from where on they are not known."""
    way = way_of(motion)
    known = np.isfinite(way.variance)
    sums, std = np.where(known, way.sums, np.nan), np.sqrt(np.where(known, way.variance, np.nan))
    return [(sums[:, axis], std[:, axis]) for axis in (0, 1)]


def flow_plots(material: Material) -> list[Plot]:
    """Draw the length of the dense flow, and how much of it is valid and moves."""
    told = _told(material)
    if told is None:
        return []
    motion, x, x_label, _ = told
    length = time_plot(
        x,
        [Curve("median length", motion["flow_median_px"]), Curve("95 % are below", motion["flow_p95_px"])],
        title="length of the dense flow over time",
        y_label="px per frame",
        x_label=x_label,
        floor=0.0,
        y_least=0.2,
    )
    share = time_plot(
        x,
        [
            Curve("motion is valid", 100 * motion["flow_valid_share"]),
            Curve("moves on its own", 100 * motion["moving_share"]),
        ],
        title="share of valid flow and of moving pixels over time",
        y_label="% of the picture",
        x_label=x_label,
        floor=0.0,
        y_least=5.0,
    )
    return [
        Plot("How far single pixels move (dense flow)", length),
        Plot("How much of the picture is measured, how much moves", share),
    ]


def light(material: Material) -> list[Plot]:
    """Draw how the light changed, where that is known."""
    told = _told(material)
    if told is None or not np.isfinite(told[0]["gain"]).any():
        return []
    motion, x, x_label, valid = told
    # Contrast changes multiply from frame to frame; a change is shown in per cent of the frame before.
    drawn = time_plot(
        x,
        [Curve("contrast", 100 * (motion["gain"] - 1.0))],
        title="change of contrast over time",
        y_label="%",
        x_label=x_label,
        valid=valid,
        y_least=2.0,
    )
    return [
        Plot(
            "Change of light from frame to frame",
            drawn,
            "What the displacement allows for; without it, a change of light would be taken for motion.",
        )
    ]


def velocities(material: Material) -> list[Plot]:
    """Draw the velocity of the camera over the ground, where one was asked for."""
    velocity = material.series.get("velocity")
    if velocity is None or len(velocity) < 2:
        return []
    mounted = material.mounted
    return [
        Plot("Velocity of the camera over the ground", velocity_plot(velocity, mounted=mounted), axes_text(mounted))
    ]


def ground_path(material: Material) -> list[Plot]:
    """Draw the path of the camera over the ground, likewise."""
    path = material.series.get("trajectory")
    if path is None or len(path) < 2:
        return []
    drawn = path_plot(path["x_m"], path["y_m"], title="path over the ground", x_label="x in m", y_label="y in m")
    return [
        Plot(
            "Path of the camera over the ground",
            drawn,
            "Sum of velocity times time, in the same axes at the start, made level where straight down is known. Over a"
            " gap the velocity is carried on from before it to after it; the deviations of trajectory.csv grow by what"
            " that may be wrong.",
        )
    ]
