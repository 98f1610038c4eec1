"""What each cause gives to a velocity's covariance."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..camera.model import Camera
from . import plane

__all__ = ["of_causes", "rotated", "wanted"]

F64 = NDArray[np.float64]

_LENS = (("focal length", ("fx", "fy")), ("principal point", ("cx", "cy")))
_ORDER = ("fx", "fy", "cx", "cy")


def wanted(camera: Camera, down_std_rad: float) -> tuple[int, ...]:
    """Which numbers' effect on the motion the covariance needs."""
    known = [_ORDER.index(name) for name in _ORDER if camera.std.get(name, 0.0) > 0]
    return (*known, *((plane.DOWN_X, plane.DOWN_Y) if down_std_rad > 0 else ()))


def of_causes(
    camera: Camera, numbers: tuple[int, ...], changes: F64, per_motion: float, down_std_rad: float
) -> dict[str, F64]:
    """Give what lens and attitude add, in the camera's axes.

    Parameters
    ----------
    camera : Camera
    numbers : tuple of int
        From `wanted`.
    changes : (N, 3)
        Of the way, in heights, for one unit of each.
    per_motion : float
        Metres per second for a way of one height.
    down_std_rad : float
    """
    parts: dict[str, F64] = {}
    for number, change in zip(numbers, changes * per_motion, strict=True):
        if number >= 0:
            name = _ORDER[number]
            title = next(title for title, names in _LENS if name in names)
            std = float(camera.std[name])
        else:
            title, std = "attitude", down_std_rad
        parts[title] = parts.get(title, np.zeros((3, 3))) + np.outer(change, change) * std**2
    return parts


def rotated(R: F64, parts: Mapping[str, F64]) -> dict[str, F64]:
    """Give covariances in other axes."""
    return {name: np.asarray(R @ part @ R.T, dtype=np.float64) for name, part in parts.items()}
