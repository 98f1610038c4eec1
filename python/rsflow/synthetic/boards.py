"""A chessboard before a camera: the pictures that a calibration starts from, of a camera that is known exactly."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..camera.model import Camera
from .sensor import Sensor, sensor_or

__all__ = ["chessboard_views"]

# Dots of the printed sheet a square, and samples of the picture a pixel and axis.
DOTS = 32
SAMPLES = 3
# Grey levels of paper, ink, and what is around the sheet.
PAPER, INK, AROUND = 205, 30, 90
# Squares from the edge of the sheet to the first inner corner.
FIRST_CORNER = 3.0


def chessboard_views(
    camera: Camera,
    *,
    board: tuple[int, int] = (8, 6),
    square_size_m: float = 0.025,
    count: int = 12,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """Render views of a chessboard, tilted, near and far, and all over the picture.

    Parameters
    ----------
    camera : Camera
        Whose pictures they are: its lens bends them.
    board : (int, int)
        Columns and rows of inner corners, as for `rsflow.calibrate`.
    square_size_m : float
        Side of a square in metres.
    count : int
        How many views.
    sensor : Sensor, optional
        Noise of 2 grey levels and a blur of 0.6 pixels by default.
    seed : int
        Of positions and noise.

    Returns
    -------
    ndarray of uint8, (count, height, width)

    Raises
    ------
    OptionError
        If the board has fewer than 3 corners a side, the square no size, or there is no view.

    Examples
    --------
    >>> import rsflow
    >>> from rsflow import synthetic
    >>> true = rsflow.Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
    >>> views = synthetic.chessboard_views(true, count=5)
    >>> found = rsflow.calibrate(views, board=(8, 6), square_size_m=0.025)
    >>> bool(abs(found.camera.fx - true.fx) < 4 * found.std["fx"])
    True
    """
    _checks.instance("camera", camera, Camera, "an rsflow.Camera")
    board = _checks.size("board", board, least=3, most=200)
    square_size_m = _checks.number("square_size_m", square_size_m, least=1e-6, most=1e6, of="metres")
    count = _checks.integer("count", count, least=1, most=10_000)
    seed = _checks.integer("seed", seed, least=0)
    sensor = sensor_or(Sensor(noise=2.0, blur_px=0.6), sensor)
    sheet, rays = chessboard_sheet(board), sample_rays(camera)
    rng = np.random.default_rng(seed)
    views = []
    for number in range(count):
        rotation, middle = _pose(camera, board, square_size_m, number, rng)
        first = middle - rotation @ (np.append(np.subtract(board, 1) / 2.0, 0.0) * square_size_m)
        levels = seen(camera, rays, sheet, rotation, first, square_size_m, FIRST_CORNER)
        margin = sensor.margin
        blurred = sensor.blur(np.pad(levels.astype(np.float64), margin, mode="edge"))
        views.append(sensor.expose(blurred, rng))
    return np.stack(views)


def chessboard_sheet(board: tuple[int, int]) -> NDArray[np.uint8]:
    """Print a board of so many inner corners on paper: `DOTS` a square, the first corner at `FIRST_CORNER`."""
    cols, rows = board
    sheet = np.full(((rows + 5) * DOTS, (cols + 5) * DOTS), AROUND, np.uint8)
    sheet[DOTS // 2 : -DOTS // 2, DOTS // 2 : -DOTS // 2] = PAPER
    for y in range(rows + 1):
        for x in range(y % 2, cols + 1, 2):
            sheet[(y + 2) * DOTS : (y + 3) * DOTS, (x + 2) * DOTS : (x + 3) * DOTS] = INK
    return sheet


def sample_rays(camera: Camera) -> NDArray[Any]:
    """Give the ray of each sample of a picture, (SAMPLES height, SAMPLES width, 2), at distance 1."""
    import cv2

    centres = np.mgrid[0 : camera.height, 0 : camera.width].reshape(2, -1)[::-1].T
    at_centres = camera.undistort_points(centres, normalized=True).reshape(camera.height, camera.width, 2)
    rays: NDArray[Any] = cv2.resize(at_centres, None, fx=SAMPLES, fy=SAMPLES, interpolation=cv2.INTER_LINEAR)
    return rays


def seen(
    camera: Camera,
    rays: NDArray[Any],
    sheet: NDArray[np.uint8],
    rotation: NDArray[np.float64],
    first: NDArray[np.float64],
    square_size_m: float,
    first_corner: float,
) -> NDArray[np.float32]:
    """Render a sheet whose first corner, `first_corner` squares from its edges, is at `first` in metres."""
    import cv2

    inverse = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], first]))
    to_dots = np.diag([DOTS / square_size_m, DOTS / square_size_m, 1.0])
    to_dots[:2, 2] = first_corner * DOTS - 0.5
    where = cv2.perspectiveTransform(rays, to_dots @ inverse).astype(np.float32)
    fine = cv2.remap(sheet, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=AROUND)
    levels: NDArray[np.float32] = cv2.resize(fine.astype(np.float32), camera.size, interpolation=cv2.INTER_AREA)
    return levels


def _pose(
    camera: Camera, board: tuple[int, int], square_size_m: float, number: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation, and the middle of the board in metres: it takes 45 to 75 % of the picture's width or height."""
    import cv2

    tilt, axis, share = rng.uniform(0.3, 0.6), rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.45, 0.75)
    rotation = cv2.Rodrigues(tilt * np.array([math.cos(axis), math.sin(axis), rng.uniform(-0.3, 0.3)]))[0]
    size_m = (np.array(board) + 1.0) * square_size_m
    focal, picture = np.array([camera.fx, camera.fy]), np.array([camera.width, camera.height], np.float64)
    distance = float((focal * size_m / (share * picture)).max())
    # A place of nine, a little within the room that is left.
    room = 0.4 * np.clip(1.0 - focal * size_m / (distance * picture), 0.0, None) * picture
    place = np.array([number % 3 - 1.0, number // 3 % 3 - 1.0]) * room
    centre = (picture - 1.0) / 2.0 + place
    ray = camera.undistort_points(centre[None], normalized=True)[0]
    return rotation, np.append(ray * distance, distance)
