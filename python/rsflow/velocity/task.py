"""Two frames between which a motion is sought, and what is known of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._rotation import rotation_matrix
from ..camera.model import Camera
from . import plane
from .start import Turned

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Task:
    """Two frames, and what is known of the camera between them: `covariance` (3, 3) of the rotation beyond the told."""

    camera: Camera
    follower: plane.Follower
    prev: NDArray[Any]
    image: NDArray[Any]
    mask: NDArray[np.bool_] | None
    interval: plane.Interval
    covariance: F64
    numbers: tuple[int, ...]

    def turned(self) -> Turned | None:
        """Where the told rotation alone puts pixels; None without one."""
        if not self.interval.turn.any():
            return None
        by = rotation_matrix(-self.interval.turn)

        def to(pixels: F64) -> F64:
            rays = self.camera.undistort_points(pixels, normalized=True).astype(np.float64)
            x = rays @ by[:, :2].T + by[:, 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                x = x[:, :2] / np.where(x[:, 2] > 1e-9, x[:, 2], np.nan)[:, None]
            return np.asarray(self.camera.distort_points(x, normalized=True), dtype=np.float64)

        return to
