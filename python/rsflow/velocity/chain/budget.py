"""What each cause gives to a velocity's covariance."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...camera.model import Camera

__all__ = ["of_lens", "rotated", "wanted"]

F64 = NDArray[np.float64]

_LENS = (("focal length", ("fx", "fy")), ("principal point", ("cx", "cy")))
_ORDER = ("fx", "fy", "cx", "cy")


def wanted(camera: Camera) -> tuple[int, ...]:
    """Which numbers of the lens the covariance needs the effect of."""
    return tuple(_ORDER.index(name) for name in _ORDER if camera.std.get(name, 0.0) > 0)


def of_lens(camera: Camera, numbers: tuple[int, ...], changes: F64, per_way: float) -> dict[str, F64]:
    """Give what the lens adds, in the camera's axes.

    Parameters
    ----------
    camera : Camera
    numbers : tuple of int
        From `wanted`.
    changes : (N, 3)
        Of the way, in heights, for one unit of each.
    per_way : float
        Metres per second for a way of one height.
    """
    parts: dict[str, F64] = {}
    for number, change in zip(numbers, changes * per_way, strict=True):
        name = _ORDER[number]
        title = next(title for title, names in _LENS if name in names)
        part = np.outer(change, change) * float(camera.std[name]) ** 2
        parts[title] = parts.get(title, np.zeros((3, 3))) + part
    return parts


def rotated(R: F64, parts: Mapping[str, F64]) -> dict[str, F64]:
    """Give covariances in other axes."""
    return {name: np.asarray(R @ part @ R.T, dtype=np.float64) for name, part in parts.items()}
