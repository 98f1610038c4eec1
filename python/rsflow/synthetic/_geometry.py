"""Rays of a camera, the ground they meet, and the path the camera takes: all in float64, all exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._rotation import rotation_matrix
from ..camera.model import Camera
from ..errors import OptionError, ShapeError

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Path:
    """A camera's pose at any time: body velocity and rate are constant within each interval between frames.

    The position within an interval is linear in time, so that the mean velocity of an interval, taken in the camera's
    axes half-way through, is exactly the one that was asked for.
    """

    t_s: F64
    position_m: F64
    rotation: F64
    velocity_m_s: F64
    rate_rad_s: F64

    def at(self, t_s: float) -> tuple[F64, F64]:
        """Position (3,) and the rotation (3, 3) from the camera's axes to the world's; goes on past the ends."""
        count = len(self.velocity_m_s)
        if count == 0:
            return self.position_m[0], self.rotation[0]
        k = int(np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, count - 1))
        since, span = t_s - float(self.t_s[k]), float(self.t_s[k + 1] - self.t_s[k])
        step = (self.position_m[k + 1] - self.position_m[k]) * (since / span)
        return self.position_m[k] + step, self.rotation[k] @ rotation_matrix(self.rate_rad_s[k] * since)


def path_from_rates(
    times_s: F64, height_m: float, velocity_m_s: ArrayLike, rate_rad_s: ArrayLike, tilt_rad: tuple[float, float]
) -> Path:
    """Integrate body velocity and rate from a start above the world's origin."""
    if len(times_s) < 1 or (np.diff(times_s) <= 0).any():
        got = f"{len(times_s)} times, not each later than the one before" if len(times_s) else "no time"
        raise OptionError(f"times_s: got {got}, expected finite times in seconds, each later than the one before")
    count = len(times_s) - 1
    steps = []
    for name, given in (("velocity_m_s", velocity_m_s), ("rate_rad_s", rate_rad_s)):
        expected = f"finite numbers, (3,) or ({count}, 3)"
        value = _checks.array(name, given, ..., expected, finite=True).astype(np.float64)
        if value.shape not in ((3,), (count, 3)):
            raise ShapeError(f"{name}: got shape {value.shape}, expected {expected}")
        if value.size and np.abs(value).max() > 1e6:
            raise OptionError(f"{name}: got {np.abs(value).max():g}, expected numbers up to 1e6")
        steps.append(np.broadcast_to(value, (count, 3)).copy())
    velocity, rate = steps
    position = [np.array([0.0, 0.0, -float(height_m)])]
    attitude = [rotation_matrix((tilt_rad[0], 0.0, 0.0)) @ rotation_matrix((0.0, tilt_rad[1], 0.0))]
    for k in range(count):
        dt = float(times_s[k + 1] - times_s[k])
        middle = attitude[k] @ rotation_matrix(rate[k] * (dt / 2))
        position.append(position[k] + middle @ velocity[k] * dt)
        attitude.append(attitude[k] @ rotation_matrix(rate[k] * dt))
        if position[-1][2] >= 0:
            raise OptionError(
                f"height_m, velocity_m_s: got {height_m:g} m and a way on which the camera reaches the ground at "
                f"t = {times_s[k + 1]:g} s, expected one above it"
            )
    return Path(times_s, np.stack(position), np.stack(attitude), velocity, rate)


