"""The pictures of a calibration: each one searched for the board, within a time."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._display import fields
from ..capture.stream import Frame
from ..errors import CalibrationError
from .board import Board
from .detect import Corners
from .detect_process import Searcher, SearchTimeoutError

__all__ = ["DISTINCT", "SAME", "VIEW_COLUMNS", "Search", "View", "to_8bit"]

# Share of the picture's diagonal by which the corners of a video frame must have moved, to be a view of its own.
DISTINCT = 0.05

# The same for pictures: less is the same picture twice (1.6 pixels of 640 x 480).
SAME = 0.002

# Of `View.to_dict`.
VIEW_COLUMNS = ("name", "used", "reason", "corners", "repaired", "rms_px", "tilt_rad", "influence")


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

    Examples
    --------
    >>> import rsflow
    >>> camera = rsflow.Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    >>> views = rsflow.synthetic.chessboard_views(camera, count=4)
    >>> view = rsflow.calibrate(views, board=(8, 6), square_size_m=0.025, coefficients=0).views[0]
    >>> view.name, view.used, view.corners.shape, view.rms < 0.1
    ('frame 0', True, (48, 2), True)
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

    __repr__ = fields

    def to_dict(self) -> dict[str, str | bool | int | float]:
        """Give its figures as a row; `Calibration.to_table` has one for each view.

        Returns
        -------
        dict of str to str, bool, int or float

        Examples
        --------
        >>> from rsflow.calibration import View
        >>> row = View("frame-3", False, reason="no board").to_dict()
        >>> row["name"], row["used"], row["reason"], row["corners"]
        ('frame-3', False, 'no board', 0)
        """
        return {
            "name": self.name,
            "used": self.used,
            "reason": self.reason,
            "corners": len(self.corners),
            "repaired": self.repaired,
            "rms_px": self.rms,
            "tilt_rad": self.tilt_rad,
            "influence": self.influence,
        }


class Search:
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
        """Number of views with the board."""
        return sum(corners is not None for _, corners in self.views)

    def over(self) -> bool:
        """Say whether the time for all searches is used up."""
        return time.monotonic() >= self._end_s

    def pass_over(self, frame: Frame) -> None:
        """Note a picture that is not looked at."""
        self.views.append((View(_name(frame), False, "not looked at: the time budget is used up"), None))

    def look(self, frame: Frame, searcher: Searcher) -> View:
        """Search one picture for the board."""
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
        keep = corners is not None or self._distinct < DISTINCT
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

    def shortage(self, least: int) -> str:
        """Say that the board was found in too few pictures, and why not in the others."""
        cols, rows = self.board.size
        what = "inner corners" if self.board.pattern == "chessboard" else "squares (ChArUco)"
        reasons: dict[str, int] = {}
        for view, corners in self.views:
            if corners is None:
                reasons[view.reason] = reasons.get(view.reason, 0) + 1
        why = "; ".join(f"{reason} in {number}" for reason, number in reasons.items())
        return (
            f"a board of {cols} x {rows} {what} was found in {self.usable} of {len(self.views)} pictures, expected at "
            f"least {least}{': ' if why else ''}{why}{self.hint}"
        )

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


def _name(frame: Frame) -> str:
    return Path(frame.name).name if frame.name else f"frame {frame.index}"


def to_8bit(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Give a grey picture in 8 bits, stretched from its darkest to its brightest pixel where it has more."""
    if image.dtype == np.uint8:
        return image
    known = image[np.isfinite(image)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    if not high > low:
        return np.zeros(image.shape, np.uint8)
    # What is infinite is black or white.
    stretched = (np.nan_to_num(image.astype(np.float64), nan=low).clip(low, high) - low) * (255.0 / (high - low))
    grey: NDArray[np.uint8] = stretched.round().astype(np.uint8)
    return grey


def _jpeg(image: NDArray[np.uint8]) -> bytes:
    import cv2

    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])
    return data.tobytes() if done else b""
