"""How high a calibrated camera is over a board that lies on the ground, and which way is down."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import measured
from ..camera.model import Camera
from ..errors import CalibrationError, ShapeError
from .board import Board
from .detect import find_corners

__all__ = ["BoardHeight", "height_over_board"]

F64 = NDArray[np.float64]

# Corners are not known better than this in pixels, however well few of them agree: blur and light pull them together.
_LEAST_PX = 0.05
# Above this the corners do not fit a flat board before this camera, in pixels.
_MOST_PX = 2.0
# Steps of the differences: of a rotation vector in radians, and of a position relative to its length.
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class BoardHeight:
    """Height of a camera over a board, and the way straight down to it.

    Attributes
    ----------
    height_m, height_std_m : float
        Perpendicular distance of the camera's centre from the board's plane, and its standard deviation.
    range_m : float
        Distance to the plane along the optical axis.
    down : (3,) float64
        Straight down on the plane, a unit vector in the camera's axes, as `VelocityEstimator.update` takes it.
    down_std_rad : float
        Standard deviation of each of its two angles.
    rms_px : float
        How far corners lie from those of the fitted board.
    unstated : tuple of str
        What `height_std_m` is without, since no deviation was stated: "squares", of their size, which enters percent
        for percent, and "focal length", of the camera.

    Examples
    --------
    >>> from rsflow.calibration import BoardHeight
    >>> BoardHeight(0.5012, 0.0006, 0.5013, np.array([0.0, 0.02, 0.9998]), 0.001, 0.08)
    BoardHeight(height=0.50120 +- 0.00060 m, tilt=1.1 degrees, rms=0.08 px)
    """

    height_m: float
    height_std_m: float
    range_m: float
    down: F64
    down_std_rad: float
    rms_px: float
    unstated: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"BoardHeight({self})"

    def __str__(self) -> str:
        height = measured(self.height_m, self.height_std_m)
        told = f"height={height} m, tilt={np.degrees(self.tilt_rad):.1f} degrees, rms={self.rms_px:.2f} px"
        return told + (f", without the deviation of: {', '.join(self.unstated)}" if self.unstated else "")

    def to_dict(self) -> dict[str, float | str]:
        """Give it as a row, for ``pandas.DataFrame`` a list of such.

        Examples
        --------
        >>> row = BoardHeight(0.5, 0.001, 0.5, np.array([0.0, 0.0, 1.0]), 0.001, 0.1).to_dict()
        >>> row["height_m"], row["down_z"], row["std_without"]
        (0.5, 1.0, '')
        """
        return {
            "height_m": self.height_m,
            "height_std_m": self.height_std_m,
            "range_m": self.range_m,
            **{f"down_{axis}": float(value) for axis, value in zip("xyz", self.down, strict=True)},
            "down_std_rad": self.down_std_rad,
            "rms_px": self.rms_px,
            "std_without": "+".join(name.replace(" ", "_") for name in self.unstated),
        }

    @property
    def tilt_rad(self) -> float:
        """Angle between the optical axis and straight down."""
        return float(np.arctan2(np.hypot(*self.down[:2]), self.down[2]))


def height_over_board(
    image: NDArray[np.uint8], camera: Camera, *, board: Board, square_std_m: float | None = None
) -> BoardHeight:
    """Measure how high a calibrated camera is over a board that lies flat on the ground.

    A height that was measured by the camera that measures the velocity serves twice: an error of the focal length makes
    the height too large by about as much as it makes the velocity too small, and mostly drops out. What is left is the
    size of the squares, and the thickness of the board, which is to be added.

    Parameters
    ----------
    image : (height, width) uint8
        Grey picture of the board, of the camera's size.
    camera : Camera
        Calibrated.
    board : Board
        Whose squares have the size that was measured on the print.
    square_std_m : float, optional
        Standard deviation of that size: 0.2 mm over ten squares are 0.00002. 0 says exact; without it the share of the
        squares is missing, and `BoardHeight.unstated` says so.

    Returns
    -------
    BoardHeight

    Raises
    ------
    CalibrationError
        If the board is not seen, or does not fit: it is bent, of another size, or the camera is another.
    ShapeError, DTypeError
        If the picture does not have the camera's size, or is not grey.

    Examples
    --------
    >>> import rsflow
    >>> from rsflow.calibration import Board, height_over_board
    >>> camera = rsflow.Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    >>> (view,) = rsflow.synthetic.chessboard_views(camera, count=1)
    >>> found = height_over_board(view, camera, board=Board((8, 6), 0.025), square_std_m=0.00002)
    >>> bool(0.1 < found.height_m < found.range_m), found.unstated
    (True, ('focal length',))
    """
    _checks.instance("camera", camera, Camera, "an rsflow.Camera")
    _checks.instance("board", board, Board, "a Board")
    square_std_m = _checks.number_or_none("square_std_m", square_std_m, least=0, most=1e9, of="metres")
    height, width = _checks.frame("image", image).shape
    if (width, height) != camera.size:
        raise ShapeError(
            f"image: got {width} x {height} pixels, expected the camera's {camera.width} x {camera.height}; "
            f"use camera.scaled({width}, {height})"
        )
    corners = find_corners(image, board)
    if corners is None:
        columns, rows = board.size
        raise CalibrationError(f"the board of {columns} x {rows} is not seen whole in the picture")
    flat = board.points()[corners.ids].astype(np.float64)
    pixels = corners.points.astype(np.float64)
    pose = _pose(camera, flat, pixels, None)
    rms = float(np.sqrt(np.mean(_residuals(camera, flat, pixels, pose) ** 2)))
    if not rms <= _MOST_PX:
        raise CalibrationError(
            f"the board does not fit: its corners lie {rms:.1f} px (rms) from those of a flat board before this camera"
        )
    here = _plane(pose)
    slopes = _slopes(lambda other: _residuals(camera, flat, pixels, other).ravel(), pose)
    noise = max(rms * np.sqrt(len(flat) * 2 / max(len(flat) * 2 - 6, 1)), _LEAST_PX)
    spread = noise**2 * np.linalg.pinv(slopes.T @ slopes)
    change = _slopes(_plane, pose)
    covariance = change @ spread @ change.T
    for other in _others(camera):
        moved = _plane(_pose(other, flat, pixels, pose)) - here
        covariance += np.outer(moved, moved)
    covariance[0, 0] += (here[0] * (square_std_m or 0.0) / board.square_size_m) ** 2
    down = here[1:] / np.linalg.norm(here[1:])
    stated = {"squares": square_std_m is not None, "focal length": {"fx", "fy"} <= set(camera.std)}
    unstated = tuple(name for name, known in stated.items() if not known)
    angles = float(np.sqrt(np.trace(covariance[1:, 1:]) / 2.0))
    reach = float(here[0] / down[2])
    return BoardHeight(float(here[0]), float(np.sqrt(covariance[0, 0])), reach, down, angles, rms, unstated)


def _pose(camera: Camera, flat: F64, pixels: F64, start: F64 | None) -> F64:
    """Rotation vector and position of the board before the camera, (6,)."""
    import cv2

    rays = np.ascontiguousarray(camera.undistort_points(pixels, normalized=True), np.float64)
    if not np.isfinite(rays).all():
        raise CalibrationError("the board reaches to where the camera's lens model does not hold")
    if start is None:
        found, turn, place = cv2.solvePnP(flat, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
        if not found:
            raise CalibrationError("the corners of the board do not give its pose")
    else:
        turn, place = start[:3].reshape(3, 1).copy(), start[3:].reshape(3, 1).copy()
    turn, place = cv2.solvePnPRefineLM(flat, rays, np.eye(3), None, turn, place)
    return np.concatenate([turn.ravel(), place.ravel()])


def _residuals(camera: Camera, flat: F64, pixels: F64, pose: F64) -> F64:
    """How far corners are from where the pose puts them, (N, 2), in pixels."""
    import cv2

    placed = flat @ cv2.Rodrigues(pose[:3])[0].T + pose[3:]
    seen = camera.distort_points(placed[:, :2] / placed[:, 2:], normalized=True)
    return np.asarray(seen - pixels, np.float64)


def _plane(pose: F64) -> F64:
    """Height over the board's plane and the unit vector straight down, (4,)."""
    import cv2

    normal = cv2.Rodrigues(pose[:3])[0][:, 2]
    distance = float(normal @ pose[3:])
    return np.append(abs(distance), normal if distance > 0 else -normal)


def _slopes(of: Any, pose: F64) -> F64:
    """Give the derivative of a function of a pose."""
    columns = []
    for axis, step in enumerate(_STEP * np.repeat([1.0, np.linalg.norm(pose[3:])], 3)):
        ahead, back = pose.copy(), pose.copy()
        ahead[axis] += step
        back[axis] -= step
        columns.append((of(ahead) - of(back)) / (2.0 * step))
    return np.stack(columns, axis=1)


def _others(camera: Camera) -> list[Camera]:
    """Give the camera with each of its parameters off by a deviation; the focal lengths err together."""
    std = camera.std
    off: list[dict[str, float]] = [{name: std.get(name, 0.0) for name in ("fx", "fy")}]
    off += [{name: std.get(name, 0.0)} for name in ("cx", "cy")]
    return [
        dataclasses.replace(camera, **{name: getattr(camera, name) + value for name, value in one.items()})
        for one in off
        if any(one.values())
    ]
