"""How the error of a path grows: what each cause of a velocity's covariance adds up to.

docs/explanation/algorithms.md, section "The path, and how it drifts".
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

__all__ = ["Drift"]

F64 = NDArray[np.float64]

# Causes whose errors are independent from frame to frame.
_INDEPENDENT = ("displacement",)
# Causes that scale a velocity as a whole, and along each axis by itself: their error turns round with it.
_SCALE = ("height", "time")
_SCALE_EACH = ("focal length", "principal point")


class Drift:
    """Covariance of a sum of velocities times time, and of the length of the way.

    Errors of the displacement are independent: their covariances add. Every other cause lasts, so that its errors add
    as they are. Those of height and time are along the velocity, and cancel on the way back; those of focal length and
    principal point likewise along each axis; what else there is (a gyro's bias, an attitude that is off) pushes in one
    direction of the body, whichever way it goes. A heading that is off turns all of the way after it: by what lasts of
    a rate's error, and by what is drawn anew in each frame.
    """

    def __init__(self) -> None:
        self._independent = np.zeros((3, 3))
        self._distance_independent = 0.0
        self._lasting: dict[str, F64] = {}
        self._distance_lasting: dict[str, F64] = {}
        self._heading = np.zeros(3)
        self._heading_std = 0.0
        # Covariance of place and heading that independent errors of the turns make.
        self._turned = np.zeros((4, 4))

    def add(self, parts: Mapping[str, F64], v: F64, rotation: F64, dt_s: float) -> None:
        """Add a step of `dt_s` with the velocity `v` (3,), whose axes `rotation` turns into those of the path."""
        speed = math.hypot(v[0], v[1])
        along = rotation @ v
        flat = math.hypot(along[0], along[1])
        direction = np.array([along[0], along[1], 0.0]) / flat if flat > 0 else np.zeros(3)
        for name, part in parts.items():
            spread = np.where(np.isfinite(part), part, 0.0)
            if name in _INDEPENDENT:
                turned = rotation @ spread @ rotation.T * dt_s**2
                self._independent = self._independent + turned
                self._distance_independent += float(direction @ turned @ direction)
                continue
            error = rotation @ _error(name, spread, v if speed > 0 else np.zeros(3)) * dt_s
            self._lasting[name] = self._lasting.get(name, 0.0) + error
            self._distance_lasting[name] = self._distance_lasting.get(name, 0.0) + direction @ error
        across = np.array([-along[1], along[0], 0.0]) * dt_s
        self._heading = self._heading + self._heading_std * across
        step = np.eye(4)
        step[:3, 3] = across
        self._turned = step @ self._turned @ step.T

    def turn(self, lasting_std_rad: float, independent_std_rad: float = 0.0) -> None:
        """Add a turn: the deviation of its error that lasts, and of that which is of this frame alone."""
        self._heading_std += lasting_std_rad
        self._turned[3, 3] += independent_std_rad**2

    @property
    def heading_std_rad(self) -> float:
        """Standard deviation of the heading."""
        return math.hypot(self._heading_std, math.sqrt(float(self._turned[3, 3])))

    @property
    def covariance(self) -> F64:
        """Covariance of the place, (3, 3)."""
        lasting = sum((error @ error.T for error in self._lasting.values()), np.zeros((3, 3)))
        heading = np.outer(self._heading, self._heading) + self._turned[:3, :3]
        return np.asarray(self._independent + lasting + heading, dtype=np.float64)

    @property
    def distance_variance(self) -> float:
        """Variance of the length of the way."""
        return self._distance_independent + sum(float(error @ error) for error in self._distance_lasting.values())


def _error(name: str, spread: F64, v: F64) -> F64:
    """Give a root of a covariance, (3, 3), that keeps the signs of its cause from frame to frame."""
    if name in _SCALE:
        pulled = spread @ v
        variance = float(v @ pulled)
        error = np.zeros((3, 3))
        error[:, 0] = pulled / math.sqrt(variance) if variance > 0 else np.sqrt(np.maximum(np.diag(spread), 0.0))
        return error
    signs = np.where(v < 0, -1.0, 1.0) if name in _SCALE_EACH else np.ones(3)
    values, axes = np.linalg.eigh(signs[:, None] * spread * signs)
    return np.asarray(signs[:, None] * ((axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T), dtype=np.float64)
