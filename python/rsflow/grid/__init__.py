"""A measuring grid: displacement, strain and vorticity of windows on a regular grid, with their covariance."""

from __future__ import annotations

from .data import GridStatus
from .filling import Replaced
from .measure import displacement_grid
from .probes import GridProbes
from .result import Grid
from .sampling import Extension, Samples
from .sequence import GridSequence
from .statistics import GridStatistics
from .strain import Strain

__all__ = [
    "Extension",
    "Grid",
    "GridProbes",
    "GridSequence",
    "GridStatistics",
    "GridStatus",
    "Replaced",
    "Samples",
    "Strain",
    "displacement_grid",
]
