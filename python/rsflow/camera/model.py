"""The camera: intrinsics in pixels of a stated picture size, and lens distortion."""

from __future__ import annotations

import dataclasses
import math
import os
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks, _display
from ..errors import OptionError
from . import distortion as _distortion
from .intrinsics import LARGEST, CameraFormat, CameraModel, Intrinsics

__all__ = ["Camera", "CameraFormat", "CameraModel"]


@dataclass(frozen=True, slots=True, repr=False)
class Camera(Intrinsics):
    """A calibrated camera: where a point of the scene falls in the picture.

    A point (X, Y, Z) of the camera frame (x right, y down, z forward) has the normalised coordinates (X/Z, Y/Z); the
    lens distorts them, and the intrinsics give the pixel (fx x + cx, fy y + cy). Pixel centres are at integers, so the
    picture spans -0.5 to width - 0.5. The skew is zero.

    Parameters
    ----------
    fx, fy : float
        Focal length in pixels of the picture size below.
    cx, cy : float
        Principal point in pixels.
    width, height : int
        Size of the picture that these pixels belong to.
    distortion : sequence of float
        OpenCV's coefficients. Model "pinhole": k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]], so 0, 4, 5, 8 or 12 of
        them. Model "fisheye" (equidistant): k1 k2 k3 k4, or none.
    model : {"pinhole", "fisheye"}
        The lens model.
    std : mapping of str to float
        Standard deviations of parameters by name ("fx", "cx", "k1", ...), where known.

    Raises
    ------
    OptionError
        If a value is not finite, a focal length or size not positive, or the number of coefficients wrong.

    Examples
    --------
    >>> from rsflow import Camera
    >>> camera = Camera(657.8, 658.4, 311.2, 245.6, width=640, height=480, distortion=(-0.256, 0.131, -0.0002, 0.0))
    >>> camera.scaled(320, 240).fx
    328.9
    """

    def __repr__(self) -> str:
        values = {"fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy}
        values |= dict(zip(self.distortion_names, self.distortion, strict=True))
        told = [f"{name}={_display.measured(value, self.std.get(name, 0.0))}" for name, value in values.items()]
        lens = f",\n       {', '.join(told[4:])}" if told[4:] else ""
        return f"Camera({self.width} x {self.height} {self.model}: {', '.join(told[:4])} px{lens})"

    def to_dict(self) -> dict[str, int | float | str]:
        """Give the parameters as a row, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to int, float or str
            Size and model, intrinsics and distortion coefficients in pixels by name, and ``fx_std`` and so on where a
            deviation is known.

        Examples
        --------
        >>> from rsflow import Camera
        >>> Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240, std={"fx": 0.5}).to_dict()["fx_std"]
        0.5
        """
        values = {"fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy}
        values |= dict(zip(self.distortion_names, self.distortion, strict=True))
        deviations = {f"{name}_std": value for name, value in self.std.items()}
        return {"width": self.width, "height": self.height, "model": self.model, **values, **deviations}

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle between the rays of the left and right edge of the picture, along the row of the principal point."""
        return self._angle([(-0.5, self.cy), (self.width - 0.5, self.cy)])

    @property
    def vertical_fov_rad(self) -> float:
        """Angle between the rays of the upper and the lower edge, along the column of the principal point."""
        return self._angle([(self.cx, -0.5), (self.cx, self.height - 0.5)])

    def _angle(self, edges: list[tuple[float, float]]) -> float:
        pixels = np.array(edges)
        rays = np.column_stack([self.undistort_points(pixels, normalized=True), np.ones(2)])
        if not np.isfinite(rays).all():
            return math.nan
        return float(math.atan2(np.linalg.norm(np.cross(rays[0], rays[1])), float(rays[0] @ rays[1])))

    def undistort_points(self, points: ArrayLike, *, normalized: bool = False) -> NDArray[np.floating[Any]]:
        """Remove the lens distortion from points of the picture.

        Parameters
        ----------
        points : (N, 2) array
            Pixels (x, y) of the picture as taken.
        normalized : bool
            Give normalised coordinates (X/Z, Y/Z) instead of pixels.

        Returns
        -------
        (N, 2) array
            Where an ideal camera with the same intrinsics and no distortion would see the points, in pixels; float32
            for float32 points, else float64. NaN where no ray inside the valid range of the lens model leads to the
            point.

        Raises
        ------
        ShapeError
            If `points` is not (N, 2).

        Examples
        --------
        >>> from rsflow import Camera
        >>> camera = Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
        >>> camera.undistort_points([[159.5, 119.5], [300.0, 119.5]]).round(1)
        array([[159.5, 119.5],
               [306.7, 119.5]])
        """
        normalized = _checks.flag("normalized", normalized)
        pixels, dtype = _points(points)
        xy = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        if any(self.distortion) or self.model == "fisheye":
            xy = _distortion.invert(self.model, self.distortion, xy)
        if not normalized:
            xy = xy * (self.fx, self.fy) + (self.cx, self.cy)
        return xy.astype(dtype, copy=False)

    def distort_points(self, points: ArrayLike, *, normalized: bool = False) -> NDArray[np.floating[Any]]:
        """Apply the lens distortion: the inverse of `undistort_points`.

        Parameters
        ----------
        points : (N, 2) array
            Ideal pixels (x, y), or normalised coordinates (X/Z, Y/Z) where `normalized` is True.
        normalized : bool
            What `points` are.

        Returns
        -------
        (N, 2) array
            Pixels of the picture as taken; float32 for float32 points, else float64.

        Raises
        ------
        ShapeError
            If `points` is not (N, 2).

        Examples
        --------
        >>> from rsflow import Camera
        >>> camera = Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
        >>> camera.distort_points(camera.undistort_points([[300.0, 119.5]])).round(6)
        array([[300. , 119.5]])
        """
        normalized = _checks.flag("normalized", normalized)
        xy, dtype = _points(points)
        if not normalized:
            xy = (xy - (self.cx, self.cy)) / (self.fx, self.fy)
        xy = _distortion.forward(self.model, self.distortion, xy)
        return (xy * (self.fx, self.fy) + (self.cx, self.cy)).astype(dtype, copy=False)

    def scaled(self, width: int, height: int) -> Self:
        """Give the camera of the same pictures resized to `width` x `height`.

        A resized picture spans the same field, from edge to edge: x becomes (x + 0.5) s - 0.5 with s = width / old
        width, since pixel centres are at integers. That is what `cv2.resize` does. For a crop see `cropped`.

        Parameters
        ----------
        width, height : int
            Size of the resized pictures, in pixels.

        Raises
        ------
        OptionError
            If the size is below 1 x 1.

        Examples
        --------
        >>> from rsflow import Camera
        >>> camera = Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
        >>> half = camera.scaled(160, 120)
        >>> half.fx, half.cx
        (150.0, 79.5)
        """
        width = _checks.integer("width", width, least=1, most=LARGEST, of="pixels")
        height = _checks.integer("height", height, least=1, most=LARGEST, of="pixels")
        sx, sy = width / self.width, height / self.height
        factors = {"fx": sx, "cx": sx, "fy": sy, "cy": sy}
        return dataclasses.replace(
            self,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            width=width,
            height=height,
            std={name: value * factors.get(name, 1.0) for name, value in self.std.items()},
        )

    def cropped(self, roi: tuple[int, int, int, int]) -> Self:
        """Give the camera of the same pictures cropped to `roi`, (x, y, width, height) in pixels.

        Parameters
        ----------
        roi : (int, int, int, int)
            Inside the picture.

        Raises
        ------
        OptionError
            If the region does not lie inside the picture.

        Examples
        --------
        >>> from rsflow import Camera
        >>> camera = Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
        >>> part = camera.cropped((100, 60, 120, 120))
        >>> part.cx, part.cy, part.size
        (59.5, 59.5, (120, 120))
        """
        x, y, w, h = _checks.region("roi", roi)
        if w < 1 or h < 1 or x + w > self.width or y + h > self.height:
            raise OptionError(f"roi: got {(x, y, w, h)}, expected a region inside {self.width} x {self.height} pixels")
        return dataclasses.replace(self, cx=self.cx - x, cy=self.cy - y, width=w, height=h)

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], *, camera: str | None = None, size: tuple[int, int] | None = None
    ) -> Camera:
        """Read a camera from a file; its format is found from its content.

        Parameters
        ----------
        path : path
            ROS camera_info YAML, OpenCV FileStorage (YAML, XML or JSON), kalibr camchain YAML, or rsflow's JSON.
        camera : str, optional
            Which camera of a kalibr chain, "cam0" for instance; needed where it holds several.
        size : (width, height), optional
            Size of the calibration pictures, for OpenCV files that do not say it.

        Raises
        ------
        FormatError
            If the content is not a camera; the message names file, key, what it got and what it expected.
        OSError
            If the file cannot be read.

        Examples
        --------
        >>> from rsflow import Camera
        >>> camera = Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
        >>> import pathlib, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     camera.save(pathlib.Path(folder, "camera.yml"))
        ...     again = Camera.load(pathlib.Path(folder, "camera.yml"))
        >>> again == camera
        True
        """
        from . import files

        read = files.read(path, camera=camera, size=size)
        return Camera(**{part.name: getattr(read, part.name) for part in dataclasses.fields(read)})

    def save(self, path: str | os.PathLike[str], *, format: CameraFormat | None = None) -> None:
        """Write the camera to a file.

        Parameters
        ----------
        path : path
            ``.json`` is rsflow's own, ``.yaml`` ROS camera_info, ``.yml`` and ``.xml`` OpenCV FileStorage.
        format : {"json", "opencv", "ros", "kalibr"}, optional
            Overrules what the suffix says. "kalibr" does not keep the deviations (`std`).

        Raises
        ------
        OptionError
            If the suffix says no format, or the format cannot hold this camera.
        """
        from . import files

        files.write(self, path, format=format)


def _points(points: ArrayLike) -> tuple[NDArray[np.float64], np.dtype[Any]]:
    array = _checks.coordinates("points", points)
    dtype = array.dtype if array.dtype == np.float32 else np.dtype(np.float64)
    return array.astype(np.float64), dtype
