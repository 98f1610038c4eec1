"""A calibration board to be printed, drawn by matplotlib in physical sizes."""

from __future__ import annotations

import os
from typing import Any, get_args

from .. import _checks
from .._extras import require
from ..io.atomic import writing
from .board import Board, Pattern
from .sheet import Page, Sheet

__all__ = ["print_board"]

_MM_PER_INCH, _POINTS_PER_INCH = 25.4, 72.0
# Of a PNG. Edges lie between its dots too, by their grey.
_DPI = 300
# Smaller squares are not printed sharply, nor seen by a camera.
_LEAST_SQUARE_M = 5e-4
# Height of the letters' em and the step from line to line, in millimetres.
_LETTERS_MM, _LINE_MM = 2.3, 2.85
# Of the first line, and of the ruler's numbers, from the inner edge of the strip.
_FIRST_MM, _NUMBERS_MM = 0.3, 11.7
# Ticks of the ruler, in millimetres: each, and of those at multiples of ten.
_TICK_MM, _LONG_TICK_MM = 1.2, 2.4


def print_board(
    path: str | os.PathLike[str],
    *,
    board: tuple[int, int] = (9, 6),
    square_size_m: float = 0.025,
    page: Page = "A4",
    pattern: Pattern = "chessboard",
    marker_size_m: float | None = None,
    dictionary: str = "DICT_4X4_50",
    legacy_pattern: bool = False,
) -> tuple[str, ...]:
    """Draw a calibration board in its exact size on a page, to be printed.

    Beside the board stand a ruler, by which the scale of the print is checked, and what to measure and which options
    `calibrate` takes then. Around the board the page is white, as the search for its corners wants it.

    Parameters
    ----------
    path : path
        PDF, SVG or PNG (of 300 dots an inch, which the file says), by its suffix.
    board : (int, int)
        Columns and rows, as for `calibrate`: of inner corners for a chessboard, of squares for a ChArUco board.
    square_size_m : float
        Side of a square in metres.
    page : {"A4", "A3", "Letter"}
        Size of the paper; it is turned as the board fits best.
    pattern : {"chessboard", "charuco"}
        What is printed.
    marker_size_m, dictionary, legacy_pattern
        ChArUco: as for `calibrate`.

    Returns
    -------
    tuple of str
        What to do with the print, line by line, as it stands on the page.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    OptionError
        If the board does not fit the page (the message says which squares would), the dictionary has too few markers,
        or an option is outside of what it allows.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from rsflow.calibration import print_board
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     lines = print_board(pathlib.Path(folder, "board.pdf"), board=(9, 6), square_size_m=0.025)
    >>> lines[2]
    'rsflow calibrate PICTURES --board 9x6 --square 0.025 -o camera.yaml'
    >>> print_board("board.pdf", board=(9, 6), square_size_m=0.03)
    Traceback (most recent call last):
    rsflow.errors.OptionError: square_size_m: got 0.03, expected at most 0.0255 for 10 x 7 squares on A4; page="A3" ...
    """
    path = _checks.file_name("path", path, (".pdf", ".svg", ".png"))
    page = _checks.choice("page", page, get_args(Page))
    least = _LEAST_SQUARE_M
    square_size_m = _checks.number("square_size_m", square_size_m, least=least, most=1e9, of="metres")
    printed = Board(board, square_size_m, pattern, marker_size_m, dictionary, legacy_pattern)
    sheet = Sheet.of(printed, page)
    style = require("matplotlib.style", extra="plot", purpose="drawing a board")
    # Whatever the user's settings are: a cropped or a scaled page would be a wrong board. Edges are not moved to
    # pixels, letters in SVG are outlines, and the same board gives the same file.
    ours = {"path.snap": False, "path.simplify": False, "pdf.fonttype": 42, "svg.hashsalt": "rsflow"}
    with style.context(["default", ours]):
        figure = _drawn(sheet)
        kind = path.suffix.lower().removeprefix(".")
        title = f"calibration board, {sheet.instructions[0]}"
        dated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {}}[kind]
        with writing(path) as partial:
            figure.savefig(partial, format=kind, dpi=_DPI, metadata={"Title": title, **dated})
    return sheet.instructions


def _drawn(sheet: Sheet) -> Any:
    """Draw the page as a figure of its size, whose axes are in millimetres from the upper left corner."""
    figure_module = require("matplotlib.figure", extra="plot", purpose="drawing a board")
    figure = figure_module.Figure(figsize=(sheet.width_mm / _MM_PER_INCH, sheet.height_mm / _MM_PER_INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, sheet.width_mm), ylim=(sheet.height_mm, 0.0))
    axes.axis("off")
    _fill(axes, sheet.ink_mm.tolist())
    _ruler(axes, sheet)
    for number, line in enumerate(sheet.instructions):
        _write(axes, sheet, _FIRST_MM + _LINE_MM * number, 0.0, line)
    return figure


def _fill(axes: Any, rectangles: list[list[float]]) -> None:
    """Fill rectangles in black as one shape: where two meet, no line of paper is left between them."""
    patches = require("matplotlib.patches", extra="plot", purpose="drawing a board")
    paths = require("matplotlib.path", extra="plot", purpose="drawing a board")
    vertices, codes = [], []
    for x, y, width, height in rectangles:
        vertices += [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]
        codes += [paths.Path.MOVETO, *[paths.Path.LINETO] * 3, paths.Path.CLOSEPOLY]
    axes.add_patch(patches.PathPatch(paths.Path(vertices, codes), facecolor="black", edgecolor="none", linewidth=0))


def _ruler(axes: Any, sheet: Sheet) -> None:
    """Draw the ruler at the outer edge of the strip, ticks towards the board."""
    left, top, width, height = sheet.strip_mm
    thin = 0.15
    bars = []
    for mm in range(round(sheet.ruler_mm) + 1):
        tick = _LONG_TICK_MM if mm % 10 == 0 else _TICK_MM
        # Along the ruler from its beginning, and across from the edge of the strip.
        if sheet.beside:
            bars.append([left + width - tick, top + height - mm - thin / 2, tick, thin])
        else:
            bars.append([left + mm - thin / 2, top + height - tick, thin, tick])
        if mm % 50 == 0:
            unit = " mm" if mm == round(sheet.ruler_mm) else ""
            _write(axes, sheet, _NUMBERS_MM, mm + 0.8, f"{mm}{unit}")
    _fill(axes, bars)


def _write(axes: Any, sheet: Sheet, down: float, along: float, text: str) -> None:
    """Write a line into the strip, `down` from its inner edge and `along` its length, in millimetres."""
    left, top, _, height = sheet.strip_mm
    size = _LETTERS_MM / _MM_PER_INCH * _POINTS_PER_INCH
    if sheet.beside:
        place, turn, anchor = (left + down, top + height - along), 90.0, {"ha": "left", "va": "bottom"}
    else:
        place, turn, anchor = (left + along, top + down), 0.0, {"ha": "left", "va": "top"}
    axes.text(*place, text, fontsize=size, rotation=turn, color="0.2", **anchor)
