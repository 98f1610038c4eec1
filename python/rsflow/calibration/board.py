"""Calibration boards: the pattern, its corners in their order, and their size."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..errors import OptionError

__all__ = ["Board", "Pattern"]

Pattern: TypeAlias = Literal["chessboard", "charuco"]


@dataclass(frozen=True, slots=True)
class Board:
    """A calibration board.

    Attributes
    ----------
    size : (int, int)
        Columns and rows: of inner corners for a chessboard, of squares for a ChArUco board, as OpenCV counts them.
    square_size_m : float
        Side of a square, in metres.
    pattern : {"chessboard", "charuco"}
        What is printed.
    marker_size_m : float or None
        Side of a ChArUco marker, in metres.
    dictionary : str
        Name of the ArUco dictionary ("DICT_4X4_50").
    legacy_pattern : bool
        True for a ChArUco board made by OpenCV before 4.6 with an even number of rows.

    Examples
    --------
    >>> from rsflow.calibration import Board
    >>> board = Board((9, 6), 0.025)
    >>> board.corners, board.points()[1].tolist()
    (54, [0.02500000037252903, 0.0, 0.0])
    """

    size: tuple[int, int]
    square_size_m: float
    pattern: Pattern = "chessboard"
    marker_size_m: float | None = None
    dictionary: str = "DICT_4X4_50"
    legacy_pattern: bool = False

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        _checks.choice("pattern", self.pattern, get_args(Pattern))
        least = 3 if self.pattern == "chessboard" else 2
        expected = f"(columns, rows), integers from {least} to 200"
        put("size", _checks.integers("board", self.size, 2, expected, least=least, most=200))
        put("square_size_m", _checks.number("square_size_m", self.square_size_m, least=1e-9, most=1e9, of="metres"))
        put("marker_size_m", _checks.number_or_none("marker_size_m", self.marker_size_m, above=0, of="metres"))
        put("legacy_pattern", _checks.flag("legacy_pattern", self.legacy_pattern))
        _checks.text("dictionary", self.dictionary)
        if self.pattern == "charuco":
            if self.marker_size_m is None:
                put("marker_size_m", 0.75 * self.square_size_m)
            elif not self.marker_size_m < self.square_size_m:
                raise OptionError(
                    f"marker_size_m: got {self.marker_size_m!r}, expected less than the square's {self.square_size_m} m"
                )
            import cv2

            if not self.dictionary.startswith("DICT_") or not hasattr(cv2.aruco, self.dictionary):
                raise _checks.refused("dictionary", self.dictionary, "one of cv2.aruco, DICT_4X4_50 say")

    @property
    def corners(self) -> int:
        """Number of inner corners."""
        cols, rows = self.size
        return cols * rows if self.pattern == "chessboard" else (cols - 1) * (rows - 1)

    def points(self) -> NDArray[np.float32]:
        """Give the corners on the board, (corners, 3) float32, in metres, row by row."""
        cols, rows = self.size if self.pattern == "chessboard" else (self.size[0] - 1, self.size[1] - 1)
        points = np.zeros((cols * rows, 3), np.float32)
        points[:, :2] = np.mgrid[0:cols, 0:rows].T.reshape(-1, 2)
        return points * np.float32(self.square_size_m)

    def smaller(self) -> Board:
        """Give the chessboard with one column and one row less."""
        return dataclasses.replace(self, size=(self.size[0] - 1, self.size[1] - 1))
