"""How a camera is mounted on a body, in words: the rotation from the camera's axes to the body's."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from ..errors import OptionError

__all__ = ["mounting"]

F64 = NDArray[np.float64]

# Directions of a body whose axes are forward, right, down.
_DIRECTIONS = {
    "forward": (1.0, 0.0, 0.0),
    "back": (-1.0, 0.0, 0.0),
    "right": (0.0, 1.0, 0.0),
    "left": (0.0, -1.0, 0.0),
    "down": (0.0, 0.0, 1.0),
    "up": (0.0, 0.0, -1.0),
}
_EXPECTED = (
    'an axis of the picture and where it points, "x-right" or "x-right,y-back" say (of forward, back, right, left, '
    'down, up), "yaw=90" in degrees, or a rotation, (3, 3): orthonormal rows, determinant 1'
)


def mounting(mount: str | ArrayLike) -> F64:
    """Give the rotation from the camera's axes to those of a body with axes forward, right, down.

    The camera's axes are x to the right of the picture, y down the picture, z along the optical axis.

    Parameters
    ----------
    mount : str or (3, 3) array_like
        Where the picture's axes point: ``"x-right,y-back"``, or one axis alone, ``"x-right"``, of a camera that looks
        down; the directions are forward, back, right, left, down, up. Or ``"yaw=90"``: of a camera that looks down, by
        how many degrees its x axis is turned to the right of forward. Or nine numbers, row by row, in a text with
        commas or as an array: any rotation, to axes of your own.

    Returns
    -------
    (3, 3) float64
        For ``VelocityEstimator(R_body_from_camera=...)``.

    Raises
    ------
    OptionError
        If it is no mounting: words that are not known, axes that are not perpendicular, or no rotation.
    ShapeError, DTypeError
        If an array is of another shape or kind.

    Examples
    --------
    A camera that looks down, the top of its picture to the front of the vehicle:

    >>> mounting("x-right").astype(int).tolist()
    [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    >>> bool(np.allclose(mounting("x-right"), mounting("yaw=90")))
    True
    >>> mounting("x-right,z-forward").astype(int).tolist()
    [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    """
    if not isinstance(mount, str):
        return _rotation(mount, _checks.array("mount", mount, (3, 3), _EXPECTED, finite=True))
    text = mount.strip().lower()
    turned = re.fullmatch(r"yaw=([-+]?[\d.]+(?:e[-+]?\d+)?)", text)
    if turned and (yaw := _number(turned[1])) is not None:
        cos, sin = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    parts = [part for part in re.split(r"[,;\s]+", text.strip("[]()")) if part]
    if len(parts) == 9:
        numbers = [_number(part) for part in parts]
        if None not in numbers:
            return _rotation(mount, np.array(numbers, dtype=np.float64).reshape(3, 3))
    return _of_axes(mount, parts)


def _of_axes(mount: str, parts: list[str]) -> F64:
    """Give the rotation of axes by name; one alone is that of a camera that looks down."""
    given: dict[int, F64] = {}
    for part in parts:
        axis, _, direction = part.partition("-")
        if axis not in ("x", "y", "z") or direction not in _DIRECTIONS or "xyz".index(axis) in given:
            raise _checks.refused("mount", mount, _EXPECTED)
        given["xyz".index(axis)] = np.array(_DIRECTIONS[direction])
    if len(given) == 1 and 2 not in given:
        given[2] = np.array(_DIRECTIONS["down"])
    if len(given) < 2:
        raise _checks.refused("mount", mount, _EXPECTED)
    missing = [axis for axis in range(3) if axis not in given]
    if missing:
        first, second = ((missing[0] + 1) % 3, (missing[0] + 2) % 3)
        given[missing[0]] = np.cross(given[first], given[second])
    return _rotation(mount, np.stack([given[axis] for axis in range(3)], axis=1))


def _rotation(given: Any, found: NDArray[Any]) -> F64:
    turn = found.astype(np.float64)
    orthonormal = np.abs(turn).max() < 2 and np.allclose(turn @ turn.T, np.eye(3), atol=1e-4)
    if not orthonormal or np.linalg.det(turn) < 0:
        if isinstance(given, str):
            raise _checks.refused("mount", given, _EXPECTED)
        raise OptionError(f"mount: got {turn.tolist()}, expected {_EXPECTED}")
    # Numbers that were rounded make no rotation to the last digit.
    u, _, v = np.linalg.svd(turn)
    return np.asarray(u @ v, dtype=np.float64)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