class Optics:
    """A pinhole camera with Brown-Conrady distortion (k1 k2 p1 p2 k3): rays of its pixels, and pixels of points."""

    def __init__(self, camera: Camera) -> None:
        self.width, self.height = int(camera.width), int(camera.height)
        self.fx, self.fy, self.cx, self.cy = (float(getattr(camera, name)) for name in ("fx", "fy", "cx", "cy"))
        terms = [float(value) for value in np.ravel(np.asarray(camera.distortion, dtype=np.float64))]
        if camera.model != "pinhole" or len(terms) > 5:
            raise OptionError(
                f"camera: got model {camera.model!r} with {len(terms)} distortion terms, "
                "expected 'pinhole' with at most 5 (k1 k2 p1 p2 k3)"
            )
        self.distortion = [*terms, 0.0, 0.0, 0.0, 0.0, 0.0][:5]
        self._rays: dict[int, tuple[F64, F64]] = {}

    @property
    def focal_px(self) -> float:
        return float(np.sqrt(self.fx * self.fy))

    def distort(self, x: F64, y: F64) -> tuple[F64, F64]:
        """Normalised coordinates without distortion -> with it."""
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )

    def undistort(self, xd: F64, yd: F64) -> tuple[F64, F64]:
        """Invert `distort`, by Newton's method with a numerical derivative, to 1e-12."""
        x, y = xd.copy(), yd.copy()
        h = 1e-6
        for _ in range(50):
            fx, fy = self.distort(x, y)
            ex, ey = fx - xd, fy - yd
            if max(float(np.abs(ex).max(initial=0.0)), float(np.abs(ey).max(initial=0.0))) < 1e-12:
                return x, y
            ax, ay = (b - a for a, b in zip(self.distort(x - h, y), self.distort(x + h, y), strict=True))
            bx, by = (b - a for a, b in zip(self.distort(x, y - h), self.distort(x, y + h), strict=True))
            determinant = (ax * by - ay * bx) / (2 * h)
            x = x - (by * ex - bx * ey) / determinant
            y = y - (ax * ey - ay * ex) / determinant
        raise OptionError(
            f"camera: got the distortion {self.distortion}, expected one that can be inverted over the whole picture"
        )

    def rays(self, margin: int) -> tuple[F64, F64]:
        """Undistorted normalised coordinates of all pixels; a row and a column where there is no distortion."""
        if margin not in self._rays:
            x: F64 = ((np.arange(-margin, self.width + margin, dtype=np.float64) - self.cx) / self.fx)[None, :]
            y: F64 = ((np.arange(-margin, self.height + margin, dtype=np.float64) - self.cy) / self.fy)[:, None]
            if any(self.distortion):
                x, y = self.undistort(x + 0.0 * y, y + 0.0 * x)
            self._rays[margin] = (x, y)
        return self._rays[margin]

    def ground(self, position: F64, rotation: F64, *, margin: int) -> tuple[F64, F64]:
        """Where the ray of each pixel meets the ground z = 0, in metres; NaN where it does not."""
        x, y = self.rays(margin)
        if np.array_equal(rotation, np.eye(3)):
            return position[0] - position[2] * x, position[1] - position[2] * y
        rx, ry, rz = (row[0] * x + row[1] * y + row[2] for row in rotation)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(rz > 1e-6, -position[2] / rz, np.nan)
        return position[0] + depth * rx, position[1] + depth * ry

    def project(self, x: F64, y: F64, position: F64, rotation: F64) -> tuple[F64, F64]:
        """Pixel coordinates of points of the ground; NaN behind the camera."""
        dx, dy, dz = x - position[0], y - position[1], -position[2]
        cx, cy, cz = (rotation[0, k] * dx + rotation[1, k] * dy + rotation[2, k] * dz for k in range(3))
        with np.errstate(divide="ignore", invalid="ignore"):
            cz = np.where(cz > 1e-9, cz, np.nan)
            u, v = self.distort(cx / cz, cy / cz)
        return self.fx * u + self.cx, self.fy * v + self.cy

    def longest_way(self, path: Path, start_s: float, stop_s: float) -> float:
        """How far, in pixels, the picture's centre or a corner moves between two times."""
        columns = np.array([self.cx, 0.0, self.width - 1.0, 0.0, self.width - 1.0])
        rows = np.array([self.cy, 0.0, 0.0, self.height - 1.0, self.height - 1.0])
        rays = self.undistort((columns - self.cx) / self.fx, (rows - self.cy) / self.fy)
        position, rotation = path.at(start_s)
        rx, ry, rz = (row[0] * rays[0] + row[1] * rays[1] + row[2] for row in rotation)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(rz > 1e-6, -position[2] / rz, np.nan)
        u, v = self.project(position[0] + depth * rx, position[1] + depth * ry, *path.at(stop_s))
        way = np.hypot(u - columns, v - rows)
        return float(np.nanmax(way)) if np.isfinite(way).any() else 0.0
