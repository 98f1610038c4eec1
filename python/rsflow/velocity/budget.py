"""What each cause gives to a velocity's covariance: height, focal length, principal point, the gyro's noise."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..camera.model import Camera
from . import plane

__all__ = ["Measured", "in_rays", "of_camera", "of_gyro", "of_height", "rotated"]

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """A fitted velocity and what it was fitted to: `rays` (2, N, 2), their covariances `spread` (N, 2, 2)."""

    rays: F64
    spread: F64
    interval: plane.Interval
    fit: plane.PlaneFit


def in_rays(camera: Camera, pixels: F64, covariance: F64) -> F64:
    """Give covariances (N, 2, 2) in pixels as covariances in normalised coordinates."""
    step = 0.5
    columns = []
    for axis in (0, 1):
        offset = np.zeros(2)
        offset[axis] = step
        ahead, back = (camera.undistort_points(pixels + s * offset, normalized=True) for s in (1.0, -1.0))
        columns.append((ahead - back) / (2 * step))
    jacobian = np.stack(columns, axis=2)
    plain = np.broadcast_to(np.diag([1.0 / camera.fx, 1.0 / camera.fy]), jacobian.shape)
    jacobian = np.where(np.isfinite(jacobian).all(axis=(1, 2), keepdims=True), jacobian, plain)
    return np.asarray(jacobian @ covariance @ jacobian.transpose(0, 2, 1), dtype=np.float64)


def of_height(measured: Measured, std_m: float) -> F64:
    """Every velocity is proportional to the height."""
    known = np.where(np.isfinite(measured.fit.velocity), measured.fit.velocity, 0.0)
    share = std_m / measured.interval.height_m
    return np.outer(known, known) * share**2


def of_camera(camera: Camera, measured: Measured) -> dict[str, F64]:
    """Give what focal length and principal point add, in the camera's axes, where their deviations are known."""
    std = camera.std
    if not any(std.get(name, 0.0) for name in ("fx", "fy", "cx", "cy")):
        return {}
    here = _speeds(measured)
    parts = {}
    for title, names in (("focal length", ("fx", "fy")), ("principal point", ("cx", "cy"))):
        total = np.zeros((3, 3))
        for axis, name in enumerate(names):
            deviation = float(std.get(name, 0.0))
            other = measured.rays.copy()
            if title == "focal length":
                other[..., axis] *= getattr(camera, name) / (getattr(camera, name) + deviation)
            else:
                other[..., axis] -= deviation / (camera.fx, camera.fy)[axis]
            change = np.nan_to_num(_speeds(dataclasses.replace(measured, rays=other)) - here)
            total += np.outer(change, change)
        parts[title] = total
    return parts


def of_gyro(measured: Measured, std_rad_s: float) -> F64:
    """Give what the noise of the rate, alike about each axis, adds in the camera's axes."""
    here = _speeds(measured)
    total = np.zeros((3, 3))
    for turn in np.eye(3) * (std_rad_s * measured.interval.dt_s):
        other = dataclasses.replace(measured.interval, turn=measured.interval.turn + turn)
        change = np.nan_to_num(_speeds(dataclasses.replace(measured, interval=other)) - here)
        total += np.outer(change, change)
    return total


def _speeds(measured: Measured) -> F64:
    """Velocity (3,) with weights and terms held, for the change under another camera; NaN for what is not in it."""
    velocity = np.full(3, np.nan)
    points = plane.Points(measured.rays[0], measured.rays[1], measured.spread)
    solution = plane.solve(points, measured.interval, measured.fit.terms, measured.fit.weights)
    if solution is not None:
        for value, name in zip(solution.values, measured.fit.terms, strict=True):
            if name != "yaw":
                velocity[("vx", "vy", "vz").index(name)] = value
    return velocity


def rotated(R: F64, covariance: F64) -> F64:
    """R C R' where a variance of C may be infinite: what it reaches under R is infinite, the rest is not touched."""
    unknown = np.isinf(np.diag(covariance))
    if not unknown.any():
        return np.asarray(R @ covariance @ R.T, dtype=np.float64)
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    finite[unknown, :] = finite[:, unknown] = 0.0
    result = np.asarray(R @ finite @ R.T, dtype=np.float64)
    for axis in np.flatnonzero((np.abs(R[:, unknown]) > 1e-9).any(axis=1)):
        result[axis, :] = result[:, axis] = 0.0
        result[axis, axis] = np.inf
    return result
