"""A measuring grid: displacement, strain and vorticity of windows on a regular grid, with their covariance."""

from __future__ import annotations

from .measure import displacement_grid
from .result import Grid, GridStatus, Replaced
from .strain import Strain

__all__ = ["Grid", "GridStatus", "Replaced", "Strain", "displacement_grid"]
