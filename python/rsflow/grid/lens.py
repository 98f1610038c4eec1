"""Displacements without the lens's distortion."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from .result import Grid

__all__ = ["without_distortion"]

# Half the distance over which the lens's derivative is taken, in pixels.
_HALF_PX = 0.5

F64 = NDArray[np.float64]


def without_distortion(grid: Grid, camera: Camera) -> Grid:
    """Take the distortion of `camera` out of what a grid measured.

    A place p goes to D(p), the same that an ideal camera sees; so u becomes D(p + u) - D(p), and the deformation F
    becomes D'(p + u) F D'(p)^-1. Nodes that no ray leads to are not finite then.
    """
    p = np.stack([grid.x, grid.y], axis=-1).reshape(-1, 2).astype(np.float64)
    q = p + grid.raw.reshape(-1, 2)
    ideal = camera.undistort_points
    raw = ideal(q) - ideal(p)
    here, there = _derivative(camera, p), _derivative(camera, q)
    with np.errstate(invalid="ignore"):
        back = np.linalg.inv(np.where(np.isfinite(here), here, np.eye(2)))
    deformation = np.eye(2) + grid.gradient.reshape(-1, 2, 2)
    gradient = there @ deformation @ back - np.eye(2)
    # Of u and v, and of the derivatives row by row: what D' does to them.
    count = len(p)
    change = np.zeros((count, 6, 6))
    change[:, :2, :2] = there
    change[:, 2:, 2:] = np.einsum("nij,nlk->nikjl", there, back).reshape(count, 4, 4)
    old = grid.joint_covariance.reshape(-1, 6, 6).astype(np.float64)
    finite = np.isfinite(old).all(axis=(1, 2)) & np.isfinite(change).all(axis=(1, 2))
    new = np.where(np.eye(6, dtype=bool), np.inf, 0.0) * np.ones((count, 1, 1))
    new[finite] = change[finite] @ old[finite] @ change[finite].transpose(0, 2, 1)
    nodes = grid.status.shape
    return dataclasses.replace(
        grid,
        raw=raw.reshape(*nodes, 2).astype(np.float32),
        gradient=gradient.reshape(*nodes, 2, 2).astype(np.float32),
        joint_covariance=new.reshape(*nodes, 6, 6).astype(np.float32),
    )


def _derivative(camera: Camera, points: F64) -> F64:
    """Give the derivative of where an ideal camera sees points, (N, 2, 2)."""
    sides = []
    for axis in range(2):
        offset = np.zeros(2)
        offset[axis] = _HALF_PX
        ahead, behind = camera.undistort_points(points + offset), camera.undistort_points(points - offset)
        sides.append((ahead - behind) / (2 * _HALF_PX))
    return np.stack(sides, axis=-1)
