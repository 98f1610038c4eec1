"""How fast a camera travels over flat ground: from pixels to metres per second, with what it is worth."""

from __future__ import annotations

from .estimator import VelocityEstimator
from .result import Velocity, VelocityStatus
from .table import COLUMNS, Heights, plot_velocity, velocity_row, write_velocity_csv

__all__ = [
    "COLUMNS",
    "Heights",
    "Velocity",
    "VelocityEstimator",
    "VelocityStatus",
    "plot_velocity",
    "velocity_row",
    "write_velocity_csv",
]
