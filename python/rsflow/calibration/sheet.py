"""A calibration board on a page: where its squares, its ruler and its words lie, in millimetres."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError
from .board import Board
from .detect import charuco_board

__all__ = ["Page", "Sheet"]

Page: TypeAlias = Literal["A4", "A3", "Letter"]

# Shorter and longer side in millimetres: ISO 216, and ANSI A of 8.5 x 11 inches.
_PAGES: dict[Page, tuple[float, float]] = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "Letter": (215.9, 279.4)}

# What printers leave white along each edge, in millimetres: a quarter of an inch.
EDGE_MM = 6.35
# White around the board, in squares, so that its corners are found on a dark ground; never less than the page's edge.
_QUIET = 0.375
# Of the strip beside the board: words, then the ruler.
_STRIP_MM = 15.5
# The ruler is a multiple of this, and its last number stands behind it.
_RULER_STEP_MM, _RULER_END_MM = 50.0, 12.0

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A board on a page, with a strip for words and a ruler to its right or below.

    Lengths are millimetres from the upper left corner of the page; a (x, y, width, height) is a rectangle.

    Attributes
    ----------
    width_mm, height_mm : float
        Of the page, as it is turned.
    board_mm : (4,) tuple of float
        All squares of the board.
    strip_mm : (4,) tuple of float
        Room for the words and the ruler.
    beside : bool
        True where the strip is to the right of the board and read from below, False where it is below.
    ruler_mm : float
        Length of the ruler.
    ink_mm : (N, 4) float64
        What is black of the board.
    """

    board: Board
    page: Page
    width_mm: float
    height_mm: float
    board_mm: tuple[float, float, float, float]
    strip_mm: tuple[float, float, float, float]
    beside: bool
    ruler_mm: float
    ink_mm: F64

    @classmethod
    def of(cls, board: Board, page: Page) -> Sheet:
        """Lay a board out on a page, turned so that the largest squares would fit.

        Raises
        ------
        OptionError
            If its squares are too large for the page; the message says which would fit.
        """
        square = 1000.0 * board.square_size_m
        squares = _squares(board)
        largest, width, height, beside = _arrangement(squares, page)
        if square > largest:
            # Down to a tenth of a millimetre, so that what is said fits.
            fitting = math.floor(10.0 * largest + 1e-6) / 10.0
            others = [name for name in get_args(Page) if _arrangement(squares, name)[0] >= square]
            hint = f'; page="{others[0]}" takes it' if others else ""
            raise OptionError(
                f"square_size_m: got {board.square_size_m:g}, expected at most {fitting / 1000:g} for "
                f"{squares[0]} x {squares[1]} squares on {page}{hint}"
            )
        free_width = width - (_STRIP_MM + EDGE_MM if beside else 0.0)
        free_height = height - (0.0 if beside else _STRIP_MM + EDGE_MM)
        size = (squares[0] * square, squares[1] * square)
        at = ((free_width - size[0]) / 2.0, (free_height - size[1]) / 2.0)
        if beside:
            strip = (free_width, EDGE_MM, _STRIP_MM, height - 2 * EDGE_MM)
        else:
            strip = (EDGE_MM, free_height, width - 2 * EDGE_MM, _STRIP_MM)
        length = max(strip[2:])
        ruler = _RULER_STEP_MM * math.floor((length - _RULER_END_MM) / _RULER_STEP_MM)
        ink = _ink(board) * square + (*at, 0.0, 0.0)
        return cls(board, page, width, height, (*at, *size), strip, beside, ruler, ink)

    @property
    def instructions(self) -> tuple[str, ...]:
        """What to do with the page, in lines."""
        board = self.board
        columns, rows = _squares(board)
        square = 1000.0 * board.square_size_m
        kind = "ChArUco board" if board.pattern == "charuco" else "Chessboard"
        options = [f"--board {board.size[0]}x{board.size[1]}", f"--square {_metres(board.square_size_m)}"]
        others = f"--square W / {columns}"
        if board.pattern == "charuco":
            assert board.marker_size_m is not None
            options = ["--pattern charuco", *options, f"--marker {_metres(board.marker_size_m)}"]
            options += [] if board.dictionary == "DICT_4X4_50" else [f"--dictionary {board.dictionary}"]
            options += ["--legacy"] if board.legacy_pattern else []
            others += f" and --marker {board.marker_size_m / board.square_size_m:.6g} of that"
        return (
            f"{kind} of {columns} x {rows} squares of {square:g} mm. Print on {self.page} at 100 % (actual size), "
            "glue it to something flat.",
            f"Check the ruler: {self.ruler_mm:g} mm. Then measure over all squares: {columns} are W = "
            f"{columns * square:g} mm, {rows} are H = {rows * square:g} mm.",
            f"rsflow calibrate PICTURES {' '.join(options)} -o camera.yaml",
            f"Where your W differs, give {others}, in metres. W / {columns} and H / {rows} must agree to 0.2 %.",
        )


