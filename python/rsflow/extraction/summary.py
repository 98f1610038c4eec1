"""The key figures of an extraction, from its columns: for summary.json, the closing lines and the report page."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .series import Series

__all__ = ["as_json", "duration_s", "key_figures", "text"]


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


def key_figures(motion: Series, velocity: Series | None, track: Series | None) -> dict[str, Any]:
    """Sum up the columns.

    Returns
    -------
    dict
        ``frames``, ``measured``, ``duration_s``, ``displacement_sum_px``, medians and shares, counts of the statuses;
        with a velocity ``speed_median_m_s``, ``velocity_measured``, ``distance_m``.
    """
    dx, dy = motion["dx_px"], motion["dy_px"]
    statuses = motion.counts("status")
    length = np.hypot(dx, dy)
    fastest = int(np.nanargmax(length)) if np.isfinite(length).any() else None
    figures: dict[str, Any] = {
        "frames": len(motion),
        "measured": int(np.isfinite(dx).sum()),
        "duration_s": duration_s(motion),
        "displacement_sum_px": [float(np.nansum(dx)), float(np.nansum(dy))],
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
    if track is not None and len(track):
        distance = _finite(track["distance_m"])
        figures |= {
            "distance_m": float(distance[-1]) if len(distance) else 0.0,
            "track_segments": int(np.nanmax(track["segment"], initial=0)),
        }
    return figures


def text(figures: dict[str, Any]) -> str:
    """Say the key figures in a sentence or two."""
    pairs = max(figures["frames"] - 1, 0)
    parts = [f"{figures['frames']} frame{'' if figures['frames'] == 1 else 's'}"]
    if math.isfinite(figures["duration_s"]):
        parts[0] += f" over {figures['duration_s']:.2f} s"
    parts.append(f"the displacement was measured in {figures['measured']} of {pairs} pairs")
    if figures["measured"]:
        x, y = figures["displacement_sum_px"]
        parts.append(
            f"in sum the picture went {round(x, 2) + 0.0:+.2f} px to the right and {round(y, 2) + 0.0:+.2f} px down"
        )
    if math.isfinite(figures["moving_share"]):
        parts.append(f"{100 * figures['moving_share']:.1f} % of the picture moves on its own on average")
    lines = "; ".join(parts) + "."
    if figures.get("velocity_measured"):
        unstated = figures.get("speed_std_without")
        without = f" without that of {', '.join(unstated)}, which was not stated" if unstated else ""
        lines += (
            f" The camera went at {figures['speed_median_m_s']:.4g} m/s (median, standard deviation of one frame "
            f"{figures['speed_std_median_m_s']:.2g} m/s{without}), {figures.get('distance_m', 0.0):.4g} m in all."
        )
    return lines
