"""A camera from pictures of a chessboard or ChArUco board."""

from __future__ import annotations

from .board import Board, Pattern
from .board_height import BoardHeight, height_over_board
from .detect import Corners, find_corners
from .estimate import calibrate
from .printing import print_board
from .result import Calibration
from .views import View

__all__ = [
    "Board",
    "BoardHeight",
    "Calibration",
    "Corners",
    "Pattern",
    "View",
    "calibrate",
    "find_corners",
    "height_over_board",
    "print_board",
]
