"""Camera calibration from pictures of a board, with deviations that hold and advice that can be followed.

docs/explanation/algorithms.md, section "Calibration: calibrate".
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .. import _checks
from ..camera.distortion import NAMES
from ..camera.model import Camera, CameraModel
from ..capture.opening import frames
from ..capture.stream import Frames, FrameSource
from ..errors import CalibrationError, DTypeError, OptionError, ShapeError
from . import solve
from .board import Board, Pattern
from .detect_process import Searcher
from .lens_doubts import doubts
from .result import Calibration
from .views import DISTINCT, SAME, Search, View

__all__ = ["Calibration", "View", "calibrate"]

# Fewer views leave f, the principal point and the distortion undetermined, or barely.
_LEAST_VIEWS = 3

# Distortion coefficients that can be estimated, and those that are by default.
_COEFFICIENTS = {"pinhole": (0, 4, 5, 8, 12), "fisheye": (0, 4)}
_USUAL = {"pinhole": 5, "fisheye": 4}


def calibrate(
    images: FrameSource,
    *,
    board: tuple[int, int],
    square_size_m: float,
    pattern: Pattern = "chessboard",
    marker_size_m: float | None = None,
    dictionary: str = "DICT_4X4_50",
    legacy_pattern: bool = False,
    model: CameraModel = "pinhole",
    coefficients: int | None = None,
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
    model : {"pinhole", "fisheye"}
        Of the lens: "fisheye" (equidistant) for those of more than some 110 degrees.
    coefficients : {0, 4, 5, 8, 12}, optional
        Distortion coefficients to estimate. Pinhole: k1 k2 p1 p2, then k3, then k4 to k6, then s1 to s4; 5 by default.
        Fisheye: none, or k1 to k4, which is the default. The skew is zero.
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
        If fewer than 3 views show the board, or the views do not determine a camera: the board is hardly tilted, starts
        from different focal lengths end at different ones, or f is not known to a tenth.
    CaptureError, ShapeError
        If the pictures cannot be read, or differ in size.
    OptionError
        If an option is outside of what it allows.

    Notes
    -----
    Deviations allow for errors that the corners of a view, or a corner of the board in all views, have in common; for a
    board that is bent or stretched as printed boards are, which is fitted too; for few views; and for a focal length
    that is more open than the tangent at the solution shows. Where corners were pulled away by something beside the
    board and had to be set right, they include the whole effect of that. Corners that lie off count less. See
    `Calibration.std_views` and `Calibration.std_repair`.

    Examples
    --------
    >>> import rsflow
    >>> camera = rsflow.Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    >>> images = rsflow.synthetic.chessboard_views(camera, count=5)  # of yours: images = "left*.jpg"
    >>> calibration = rsflow.calibrate(images, board=(8, 6), square_size_m=0.025)
    >>> round(calibration.camera.fx / camera.fx, 2)
    1.0
    """
    target = Board(board, square_size_m, pattern, marker_size_m, dictionary, legacy_pattern)
    _checks.choice("model", model, _COEFFICIENTS)
    if coefficients is None:
        coefficients = _USUAL[model]
    count = _checks.whole(coefficients)
    if count not in _COEFFICIENTS[model]:
        allowed = _checks.any_of([str(each) for each in _COEFFICIENTS[model]])
        raise _checks.refused("coefficients", coefficients, f"{allowed} for the model {model!r}")
    square_pixels = _checks.flag("square_pixels", square_pixels)
    time_budget_s = _checks.number("time_budget_s", time_budget_s, above=0, of="seconds")
    view_time_budget_s = _checks.number("view_time_budget_s", view_time_budget_s, above=0, of="seconds")
    max_views = _checks.integer("max_views", max_views, least=_LEAST_VIEWS)
    distinct = _checks.number_or_none("distinct", distinct, least=0, most=1)
    if on_view is not None:
        _checks.function("on_view", on_view, 2)
    source = images if isinstance(images, Frames) else _opened(images)
    if distinct is None:
        distinct = SAME if source.timestamps in ("none", "given") else DISTINCT
    search = Search(target, time_budget_s, view_time_budget_s, distinct)
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
    return _calibrated(search, target, model, count, square_pixels)


def _opened(images: FrameSource) -> Frames:
    """Open the pictures; an argument's name in an error is the caller's."""
    try:
        return frames(images)
    except (OptionError, ShapeError, DTypeError) as error:
        raise type(error)(str(error).replace("source:", "images:", 1)) from None


def _calibrated(
    search: Search, board: Board, model: CameraModel, coefficients: int, square_pixels: bool
) -> Calibration:
    found = [(view, corners) for view, corners in search.views if corners is not None]
    if len(found) < _LEAST_VIEWS or search.size is None:
        raise CalibrationError(search.shortage(_LEAST_VIEWS))
    all_points = board.points()
    flat = [all_points[corners.ids] for _, corners in found]
    solution = solve.solve(
        flat,
        [c.points for _, c in found],
        search.size,
        coefficients,
        square_pixels,
        ids=[c.ids for _, c in found],
        model=model,
    )
    names = ("fx", "fy", "cx", "cy", *NAMES[model][:coefficients])
    repair = np.zeros(len(names))
    if any(view.repaired for view, _ in found):
        repair = solve.again(solution, [c.plain for _, c in found]) - solution.values
    doubt = doubts(solution.problem, solution.found)
    other = np.concatenate([doubt.moved, np.zeros(coefficients)])
    covariance = solution.covariance + np.outer(repair, repair) + np.outer(other, other)
    std = np.sqrt(np.diag(covariance))
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
            model=model,
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
        dict(zip(names, np.abs(repair).tolist(), strict=True)),
        dict(zip(names, np.abs(other).tolist(), strict=True)),
        covariance,
        solution.span_rad,
        solution.bend_m,
        doubt.said,
    )


def _measured(view: View, solution: solve.Solution, number: int) -> View:
    residuals = solution.residuals[number]
    normal = solution.rotations[number][:, 2]
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
