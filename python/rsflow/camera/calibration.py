"""Camera calibration from pictures of a board, with deviations that hold and advice that can be followed."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError, OptionError
from . import _solve
from ._search import Searcher, SearchTimeoutError
from .board import Board, Corners, Pattern
from .capture import Frame, Frames, frames
from .model import Camera, CameraFormat

__all__ = ["Calibration", "View", "calibrate"]

# Fewer views leave f, the principal point and the distortion undetermined, or barely.
_LEAST_VIEWS = 3

# Relative deviation of f from which the views cannot be said to determine it.
_UNDETERMINED = 0.2

# Distortion coefficients that can be estimated.
_COEFFICIENTS = (0, 4, 5, 8, 12)

# Share of the picture's diagonal by which the corners of a video frame must have moved, to be a view of its own.
_DISTINCT = 0.05

# The same for pictures: less is the same picture twice (1.6 pixels of 640 x 480).
_SAME = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One picture of the board.

    Attributes
    ----------
    name : str
        File name, or frame number.
    used : bool
        Whether the calibration uses it.
    reason : str
        Why it does not; empty where it does.
    corners : (N, 2) float32
        Corners found, in pixels; (0, 2) where none were.
    ids : (N,) int64
        Which corner of the board each is.
    repaired : int
        How many corners something beside the board (a square cut by the paper's edge, say) had pulled away from their
        place and were set right.
    rms : float
        Root mean square distance between corners and model, in pixels; NaN where the view is not used.
    residuals : (N, 2) float64
        Found minus modelled position, in pixels.
    tilt_rad : float
        Angle between the board's normal and the optical axis; NaN where the view is not used.
    influence : float
        How far f would move if this view were left out, as a share of f; NaN where the view is not used.
    """

    name: str
    used: bool
    reason: str = ""
    corners: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    repaired: int = 0
    rms: float = math.nan
    residuals: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    tilt_rad: float = math.nan
    influence: float = math.nan
    # The picture as JPEG, for `Calibration.draw`: a tenth of its size in memory.
    jpeg: bytes = field(default=b"", repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What `calibrate` found.

    Attributes
    ----------
    camera : Camera
        The camera, with the deviations of its parameters in `Camera.std`.
    rms : float
        Root mean square distance between all corners and the model, in pixels.
    views : tuple of View
        Every picture looked at, used or not, in order.
    board : Board
        The board.
    std_views : dict of str to float
        The part of each deviation that comes from the spread between views.
    std_repair : dict of str to float
        The part that comes from corners that had to be set right: how far the parameter moves without that.
    """

    camera: Camera
    rms: float
    views: tuple[View, ...]
    board: Board
    std_views: dict[str, float]
    std_repair: dict[str, float]

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each parameter: the spread between views and the effect of repairs together."""
        return dict(self.camera.std)

    @property
    def used(self) -> tuple[View, ...]:
        """The views that the calibration uses."""
        return tuple(view for view in self.views if view.used)

    @property
    def rejected(self) -> dict[str, str]:
        """Names of the other pictures, and why they are not used."""
        return {view.name: view.reason for view in self.views if not view.used}

    @property
    def per_view_errors(self) -> NDArray[np.float64]:
        """Root mean square error of each used view, in pixels."""
        return np.array([view.rms for view in self.used])

    @property
    def focal_deviation(self) -> float:
        """Relative standard deviation of the focal length, the larger of both axes.

        A velocity over ground is height times flow over f: it has at least this relative deviation.
        """
        return max(self.camera.std["fx"] / self.camera.fx, self.camera.std["fy"] / self.camera.fy)

    def coverage(self, columns: int = 8, rows: int = 6) -> NDArray[np.int64]:
        """Count the corners in each cell of a grid over the picture, (rows, columns)."""
        from ._calibration_report import coverage

        return coverage(self, columns, rows)

    @property
    def covered(self) -> float:
        """Share of the cells of an 8 x 6 grid over the picture that hold at least one corner."""
        return float(np.mean(self.coverage() > 0))

    def advice(self) -> tuple[str, ...]:
        """Say what would make this calibration better, most important first; empty where nothing would."""
        from ._calibration_report import advice

        return advice(self)

    def summary(self) -> str:
        """Give the result, its views and the advice as text."""
        from ._calibration_report import summary

        return summary(self)

    def as_dict(self) -> dict[str, Any]:
        """Give everything but the corners as plain values, for JSON."""
        from ._calibration_report import as_dict

        return as_dict(self)

    def save(self, path: str | os.PathLike[str], *, format: CameraFormat | None = None) -> None:
        """Write the camera; see `Camera.save`."""
        self.camera.save(path, format=format)

    def draw(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write a picture of each view with the corners found, and one of the coverage; give their paths.

        Arrows show found minus modelled position, fifty times enlarged. A view without a board is written as it is,
        with the reason.
        """
        from ._calibration_report import draw

        return draw(self, Path(folder))


def calibrate(
    images: Any,
    *,
    board: tuple[int, int],
    square_size_m: float,
    pattern: Pattern = "chessboard",
    marker_size_m: float | None = None,
    dictionary: str = "DICT_4X4_50",
    legacy_pattern: bool = False,
    coefficients: int = 5,
    square_pixels: bool = False,
    time_budget_s: float = 120.0,
    view_time_budget_s: float = 5.0,
    max_views: int = 60,
    distinct: float | None = None,
    on_view: Callable[[View, int], bool | None] | None = None,
) -> Calibration:
    """Calibrate a camera from pictures of a chessboard or ChArUco board.

    Parameters
    ----------
    images : Frames, or anything that `frames` takes
        Pictures of the board from at least 3, better 15, positions: near and far, tilted by 20 to 45 degrees, in every
        corner of the picture.
    board : (int, int)
        Columns and rows: of inner corners for a chessboard (a board of 10 x 7 squares has 9 x 6), of squares for a
        ChArUco board.
    square_size_m : float
        Side of a square in metres.
    pattern : {"chessboard", "charuco"}
        What is printed.
    marker_size_m, dictionary, legacy_pattern
        ChArUco: side of a marker (by default 3/4 of the square's), name of its ArUco dictionary, and whether it was
        made by OpenCV before 4.6.
    coefficients : {0, 4, 5, 8, 12}
        Distortion coefficients to estimate: k1 k2 p1 p2, then k3, then k4 to k6, then s1 to s4. The skew is zero.
    square_pixels : bool
        Hold fx = fy.
    time_budget_s : float
        Time for the search of boards in all pictures together, in seconds; pictures beyond it are not looked at. A
        live source ends with it.
    view_time_budget_s : float
        Time for the search in one picture; a search that takes longer is stopped and the picture rejected.
    max_views : int
        End the search with so many views.
    distinct : float, optional
        Share of the picture's diagonal by which the corners must differ from those of every view before. By default
        0.002 for pictures, which leaves out doubles, and 0.05 for a video or a live camera, most of whose frames show
        the same.
    on_view : callable, optional
        Called with each `View` and the number of usable ones so far, as soon as it was searched; the search ends where
        it returns True.

    Returns
    -------
    Calibration

    Raises
    ------
    CalibrationError
        If fewer than 3 views show the board, or the views do not determine a camera.
    CaptureError, ShapeError
        If the pictures cannot be read, or differ in size.
    OptionError
        If an option is outside of what it allows.

    Notes
    -----
    Deviations are those between views, not those of independent corners, which are too small; and where corners were
    pulled away by something beside the board and had to be set right, they include the whole effect of that. See
    `Calibration.std_views` and `Calibration.std_repair`.

    Examples
    --------
    >>> import rsflow
    >>> calibration = rsflow.calibrate("left*.jpg", board=(9, 6), square_size_m=0.025)  # doctest: +SKIP
    >>> calibration.save("camera.yaml")  # doctest: +SKIP
    """
    target = Board(board, square_size_m, pattern, marker_size_m, dictionary, legacy_pattern)
    if coefficients not in _COEFFICIENTS:
        raise OptionError(f"coefficients: got {coefficients!r}, expected one of {', '.join(map(str, _COEFFICIENTS))}")
    for name, value in (("time_budget_s", time_budget_s), ("view_time_budget_s", view_time_budget_s)):
        if not (math.isfinite(value) and value > 0):
            raise OptionError(f"{name}: got {value!r}, expected a finite number of seconds above 0")
    if max_views < _LEAST_VIEWS:
        raise OptionError(f"max_views: got {max_views}, expected at least {_LEAST_VIEWS}")
    source = images if isinstance(images, Frames) else frames(images)
    if distinct is None:
        distinct = _SAME if source.timestamps in ("none", "given") else _DISTINCT
    search = _Search(target, time_budget_s, view_time_budget_s, distinct)
    with source, Searcher() as searcher:
        try:
            for frame in source:
                if search.over():
                    # Pictures that are left are named; a video or a live source just ends.
                    if source.timestamps not in ("none", "given"):
                        break
                    search.pass_over(frame)
                    continue
                view = search.look(frame, searcher)
                if (on_view is not None and on_view(view, search.usable)) or search.usable >= max_views:
                    break
        except KeyboardInterrupt:
            # Ctrl-C is how a live source ends, once it has shown enough.
            if not source.live or search.usable < _LEAST_VIEWS:
                raise
        if not search.usable and pattern == "chessboard":
            search.try_smaller(searcher)
    return _calibrated(search, target, coefficients, square_pixels)


class _Search:
    """The pictures looked at so far."""

    def __init__(self, board: Board, budget_s: float, view_budget_s: float, distinct: float) -> None:
        self.board = board
        self.views: list[tuple[View, Corners | None]] = []
        self.size: tuple[int, int] | None = None
        self.hint = ""
        self._end_s = time.monotonic() + budget_s
        self._view_budget_s = view_budget_s
        self._distinct = distinct
        self._samples: list[NDArray[np.uint8]] = []

    @property
    def usable(self) -> int:
        return sum(corners is not None for _, corners in self.views)

    def over(self) -> bool:
        return time.monotonic() >= self._end_s

    def pass_over(self, frame: Frame) -> None:
        self.views.append((View(_name(frame), False, "not looked at: the time budget is used up"), None))

    def look(self, frame: Frame, searcher: Searcher) -> View:
        image = to_8bit(frame.image)
        self.size = (image.shape[1], image.shape[0])
        corners, reason = None, ""
        try:
            seconds = min(self._view_budget_s, self._end_s - time.monotonic())
            corners = searcher.find(image, self.board, seconds)
            reason = "" if corners is not None else "no board found"
        except SearchTimeoutError as error:
            reason = str(error)
        if corners is not None and self._is_near(corners):
            corners, reason = None, "shows the board where an earlier view does"
        if corners is None and len(self._samples) < 3:
            self._samples.append(image)
        # Of a video or a live camera thousands of frames are not used: only pictures keep those to be looked at.
        keep = corners is not None or self._distinct < _DISTINCT
        view = View(_name(frame), corners is not None, reason, jpeg=_jpeg(image) if keep else b"")
        if corners is not None:
            view = View(
                view.name,
                True,
                corners=corners.points,
                ids=corners.ids,
                repaired=int(corners.repaired.sum()),
                jpeg=view.jpeg,
            )
        self.views.append((view, corners))
        return view

    def _is_near(self, corners: Corners) -> bool:
        if self._distinct <= 0 or self.size is None:
            return False
        least = self._distinct * math.hypot(*self.size)
        for _, other in self.views:
            if other is None:
                continue
            _, mine, theirs = np.intersect1d(corners.ids, other.ids, return_indices=True)
            if len(mine) and float(np.linalg.norm(corners.points[mine] - other.points[theirs], axis=1).mean()) < least:
                return True
        return False

    def try_smaller(self, searcher: Searcher) -> None:
        """Find out whether squares were counted instead of inner corners."""
        if min(self.board.size) < 4:
            return
        smaller = self.board.smaller()
        for image in self._samples:
            try:
                if not self.over() and searcher.find(image, smaller, min(2.0, self._view_budget_s)) is not None:
                    cols, rows = smaller.size
                    self.hint = f"; a board of {cols} x {rows} inner corners is there: count corners, not squares"
                    return
            except (SearchTimeoutError, CalibrationError):
                return


def _calibrated(search: _Search, board: Board, coefficients: int, square_pixels: bool) -> Calibration:
    found = [(view, corners) for view, corners in search.views if corners is not None]
    if len(found) < _LEAST_VIEWS or search.size is None:
        raise CalibrationError(_too_few(search, board, len(found)))
    all_points = board.points()
    flat = [all_points[corners.ids] for _, corners in found]
    solution = _solve.solve(flat, [c.points for _, c in found], search.size, coefficients, square_pixels)
    names = ("fx", "fy", "cx", "cy", *_names(coefficients))
    repair = np.zeros(len(names))
    if any(view.repaired for view, _ in found):
        plain = _solve.solve(flat, [c.plain for _, c in found], search.size, coefficients, square_pixels)
        repair = np.abs(plain.values - solution.values)
    std = np.hypot(solution.std, repair)
    if not (np.isfinite(std).all() and std[0] < _UNDETERMINED * solution.values[0]):
        raise CalibrationError(
            f"the {len(found)} views do not determine the focal length: got {solution.values[0]:.1f} "
            f"+- {std[0]:.1f} px: "
            "tilt the board by 20 to 45 degrees, in different directions"
        )
    width, height = search.size
    fx, fy, cx, cy = (float(value) for value in solution.values[:4])
    try:
        camera = Camera(
            fx,
            fy,
            cx,
            cy,
            width=width,
            height=height,
            distortion=tuple(solution.values[4:]),
            std=dict(zip(names, std.tolist(), strict=True)),
        )
    except OptionError as error:
        raise CalibrationError(f"the views do not determine a camera: {error}") from None
    numbers = {id(view): i for i, (view, _) in enumerate(found)}
    views = tuple(
        view if id(view) not in numbers else _measured(view, solution, numbers[id(view)]) for view, _ in search.views
    )
    return Calibration(
        camera,
        solution.rms,
        views,
        board,
        dict(zip(names, solution.std.tolist(), strict=True)),
        dict(zip(names, repair.tolist(), strict=True)),
    )


def _measured(view: View, solution: _solve.Solution, number: int) -> View:
    import cv2

    residuals = solution.residuals[number]
    normal = cv2.Rodrigues(solution.rotations[number])[0][:, 2]
    return View(
        view.name,
        True,
        "",
        view.corners,
        view.ids,
        view.repaired,
        float(np.sqrt((residuals**2).sum(axis=1).mean())),
        residuals,
        float(math.acos(min(1.0, abs(float(normal[2]))))),
        float(solution.influence[number, 0] / solution.values[0]),
        view.jpeg,
    )


def _names(coefficients: int) -> tuple[str, ...]:
    from ._distortion import NAMES

    return NAMES["pinhole"][:coefficients]


def _too_few(search: _Search, board: Board, count: int) -> str:
    cols, rows = board.size
    what = "inner corners" if board.pattern == "chessboard" else "squares (ChArUco)"
    reasons: dict[str, int] = {}
    for view, corners in search.views:
        if corners is None:
            reasons[view.reason] = reasons.get(view.reason, 0) + 1
    why = "; ".join(f"{reason} in {number}" for reason, number in reasons.items())
    return (
        f"a board of {cols} x {rows} {what} was found in {count} of {len(search.views)} pictures, expected at least "
        f"{_LEAST_VIEWS}{': ' if why else ''}{why}{search.hint}"
    )


def _name(frame: Frame) -> str:
    return Path(frame.name).name if frame.name else f"frame {frame.index}"


def to_8bit(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Give a grey picture in 8 bits, stretched from its darkest to its brightest pixel where it has more."""
    if image.dtype == np.uint8:
        return image
    low, high = float(np.nanmin(image)), float(np.nanmax(image))
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        return np.zeros(image.shape, np.uint8)
    stretched = np.nan_to_num(image.astype(np.float32) - low) * (255.0 / (high - low))
    grey: NDArray[np.uint8] = stretched.round().astype(np.uint8)
    return grey


def _jpeg(image: NDArray[np.uint8]) -> bytes:
    import cv2

    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])
    return data.tobytes() if done else b""
