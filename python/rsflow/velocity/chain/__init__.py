"""The steps from two frames to a velocity: told rotation, motion over the plane, doubts, covariance by cause."""

from __future__ import annotations

from .rotation import GyroState
from .settings import Settings, Told
from .steps import Chain

__all__ = ["Chain", "GyroState", "Settings", "Told"]
