"""The rows of the tables from what the estimators gave."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._results.status import Status, WordStatus
from ..capture.masks import share

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..capture.stream import Frame
    from ..flow.field import FlowField
    from ..segmentation.result import MotionSegmentation
    from ..shift import Shift

__all__ = ["flow_samples", "motion_row", "object_rows", "status_word"]

# A thing that is not seen for so many frames is still there: a region may blink.
_BLINK = 2
# The statistics of the flow are over about so many pixels, on a grid.
_SAMPLES = 30_000


def status_word(status: Status | WordStatus) -> str:
    """Name of a status as the tables have it: ``ok`` or the reason in lower case."""
    return "ok" if status.valid else status.word


def _std(variance: float) -> float:
    return math.sqrt(variance) if variance >= 0 else math.nan


def motion_row(
    frame: Frame, dt_s: float, shift: Shift | None, flow: FlowField | None, segmentation: MotionSegmentation
) -> dict[str, Any]:
    """Give the row of ``motion.csv`` for one frame."""
    row: dict[str, Any] = {"frame": frame.index, "t_s": frame.t_s, "dt_s": dt_s}
    if shift is None:
        row |= {"status": "first_frame"} | _no_shift()
    else:
        row |= {
            # Across a structure of one direction alone is no displacement of the camera.
            "dx_px": float(shift.dx) if shift.valid else math.nan,
            "dy_px": float(shift.dy) if shift.valid else math.nan,
            "dx_std_px": _std(float(shift.covariance[0, 0])),
            "dy_std_px": _std(float(shift.covariance[1, 1])),
            "dxdy_cov_px2": float(shift.covariance[0, 1]) if shift.valid else 0.0,
            "gain": float(shift.gain),
            "offset": float(shift.offset),
            "status": status_word(shift.status),
        }
    return row | _flow_columns(flow, segmentation.mask) | _segmentation_columns(segmentation, frame.image.shape)


def _no_shift() -> dict[str, float]:
    unknown = dict.fromkeys(("dx_px", "dy_px", "gain", "offset"), math.nan)
    return unknown | dict.fromkeys(("dx_std_px", "dy_std_px", "dxdy_cov_px2"), math.inf)


def _flow_columns(flow: FlowField | None, mask: NDArray[np.bool_] | None) -> dict[str, float]:
    names = (
        "flow_mean_x_px",
        "flow_mean_y_px",
        "flow_median_x_px",
        "flow_median_y_px",
        "flow_median_px",
        "flow_p95_px",
    )
    if flow is None:
        return dict.fromkeys((*names, "flow_valid_share"), math.nan)
    valid_share = share(flow.valid, mask)
    u, v = flow_samples(flow)
    if len(u) == 0:
        return dict.fromkeys(names, math.nan) | {"flow_valid_share": valid_share}
    median, high = _quantiles(np.hypot(u, v), (0.5, 0.95))
    values = (u.mean(dtype=np.float64), v.mean(dtype=np.float64), *_quantiles(u, (0.5,)), *_quantiles(v, (0.5,)))
    return dict(zip(names, map(float, (*values, median, high)), strict=True)) | {"flow_valid_share": valid_share}


def flow_samples(flow: FlowField) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Give u and v of the valid pixels on a grid.

    Neighbours tell the same: statistics over a grid cost a fraction and differ by less than the flow's own error.
    """
    step = max(1, math.isqrt(flow.valid.size // _SAMPLES))
    known = flow.valid[::step, ::step]
    # One component at a time: to pick pairs by a mask takes ten times as long.
    return flow.uv[::step, ::step, 0][known], flow.uv[::step, ::step, 1][known]


def _quantiles(values: NDArray[np.float32], shares: tuple[float, ...]) -> list[float]:
    """Order statistics by partition: no interpolation, a third of the time of `numpy.quantile`."""
    places = [min(int(share * len(values)), len(values) - 1) for share in shares]
    # For one place at a time numpy has a quicker way than for two.
    return [float(np.partition(values, place)[place]) for place in places]


def _segmentation_columns(segmentation: MotionSegmentation, shape: tuple[int, ...]) -> dict[str, Any]:
    names = ("camera_dx_px", "camera_dy_px", "camera_rotation_rad", "camera_scale")
    row: dict[str, Any] = {
        "segmentation_status": status_word(segmentation.status),
        "camera_model": segmentation.camera_model + ("+parallax" if segmentation.parallax else ""),
    }
    if not segmentation.valid:
        return row | dict.fromkeys(("moving_share", *names), math.nan)
    row |= {"moving_share": share(segmentation.moving, segmentation.mask), "objects": present(segmentation)}
    return row | dict(zip(names, camera_columns(segmentation.camera_motion, shape), strict=True))


def camera_columns(motion: NDArray[np.float64], shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    """Shift, rotation and scale of a (3, 3) motion of the picture at its middle."""
    H = np.asarray(motion, np.float64)
    x, y = (shape[1] - 1) / 2, (shape[0] - 1) / 2
    px, py, w = H @ (x, y, 1.0)
    px, py = px / w, py / w
    # Derivative of the mapping at the middle.
    J = (H[:2, :2] - np.outer((px, py), H[2, :2])) / w
    rotation = math.atan2(J[1, 0] - J[0, 1], J[0, 0] + J[1, 1])
    return px - x, py - y, rotation, math.sqrt(abs(float(np.linalg.det(J))))


def present(segmentation: MotionSegmentation) -> int:
    """Count the things of a frame: those that are seen, and those that blinked out for a frame or two."""
    return len(segmentation.objects) + sum(thing.missed_frames <= _BLINK for thing in segmentation.hidden)


def object_rows(
    frame: Frame,
    segmentation: MotionSegmentation,
    scales: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
) -> list[dict[str, Any]]:
    """Give the rows of ``objects.csv`` for one frame, those that are seen before the hidden ones.

    `scales` gives metres for each pixel at places (n, 2) of the picture.
    """
    things = (*segmentation.objects, *segmentation.hidden)
    known = [math.nan] * len(things)
    if scales is not None and things:
        known = scales(np.array([(thing.x, thing.y) for thing in things], np.float64)).tolist()
    return [
        {"frame": frame.index, "t_s": frame.t_s, **thing.to_dict(scale)}
        for thing, scale in zip(things, known, strict=True)
    ]
