"""The corners of a chessboard or ChArUco board in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import fields
from ..errors import DTypeError
from .board import Board

__all__ = ["Corners", "charuco_board", "charuco_detector", "find_corners"]

# Half the window of the corner refinement, in pixels: what OpenCV's calibration program uses.
_WINDOW = 11

# A corner moved by something else than its squares (a square cut by the edge of the paper, a reflection) differs
# between the full and half the window by more than this, in pixels, and by more than so many times the median.
_REPAIR_PX = 0.25
_REPAIR_MEDIANS = 4.0

# Pictures larger than this are searched at reduced size first, in pixels of the longer side; corners are then refined
# at full size.
_SEARCH_SIDE = 1280

# A ChArUco view with fewer corners says too little about the pose of its board.
_LEAST_CORNERS = 8

# A smaller picture shows no board, and the windows of OpenCV's thresholds do not fit into it.
_LEAST_SIDE = 16


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """Corners found in one picture.

    Attributes
    ----------
    points : (N, 2) float32
        Where they are, in pixels.
    ids : (N,) int64
        Which corner of `Board.points` each is.
    plain : (N, 2) float32
        The same before corners that something beside the board had pulled away were set right.

    Examples
    --------
    >>> import rsflow
    >>> from rsflow.calibration import Board, find_corners
    >>> camera = rsflow.Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    >>> (view,) = rsflow.synthetic.chessboard_views(camera, count=1)
    >>> corners = find_corners(view, Board((8, 6), 0.025))
    >>> corners.points.shape, corners.ids[:3].tolist()
    ((48, 2), [0, 1, 2])
    """

    points: NDArray[np.float32]
    ids: NDArray[np.int64]
    plain: NDArray[np.float32]

    __repr__ = fields

    @property
    def repaired(self) -> NDArray[np.bool_]:
        """Which corners were set right."""
        moved: NDArray[np.bool_] = np.any(self.points != self.plain, axis=1)
        return moved


def find_corners(image: NDArray[np.uint8], board: Board) -> Corners | None:
    """Find the corners of a board in a grey picture; None where it is not seen whole (ChArUco: mostly).

    This can take long on a picture full of squares; `calibrate` runs it where it can be stopped.

    Parameters
    ----------
    image : (H, W) uint8
        The picture.
    board : Board
        What to look for.

    Returns
    -------
    Corners or None

    Examples
    --------
    >>> import rsflow
    >>> from rsflow.calibration import Board, find_corners
    >>> camera = rsflow.Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    >>> (view,) = rsflow.synthetic.chessboard_views(camera, count=1)
    >>> find_corners(view, Board((8, 6), 0.025)).points.shape, find_corners(view, Board((9, 6), 0.025))
    ((48, 2), None)
    """
    _checks.instance("board", board, Board, "a Board")
    if _checks.frame("image", image).dtype != np.uint8 or image.size == 0:
        raise DTypeError(f"image: got {_checks.described(image)}, expected a picture of uint8")
    if min(image.shape) < _LEAST_SIDE:
        return None
    return _charuco(image, board) if board.pattern == "charuco" else _chessboard(image, board)


def _chessboard(image: NDArray[np.uint8], board: Board) -> Corners | None:
    import cv2

    height, width = image.shape
    found = None
    scale = _SEARCH_SIDE / max(width, height)
    if scale < 1.0:
        small = cv2.resize(image, (round(width * scale), round(height * scale)), interpolation=cv2.INTER_AREA)
        found = _search(small, board)
        if found is not None:
            ratio = np.array([width / small.shape[1], height / small.shape[0]], np.float32)
            found = (found + np.float32(0.5)) * ratio - np.float32(0.5)
    if found is None:
        found = _search(image, board)
    if found is None:
        return None
    grid = found.reshape(board.size[1], board.size[0], 2)
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1))
    half = round(np.clip(spacing / 2, 2, max(_WINDOW, spacing / 4)))
    plain = _refined(image, found, half)
    points = plain
    if half > 3:
        narrow = _refined(image, found, half // 2)
        apart = np.linalg.norm(plain - narrow, axis=1)
        pulled = apart > max(_REPAIR_PX, _REPAIR_MEDIANS * float(np.median(apart)))
        points = np.where(pulled[:, None], narrow, plain)
    if not np.isfinite(points).all():
        return None
    return Corners(points, np.arange(board.corners), plain)


def _search(image: NDArray[np.uint8], board: Board) -> NDArray[np.float32] | None:
    """Find all corners to about a pixel: first as OpenCV's calibration program does, the thorough search last."""
    import cv2

    classic = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    sector = cv2.CALIB_CB_NORMALIZE_IMAGE
    searches = (
        (cv2.findChessboardCorners, classic | cv2.CALIB_CB_FAST_CHECK),
        (cv2.findChessboardCornersSB, sector),
        (cv2.findChessboardCorners, classic),
        (cv2.findChessboardCornersSB, sector | cv2.CALIB_CB_EXHAUSTIVE),
    )
    for search, flags in searches:
        found, corners = search(image, board.size, flags=flags)
        if found and corners is not None:
            points: NDArray[np.float32] = np.asarray(corners, np.float32).reshape(-1, 2)
            if len(points) == board.corners and np.isfinite(points).all():
                return points
    return None


def _refined(image: NDArray[np.uint8], corners: NDArray[np.float32], half: int) -> NDArray[np.float32]:
    import cv2

    # Stop at 1e-3 px, well under the noise of a corner, or after 50 steps.
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    start = corners.reshape(-1, 1, 2).copy()
    refined: NDArray[np.float32] = cv2.cornerSubPix(image, start, (half, half), (-1, -1), criteria).reshape(-1, 2)
    return refined


def _charuco(image: NDArray[np.uint8], board: Board) -> Corners | None:
    import cv2

    corners, ids = charuco_detector(board).detectBoard(image)[:2]
    if corners is None or ids is None:
        return None
    points = np.asarray(corners, np.float32).reshape(-1, 2)
    numbers = np.asarray(ids).ravel().astype(np.int64)
    if len(points) < _LEAST_CORNERS or len(points) != len(numbers) or not np.isfinite(points).all():
        return None
    flat = board.points()[numbers, :2]
    # Corners along one line leave the pose open.
    if np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)[1] < board.square_size_m:
        return None
    spacing = board.square_size_m / float(np.ptp(flat, axis=0).max()) * float(np.ptp(points, axis=0).max())
    half = int(np.clip(spacing / 8, 2, _WINDOW))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    refined = cv2.cornerSubPix(image, points.reshape(-1, 1, 2).copy(), (half, half), (-1, -1), criteria).reshape(-1, 2)
    return Corners(refined, numbers, refined)


def charuco_board(board: Board) -> Any:
    """Make OpenCV's ChArUco board."""
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    marker = board.marker_size_m or 0.75 * board.square_size_m
    made = cv2.aruco.CharucoBoard(board.size, board.square_size_m, marker, dictionary)
    made.setLegacyPattern(board.legacy_pattern)
    return made


def charuco_detector(board: Board) -> Any:
    """Make OpenCV's detector for a ChArUco board."""
    import cv2

    return cv2.aruco.CharucoDetector(charuco_board(board))
