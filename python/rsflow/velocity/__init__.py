"""How fast a camera travels over flat ground: from pixels to metres per second, with what it is worth."""

from __future__ import annotations

from .attitudes import Attitudes
from .estimator import VelocityEstimator
from .filter import VelocityFilter
from .filter_result import FilteredVelocity, FilterStatus
from .heights import Heights
from .mounting import mounting
from .plot import plot_velocity
from .rates import Rates
from .result import Velocity, VelocityStatus
from .sensors import Sensors
from .table import COLUMNS, velocity_row, write_velocity_csv, write_velocity_parquet

__all__ = [
    "COLUMNS",
    "Attitudes",
    "FilterStatus",
    "FilteredVelocity",
    "Heights",
    "Rates",
    "Sensors",
    "Velocity",
    "VelocityEstimator",
    "VelocityFilter",
    "VelocityStatus",
    "mounting",
    "plot_velocity",
    "velocity_row",
    "write_velocity_csv",
    "write_velocity_parquet",
]
