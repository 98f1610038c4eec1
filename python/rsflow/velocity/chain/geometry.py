"""Small geometry of a camera over a plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...camera.model import Camera

F64 = NDArray[np.float64]

# A parameter is demanded where it differs from zero by this many of its own standard deviations.
_DEMANDED = 3.0
# An error in pixels that varies smoothly over the picture, as that of a turn does, may look like one.
_SMOOTH_PX = 0.0015


def cross(a: F64, b: F64) -> F64:
    """Give the cross product of two vectors, (3,): numpy's own takes longer than all else of a small step."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def smooth_error(camera: Camera) -> F64:
    """Give the covariance (3, 3) of a rotation that a smooth error of the displacements looks like, in radians squared.

    A turn about y moves the picture by 1 + x^2: only the scatter of x^2 over the picture tells it from a way.
    """
    x, y = 0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy
    of_square, of_line = 0.298, 0.577
    slopes = np.array([camera.fy * of_square * y * y, camera.fx * of_square * x * x, camera.fx * of_line * max(x, y)])
    return np.diag((_SMOOTH_PX / slopes) ** 2)


def sees_ground(camera: Camera, down: F64) -> bool:
    """Whether at least half of the picture shows what lies less than 80 degrees from straight down."""
    x, y = np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 9))
    rays = camera.undistort_points(np.column_stack([x.ravel(), y.ravel()]), normalized=True).astype(np.float64)
    length = np.sqrt(1.0 + np.sum(rays * rays, axis=1))
    with np.errstate(invalid="ignore"):
        return bool(np.mean((rays @ down[:2] + down[2]) / length > 0.17) >= 0.5)


def demanded(velocity: F64, covariance: F64, yaw: float) -> tuple[str, ...]:
    """Name the unknowns that differ from zero; `yaw` is in its own deviations."""
    terms: tuple[str, ...] = ("vx", "vy")
    if abs(velocity[2]) > _DEMANDED * np.sqrt(covariance[2, 2]):
        terms += ("vz",)
    return (*terms, "yaw") if abs(yaw) > _DEMANDED else terms