def _metres(length_m: float) -> str:
    return f"{length_m:.6f}".rstrip("0")


def _squares(board: Board) -> tuple[int, int]:
    """Columns and rows of squares."""
    columns, rows = board.size
    return (columns, rows) if board.pattern == "charuco" else (columns + 1, rows + 1)


def _arrangement(squares: tuple[int, int], page: Page) -> tuple[float, float, float, bool]:
    """Give the largest square of all arrangements in millimetres, the page's width and height, and if `beside`."""
    short, long = _PAGES[page]
    found = []
    for width, height in ((long, short), (short, long)):
        for beside in (True, False):
            strip = _STRIP_MM + EDGE_MM
            room = (width - strip, height) if beside else (width, height - strip)
            largest = min(_largest(count, length) for count, length in zip(squares, room, strict=True))
            found.append((largest, width, height, beside))
    return max(found, key=lambda one: one[0])


def _largest(count: int, room_mm: float) -> float:
    """Give the side of so many squares in a row that leaves white at both ends."""
    return min(room_mm / (count + 2 * _QUIET), (room_mm - 2 * EDGE_MM) / count)


def _ink(board: Board) -> F64:
    """Give what is black of a board, (N, 4): x, y, width, height in squares, from its upper left corner."""
    columns, rows = _squares(board)
    if board.pattern == "chessboard":
        return np.array([(x, y, 1.0, 1.0) for y in range(rows) for x in range(y % 2, columns, 2)])
    made = charuco_board(board)
    if len(np.asarray(made.getIds())) > len(made.getDictionary().bytesList):
        raise OptionError(
            f"dictionary: got {board.dictionary} of {len(made.getDictionary().bytesList)} markers, expected one of at "
            f"least {len(np.asarray(made.getIds()))}, as a board of {columns} x {rows} squares has"
        )
    cells: list[tuple[float, float, float, float]] = []
    light = set()
    for number, corners in zip(np.asarray(made.getIds()).ravel(), made.getObjPoints(), strict=True):
        places = np.asarray(corners, np.float64)[:, :2] / board.square_size_m
        light.add(tuple(np.floor(places.mean(axis=0)).astype(int).tolist()))
        cells += _marker(made.getDictionary(), int(number), places)
    dark = [(x, y) for y in range(rows) for x in range(columns) if (x, y) not in light]
    return np.array([(float(x), float(y), 1.0, 1.0) for x, y in dark] + cells)


def _marker(dictionary: Any, number: int, corners: F64) -> list[tuple[float, float, float, float]]:
    """Give what is black of an ArUco marker, row by row, in the unit of its corners."""
    import cv2

    # A bit is a cell, with one cell of border.
    side = int(dictionary.markerSize) + 2
    dark = np.asarray(cv2.aruco.generateImageMarker(dictionary, number, side, borderBits=1)) == 0
    (left, top), cell = corners.min(axis=0), float(np.ptp(corners[:, 0])) / side
    cells = []
    for y, row in enumerate(dark):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(int), [0]])))
        for begin, end in edges.reshape(-1, 2).tolist():
            cells.append((left + begin * cell, top + y * cell, (end - begin) * cell, cell))
    return cells
