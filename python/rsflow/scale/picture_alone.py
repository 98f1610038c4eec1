"""What the pictures of a turning camera say without a gyro: the focal length, and whether the camera also moved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .rotation_fit import FOCAL, READOUT, SHIFT, TURN, Turns

__all__ = ["focal_of_picture", "off_centre", "sideways"]

F64 = NDArray[np.float64]

# Log of the focal length's ratio, before.
_PRIOR_LOG = 2.0
# Relative deviation above which the perspective alone does not say what the focal length is.
_PERSPECTIVE = 0.05


def sideways(turns: Turns, log_focal: float = 0.0) -> F64:
    """How the camera moved between frames, in distances from a scene square to its axis, and the deviations: (2, K, 3).

    `log_focal` is the focal length to assume, over the one that the turns were fitted with.
    """
    normal, gradient = turns.normal, turns.gradient + turns.normal[:, :, FOCAL] * log_focal
    mixed = np.linalg.solve(normal[:, TURN, TURN], normal[:, TURN, SHIFT])
    inner = normal[:, SHIFT, SHIFT] - np.einsum("kia,kib->kab", normal[:, TURN, SHIFT], mixed)
    slope = gradient[:, SHIFT] - np.einsum("ki,kia->ka", gradient[:, TURN], mixed)
    covariance = np.linalg.inv(inner)
    way = -np.einsum("kab,kb->ka", covariance, slope)
    return np.stack([way, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))])


def focal_of_picture(turns: Turns, blocks: int) -> tuple[float, float] | None:
    """Say what the perspective alone does: the log of the focal length over the one that was fitted, and its deviation.

    Points off the axis move further under a turn than those on it: by how much tells the focal length without a gyro.
    None where the clip's turns are too small for that.
    """
    own = [FOCAL, READOUT]
    mixed = np.linalg.solve(turns.normal[:, TURN, TURN], turns.normal[:, TURN, own])
    inner = turns.normal[:, own][:, :, own] - np.einsum("kia,kib->kab", turns.normal[:, TURN, own], mixed)
    slope = turns.gradient[:, own] - np.einsum("ki,kia->ka", turns.gradient[:, TURN], mixed)
    own_information = inner[:, 0, 0]
    edges = np.linspace(0, len(turns), blocks + 1).astype(int)
    inner, slope = (np.add.reduceat(sums, edges[:-1], axis=0) for sums in (inner, slope))
    held = np.diag([_PRIOR_LOG**-2, float(np.median(turns.dt_s)) ** -2])
    steps = -np.linalg.solve(inner.sum(axis=0) - inner + held, (slope.sum(axis=0) - slope)[..., None])[:, 0, 0]
    away = -float(np.linalg.solve(inner.sum(axis=0) + held, slope.sum(axis=0))[0])
    own_std = float(np.sqrt(np.linalg.inv(inner.sum(axis=0) + held)[0, 0]))
    std = max(own_std, float(np.sqrt((blocks - 1) / blocks * ((steps - steps.mean()) ** 2).sum())))
    # What the points share is as good as one point: by how much the perspective moves them, in pixels.
    moved = float(np.sqrt(np.mean(own_information * turns.std_px**2 / (2 * turns.n_points))))
    std = float(np.hypot(std, float(np.median(turns.shared_px)) / max(moved, 1e-9)))
    return (away, std) if std < _PERSPECTIVE else None


def off_centre(turns: Turns, way: F64) -> tuple[float, float]:
    """Say how far the lens is from the axis that it is turned about, in distances from the scene, and the deviation.

    `way` (K, 3) is how the camera moved between frames, as `sideways` gives it: what of it goes with the turns. Most of
    what a lens ahead of the axis does is taken for a longer focal length; this is what is left of it.
    """
    x, y, z = turns.turn_rad.T
    zero = np.zeros_like(x)
    # The way of a lens at `arm` is turn x arm.
    columns = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3)
    normal = columns.T @ columns
    held = 1e-6 * np.trace(normal) * np.eye(3)
    arm = np.linalg.solve(normal + held, columns.T @ way.ravel())
    left = way.ravel() - columns @ arm
    spread = np.sqrt(np.diag(np.linalg.inv(normal + held)) * float((left**2).sum()) / max(len(left) - 3, 1))
    at = int(np.argmax(np.abs(arm) / np.maximum(spread, 1e-12)))
    return float(np.abs(arm[at])), float(spread[at])
