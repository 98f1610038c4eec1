"""The key figures of an extraction, from its columns: for summary.json, the closing lines and the report page."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .gaps import MEASURED, NEIGHBOURS, SECOND, Filled, fill
from .probe import STILL_PX
from .series import Series
from .things import thing_text, value_text

__all__ = ["answers", "as_json", "camera_figures", "duration_s", "key_figures", "way_of", "way_text"]

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


def _sum_text(figures: dict[str, Any]) -> str:
    x, y = figures["displacement_sum_px"]
    pairs, missing = max(figures["frames"] - 1, 0), figures["displacement_unmeasured"]
    time = figures["displacement_unmeasured_s"]
    part = f"{missing} of {pairs} pairs" + (f" ({time:.2f} s)" if math.isfinite(time) else "")
    if not math.isfinite(x):
        mx, my = figures["displacement_sum_measured_px"]
        return (
            f"how far the picture went in sum is not known, since {part} could not be measured; the others add up to "
            f"{_signed(mx)} px to the right and {_signed(my)} px down"
        )
    dx, dy = figures["displacement_sum_std_px"]
    if not missing:
        return f"in sum the picture went {_signed(x)} px to the right and {_signed(y)} px down"
    mx, my = figures["displacement_sum_measured_px"]
    seen, carried = figures["displacement_from_dense_flow"], figures["displacement_from_neighbours"]
    origins = [
        *([f"with the camera's motion in the dense flow for {seen} of them"] if seen else []),
        *([f"if the motion went on as beside in {carried} of them, which nothing shows"] if carried else []),
    ]
    return (
        f"where it was measured the picture went {_signed(mx)} px to the right and {_signed(my)} px down; {part} "
        f"could not be measured: in sum about {_signed(x)} px and {_signed(y)} px, with a standard deviation of "
        f"{dx:.2g} and {dy:.2g} px, {' and '.join(origins)}"
    )


def _signed(value: float) -> str:
    return f"{round(value, 2) + 0.0:+.2f}"


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


def answers(figures: dict[str, Any]) -> list[str]:
    """Say the key figures in a few sentences: what moved and how fast, the camera, what that rests on."""
    pairs = max(figures["frames"] - 1, 0)
    measured = [f"{figures['frames']} frame{'' if figures['frames'] == 1 else 's'}"]
    if math.isfinite(figures["duration_s"]):
        measured[0] += f" over {figures['duration_s']:.2f} s"
    measured.append(f"the displacement was measured in {figures['measured']} of {pairs} pairs")
    if math.isfinite(figures["moving_share"]):
        measured.append(f"{100 * figures['moving_share']:.1f} % of the picture moves on its own on average")
    said = [thing_text(figures)] if pairs else []
    if pairs:
        said.append(_camera_text(figures))
    if figures.get("velocity_measured"):
        unstated = figures.get("speed_std_without")
        without = f" without that of {', '.join(unstated)}, which was not stated" if unstated else ""
        said.append(
            f"The camera went at {figures['speed_median_m_s']:.4g} m/s (median, standard deviation of one frame "
            f"{figures['speed_std_median_m_s']:.2g} m/s{without}), {way_text(figures)}."
        )
    return [*said, "; ".join(measured) + "."]


def _camera_text(figures: dict[str, Any]) -> str:
    """Say that the camera stood still, or how the picture went."""
    reason = figures["camera_motion_reason"]
    if figures["camera_still"]:
        # Of a camera at rest a sum of displacements is a sum of errors.
        return f"The camera stood still ({reason})."
    speed, std, unit = (figures[f"picture_speed_{name}"] for name in ("median", "std_median", "unit"))
    went = f"from frame to frame the picture went at {value_text(speed, std, unit)} (median); " if speed > 0 else ""
    return f"The camera was {reason}; {went}{_sum_text(figures)}."


def way_text(figures: dict[str, Any]) -> str:
    """Say the length of the way, and what of it was not measured."""
    way, std, missing = figures["distance_m"], figures["distance_std_m"], figures["distance_unmeasured"]
    if not missing:
        return f"{way:.4g} m in all"
    time = figures["distance_unmeasured_s"]
    lost = f"{missing} frames ({time:.2f} s) without a velocity"
    if way is None or not math.isfinite(way):
        return f"{figures['distance_measured_m']:.4g} m where it was measured, in all unknown for {lost}"
    return (
        f"{figures['distance_measured_m']:.4g} m where it was measured; for {lost} nothing was: about {way:.4g} m in "
        f"all (standard deviation {std:.2g} m) if the motion went on as beside"
    )
