"""The calibration of a camera; `rsflow.calibration` holds the code."""

from __future__ import annotations

from ..calibration import Calibration, View, calibrate

__all__ = ["Calibration", "View", "calibrate"]
