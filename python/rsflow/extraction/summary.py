"""The key figures of an extraction, from its columns: for summary.json, and what is said of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .gaps import MEASURED, NEIGHBOURS, SECOND, Filled, fill
from .probe import STILL_PX
from .series import Series

__all__ = ["as_json", "camera_figures", "duration_s", "key_figures", "way_of"]

# A camera that stood still moved more than twice what one at rest does in no more than this share of the pairs.
_RARELY = 0.05


def as_json(value: Any) -> Any:
    """Make a value JSON can say: NaN and infinity become None, arrays and numpy numbers plain."""
    if isinstance(value, dict):
        return {str(name): as_json(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_json(item) for item in value]
    if isinstance(value, np.ndarray):
        return as_json(value.tolist())
    if isinstance(value, np.generic):
        return as_json(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def duration_s(motion: Series) -> float:
    """Time from the first frame to the last, NaN without times."""
    t = motion["t_s"]
    t = t[np.isfinite(t)]
    return float(t[-1] - t[0]) if len(t) else math.nan


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values[np.isfinite(values)]


def _median(values: NDArray[np.float64]) -> float:
    values = _finite(values)
    return float(np.median(values)) if len(values) else math.nan


def _mean(values: NDArray[np.float64]) -> float:
    values = _finite(values)
    return float(values.mean()) if len(values) else math.nan


def key_figures(motion: Series, velocity: Series | None, trajectory: Series | None) -> dict[str, Any]:
    """Sum up the columns.

    Returns
    -------
    dict
        ``frames``, ``measured``, ``duration_s``, ``displacement_sum_px`` with its deviation and what it rests on,
        medians and shares, counts of the statuses; with a velocity ``speed_median_m_s``, ``velocity_measured``.
    """
    dx, dy = motion["dx_px"], motion["dy_px"]
    statuses = motion.counts("status")
    length = np.hypot(dx, dy)
    fastest = int(np.nanargmax(length)) if np.isfinite(length).any() else None
    way = way_of(motion)
    figures: dict[str, Any] = {
        "frames": len(motion),
        "measured": int(np.isfinite(dx).sum()),
        "duration_s": duration_s(motion),
        **_sum_figures(motion, way),
        "displacement_median_px": _median(length),
        "displacement_max_px": float(length[fastest]) if fastest is not None else math.nan,
        "displacement_max_frame": int(motion["frame"][fastest]) if fastest is not None else None,
        "displacement_std_median_px": _median(np.hypot(motion["dx_std_px"], motion["dy_std_px"]) / math.sqrt(2.0)),
        "flow_median_px": _median(motion["flow_median_px"]),
        "flow_valid_share": _mean(motion["flow_valid_share"]),
        "moving_share": _mean(motion["moving_share"]),
        "moving_share_max": float(np.nanmax(motion["moving_share"], initial=0.0)),
        "statuses": statuses,
        "segmentation_statuses": motion.counts("segmentation_status"),
    }
    if velocity is not None:
        speed = np.hypot(velocity["vx_m_s"], velocity["vy_m_s"])
        figures |= {
            "velocity_measured": int(np.isfinite(speed).sum()),
            "velocity_statuses": velocity.counts("status"),
            "speed_median_m_s": _median(speed),
            "speed_max_m_s": float(np.nanmax(speed)) if np.isfinite(speed).any() else math.nan,
            "speed_std_median_m_s": _median(np.hypot(velocity["vx_std_m_s"], velocity["vy_std_m_s"]) / math.sqrt(2.0)),
        }
    if trajectory is not None and len(trajectory):
        figures["trajectory_segments"] = int(np.nanmax(trajectory["segment"], initial=0))
        # Where the camera was last, as far as it is known.
        for name in ("x_m", "y_m"):
            known = _finite(trajectory[name])
            figures[f"end_{name}"] = float(known[-1]) if len(known) else math.nan
    return figures


def way_of(motion: Series) -> Filled:
    """Fill the displacements that were not measured: from the dense flow's camera, else from their neighbours.

    The first row, of the frame that has none before it, is a step of zero.
    """
    steps = np.stack([motion["dx_px"], motion["dy_px"]], axis=1)
    variance = np.stack([motion["dx_std_px"], motion["dy_std_px"]], axis=1) ** 2
    camera = np.stack([motion["camera_dx_px"], motion["camera_dy_px"]], axis=1)
    # A camera that is taken as resting was not measured.
    camera[[word in ("static", "none", "") for word in motion.words("camera_model")]] = np.nan
    flow = np.stack([motion["flow_median_x_px"], motion["flow_median_y_px"]], axis=1)
    rest = fill(steps[1:], variance[1:], motion["dt_s"][1:], camera[1:], flow[1:])
    first = min(len(motion), 1)
    return Filled(
        np.concatenate([np.zeros((first, 2)), rest.steps]),
        np.concatenate([np.zeros(first, np.int8), rest.source]),
        np.concatenate([np.zeros((first, 2)), rest.variance]),
    )


def _sum_figures(motion: Series, way: Filled) -> dict[str, Any]:
    """Give the sum of the displacements, and how much of it was not measured."""
    missing = way.source != MEASURED
    std = np.sqrt(way.variance[-1]) if len(motion) else np.zeros(2)
    total = way.sums[-1] if len(motion) else np.zeros(2)
    if not np.isfinite(std).all():
        total = np.full(2, math.nan)
    dt = motion["dt_s"]
    return {
        "displacement_sum_px": total.tolist(),
        "displacement_sum_std_px": std.tolist(),
        "displacement_sum_measured_px": [float(np.nansum(motion["dx_px"])), float(np.nansum(motion["dy_px"]))],
        "displacement_unmeasured": int(missing.sum()),
        "displacement_unmeasured_s": float(dt[missing].sum()),
        "displacement_from_dense_flow": way.count(SECOND),
        "displacement_from_neighbours": way.count(NEIGHBOURS),
    }


def camera_figures(motion: Series, decided: str) -> dict[str, Any]:
    """Say whether the camera stood still, and how fast the picture went as a whole otherwise.

    Parameters
    ----------
    motion : Series
    decided : str
        ``"static"`` or ``"moving"``, from the first frames.

    Returns
    -------
    dict
        ``camera_still``; ``picture_speed_unit``, ``picture_speed_median`` and ``picture_speed_std_median``.
    """
    length, dt = np.hypot(motion["dx_px"], motion["dy_px"]), motion["dt_s"]
    std = np.hypot(motion["dx_std_px"], motion["dy_std_px"]) / math.sqrt(2.0)
    known = np.isfinite(length)
    moved = float((length[known] > 2 * STILL_PX).mean()) if known.any() else 1.0
    timed = bool(np.isfinite(dt[known]).all() and (dt[known] > 0).all()) if known.any() else False
    scale = 1.0 / dt if timed else np.ones(len(length))
    return {
        "camera_still": moved <= _RARELY
        and (decided == "static" or float(np.quantile(length[known], 0.75)) < STILL_PX),
        "picture_speed_unit": "px/s" if timed else "px/frame",
        "picture_speed_median": _median(length * scale),
        "picture_speed_std_median": _median(std * scale),
    }
