"""How a camera and a plane move to each other between two pictures: turn, way and slant, and how fast they close in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._rotation import rotation_matrix

__all__ = ["PlaneMotion", "fit_plane_motion"]

F64 = NDArray[np.float64]

# Unknowns: the turn (rad), the camera's way and the plane's slant, lengths in distances to the plane along the axis;
# and the lens's first coefficient, k1.
_TURN, _WAY, _SLANT, LENS = slice(0, 3), slice(3, 6), slice(6, 8), 8
# Known before: a turn and a way of any size that pictures can share, a slant of some 30 degrees; no lens distortion.
_PRIOR = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.6, 0.6, 1e-9])
_STEPS = 30
# Deviations within which a point agrees, and how few points are no proof of anything.
_AGREES, _LEAST = 4.5, 12
# Error in pixels that points share, and as a share of how far the plane came near.
_SHARED_PX, _SHARED = 0.01, 0.003
# Step of a numerical derivative.
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class PlaneMotion:
    """The motion from one picture to another.

    Attributes
    ----------
    value : (9,) float64
        Turn, way and slant: the plane is all X with (slant, 1) . X = 1, and X becomes ``exp(-turn) (X - way)``; and
        the lens's k1.
    closed : float
        By which part of itself the distance to the plane has become less.
    closed_std : float
    n_points : int
        That agree.
    share : float
        Of the points that agree.
    """

    value: F64
    closed: float
    closed_std: float
    n_points: int
    share: float

    @property
    def homography(self) -> F64:
        """Rays (x, y, 1) of the first picture to rays of the second, up to a factor, (3, 3)."""
        slant = np.append(self.value[_SLANT], 1.0)
        return np.asarray(rotation_matrix(-self.value[_TURN]) @ (np.eye(3) - np.outer(self.value[_WAY], slant)))

    @property
    def grown(self) -> float:
        """By which factor areas at the axis have grown."""
        h = self.homography
        return float(np.linalg.det(h) / h[2, 2] ** 3)


def fit_plane_motion(
    before: F64,
    after: F64,
    std: F64,
    *,
    turn: tuple[F64, float] | None = None,
    start: F64 | None = None,
    lens: tuple[float, float] = (0.0, 1e-9),
    focal_px: float,
) -> PlaneMotion | None:
    """Fit turn, way and slant to points of a plane.

    Parameters
    ----------
    before, after : (N, 2)
        Rays x / z, y / z of the points in both pictures.
    std : (N,)
        Deviation of each, as a ray.
    turn : ((3,), float), optional
        The camera's turn from another instrument, and its deviation along each axis.
    start : (9,), optional
        Where to begin.
    lens : (float, float), optional
        What is known of k1 before, and its deviation; as if the rays had no distortion left where not given.
    focal_px : float
        Pixels that a ray of one is long.

    Returns
    -------
    PlaneMotion or None
        None where fewer than half of the points agree, or too few.
    """
    if len(before) < _LEAST:
        return None
    held, center = 1 / _PRIOR**2, np.zeros(9)
    center[LENS], held[LENS] = lens[0], 1 / lens[1] ** 2
    if turn is not None:
        center[_TURN], held[_TURN] = turn[0], 1 / max(turn[1], 1e-9) ** 2
    value = center.copy() if start is None else start.copy()
    weight = np.ones(len(before))
    for _ in range(_STEPS):
        left, columns = _linear(value, before, after, std)
        size = np.linalg.norm(left, axis=1)
        unit = max(float(np.median(size)) / 1.177, 1.0)
        weight = np.clip(1 - (size / (_AGREES * unit)) ** 2, 0, None) ** 2 / unit**2
        normal = np.einsum("n,nki,nkj->ij", weight, columns, columns) + np.diag(held)
        slope = np.einsum("n,nki,nk->i", weight, columns, left) + held * (value - center)
        step = -np.linalg.solve(normal, slope)
        step *= min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
        value = value + step
        if float(np.abs(step).max()) < 1e-8:
            break
    agree = weight > 0
    share = float(agree.mean())
    if agree.sum() < _LEAST or share < 0.5:
        return None
    left, columns = _linear(value, before, after, std)
    rms = float(np.sqrt((weight[:, None] * left**2).sum() / (2 * weight.sum())))
    normal = np.einsum("n,nki,nkj->ij", agree / max(rms, 1.0) ** 2, columns, columns) + np.diag(held)
    slant = np.append(value[_SLANT], 1.0)
    closed = float(slant @ value[_WAY])
    along = np.concatenate([np.zeros(3), slant, value[3:5], np.zeros(1)])
    variance = float(along @ np.linalg.solve(normal, along))
    # Errors that points share look like growth by as much as they are of the picture's extent.
    extent = float(np.sqrt(((before[agree] - before[agree].mean(axis=0)) ** 2).sum(axis=1).mean())) * focal_px
    shared = (_SHARED_PX / max(extent, 1e-9)) ** 2 + (_SHARED * closed) ** 2
    return PlaneMotion(value, closed, float(np.sqrt(variance + shared)), int(agree.sum()), share)


def _linear(value: F64, before: F64, after: F64, std: F64) -> tuple[F64, F64]:
    """Give residuals (N, 2) in deviations and their derivatives (N, 2, 9)."""
    back = rotation_matrix(-value[_TURN])
    rays = np.column_stack([_undistorted(before, value[LENS]), np.ones(len(before))])
    points, depth = _moved(value, rays)
    x, y, z = points.T
    zero = np.zeros_like(x)
    project = np.stack([1 / z, zero, -x / z**2, zero, 1 / z, -y / z**2], axis=1).reshape(-1, 2, 3)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    flat = points[:, :2] / z[:, None]
    if value[LENS] != 0.0:
        grown = 1 + value[LENS] * (flat**2).sum(axis=1)
        bent = grown[:, None, None] * np.eye(2) + 2 * value[LENS] * flat[:, :, None] * flat[:, None, :]
        project = bent @ project
    columns = np.empty((len(rays), 2, 9))
    columns[..., _TURN] = -project @ cross
    columns[..., _WAY] = project @ back * depth[:, None, None]
    moved = np.einsum("nij,j->ni", project, back @ value[_WAY])
    columns[..., _SLANT] = moved[..., None] * rays[:, None, :2]
    other = np.column_stack([_undistorted(before, value[LENS] + _STEP), np.ones(len(before))])
    stepped = _moved(value, other)[0]
    seen = _distorted(flat, value[LENS])
    columns[..., LENS] = (seen - _distorted(stepped[:, :2] / stepped[:, 2:], value[LENS] + _STEP)) / _STEP
    return (after - seen) / std[:, None], columns / std[:, None, None]


def _moved(value: F64, rays: F64) -> tuple[F64, F64]:
    """Where the plane's points (N, 3) on rays are in the second camera, up to a length, and one over their depths."""
    depth = rays @ np.append(value[_SLANT], 1.0)
    points = (rays - depth[:, None] * value[_WAY]) @ rotation_matrix(-value[_TURN]).T
    points[:, 2] = np.where(np.abs(points[:, 2]) > 1e-6, points[:, 2], 1e-6)
    return points, depth


def _distorted(flat: F64, k1: float) -> F64:
    return np.asarray(flat * (1 + k1 * (flat**2).sum(axis=1, keepdims=True)))


def _undistorted(flat: F64, k1: float) -> F64:
    """Invert `_distorted` by steps: three of them are exact to 1 % of what a strong lens does."""
    found = flat
    for _ in range(4 if k1 != 0.0 else 0):
        found = flat / np.maximum(1 + k1 * (found**2).sum(axis=1, keepdims=True), 0.2)
    return np.asarray(found)
