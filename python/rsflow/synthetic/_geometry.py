"""Rays of a camera and the ground they meet: all in float64, all exact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..camera.model import Camera
from ..errors import OptionError
from ._path import Path

F64 = NDArray[np.float64]


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
        """Where the ray of each pixel meets the ground z = 0, in metres; NaN where it does not.

        The pose is one, (3,) and (3, 3), or one a row, (rows, 1, 3) and (rows, 1, 3, 3).
        """
        x, y = self.rays(margin)
        px, py, pz = (position[..., k] for k in range(3))
        if np.array_equal(rotation, np.broadcast_to(np.eye(3), rotation.shape)):
            return px - pz * x, py - pz * y
        rx, ry, rz = (rotation[..., k, 0] * x + rotation[..., k, 1] * y + rotation[..., k, 2] for k in range(3))
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(rz > 1e-6, -pz / rz, np.nan)
        return px + depth * rx, py + depth * ry

    def project(self, x: F64, y: F64, position: F64, rotation: F64) -> tuple[F64, F64]:
        """Pixel coordinates of points of the ground, from one pose or one a point; NaN behind the camera."""
        dx, dy, dz = x - position[..., 0], y - position[..., 1], -position[..., 2]
        cx, cy, cz = (rotation[..., 0, k] * dx + rotation[..., 1, k] * dy + rotation[..., 2, k] * dz for k in range(3))
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
