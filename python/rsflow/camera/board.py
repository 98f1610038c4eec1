"""Boards and their corners; `rsflow.calibration` holds the code."""

from __future__ import annotations

from ..calibration import Board, Corners, Pattern, find_corners

__all__ = ["Board", "Corners", "Pattern", "find_corners"]
