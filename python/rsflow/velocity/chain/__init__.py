"""The steps from two frames to a velocity: told rotation, motion over the plane, doubts, covariance by cause."""

from __future__ import annotations

from .rotation import GyroState
from .steps import Chain, Settings, Told

__all__ = ["Chain", "GyroState", "Settings", "Told"]
