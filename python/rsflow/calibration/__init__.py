"""A camera from pictures of a chessboard or ChArUco board."""

from __future__ import annotations

from .board import Board, Pattern
from .detect import Corners, find_corners
from .estimate import calibrate
from .printing import print_board
from .result import Calibration
from .views import View

__all__ = ["Board", "Calibration", "Corners", "Pattern", "View", "calibrate", "find_corners", "print_board"]
