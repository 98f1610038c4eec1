"""A camera from pictures of a chessboard or ChArUco board."""

from __future__ import annotations

from .board import Board, Corners, Pattern, find_corners
from .estimate import Calibration, calibrate
from .views import View

__all__ = ["Board", "Calibration", "Corners", "Pattern", "View", "calibrate", "find_corners"]
