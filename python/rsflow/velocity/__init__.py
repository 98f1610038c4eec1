"""How fast a camera travels over flat ground: from pixels to metres per second, with what it is worth."""

from __future__ import annotations

from .attitudes import Attitudes
from .estimator import VelocityEstimator
from .filter import VelocityFilter
from .filter_result import FilteredVelocity, FilterStatus
from .heights import Heights
from .plot import plot_velocity
from .rates import Rates
from .result import Velocity, VelocityStatus
from .table import COLUMNS, velocity_row, write_velocity_csv

__all__ = [
    "COLUMNS",
    "Attitudes",
    "FilterStatus",
    "FilteredVelocity",
    "Heights",
    "Rates",
    "Velocity",
    "VelocityEstimator",
    "VelocityFilter",
    "VelocityStatus",
    "plot_velocity",
    "velocity_row",
    "write_velocity_csv",
]
