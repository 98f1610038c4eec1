"""Metres on the ground for each pixel where a thing is, from the camera and its height."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..camera.model import Camera

__all__ = ["scales"]

# A camera that looks further than this from straight down has another scale in each direction: none is given.
_STEEP = math.cos(math.radians(8.0))


def scales(camera: Camera, height_m: float, along: float, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give the scale at each place, (n, 2) in pixels; NaN where it is not known.

    `along` is the cosine of the angle between the optical axis and straight down.
    """
    if not (len(places) and math.isfinite(height_m) and height_m > 0 and along >= _STEEP):
        return np.full(len(places), np.nan)
    around = places[:, None] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    rays = camera.undistort_points(around.reshape(-1, 2), normalized=True).reshape(-1, 3, 2)
    steps = rays[:, 1:] - rays[:, :1]
    return np.asarray(height_m * np.sqrt(np.abs(np.linalg.det(steps))), np.float64)
