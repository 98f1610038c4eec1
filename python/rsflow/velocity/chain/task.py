"""Two frames between which a motion is sought, and what is known of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._rotation import rotation_matrix
from ...camera.model import Camera
from . import plane
from .start import Turned

F64 = NDArray[np.float64]

# On ground that repeats, motions of more heights a second than this are left out: no flow sensor goes that far.
_LIKELY_HEIGHTS_S = 7.5


@dataclass(frozen=True)
class Task:
    """Two frames, and what is known of the camera between them.

    `covariance` (3, 3) is that of the rotation beyond the told one; `longest` the longest way in heights, if anyone
    said so; `numbers` are those whose effect is wanted.
    """

    camera: Camera
    follower: plane.Follower
    prev: NDArray[Any]
    image: NDArray[Any]
    mask: NDArray[np.bool_] | None
    interval: plane.Interval
    covariance: F64
    numbers: tuple[int, ...]
    longest: float | None

    @property
    def likely(self) -> float:
        """The longest way, in heights, that is likely on ground that repeats."""
        if self.longest is not None and np.isfinite(self.longest):
            return self.longest
        return _LIKELY_HEIGHTS_S * self.interval.dt_s

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
