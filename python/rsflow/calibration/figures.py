"""The figures of a calibration, and what follows from them alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..camera.model import Camera
from .board import Board
from .views import View

__all__ = ["Figures", "add_coverage"]


@dataclass(frozen=True, slots=True, eq=False)
class Figures:
    """What `calibrate` measured; `rsflow.Calibration` says what each is."""

    camera: Camera
    rms: float
    views: tuple[View, ...]
    board: Board
    std_views: dict[str, float]
    std_repair: dict[str, float]
    std_model: dict[str, float]
    covariance: NDArray[np.float64]
    tilt_span_rad: float
    board_bend_m: float
    doubts: tuple[str, ...] = ()

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each parameter: the corners' errors, repairs and a doubtful model together."""
        return dict(self.camera.std)

    @property
    def used(self) -> tuple[View, ...]:
        """The views that the calibration uses."""
        return tuple(view for view in self.views if view.used)

    @property
    def rejected(self) -> dict[str, str]:
        """Names of the other pictures, and why they are not used."""
        return {view.name: view.reason for view in self.views if not view.used}

    @property
    def per_view_errors(self) -> NDArray[np.float64]:
        """Root mean square error of each used view, in pixels."""
        return np.array([view.rms for view in self.used])

    @property
    def focal_deviation(self) -> float:
        """Relative standard deviation of the focal length, the larger of both axes.

        A velocity over ground is height times flow over f: it has at least this relative deviation.
        """
        std = self.camera.std
        return max(std.get("fx", math.nan) / self.camera.fx, std.get("fy", math.nan) / self.camera.fy)

    def coverage(self, columns: int = 8, rows: int = 6) -> NDArray[np.int64]:
        """Count the corners of all used views in each cell of a grid over the picture, (rows, columns) int64.

        Parameters
        ----------
        columns, rows : int
            Of the grid.
        """
        columns = _checks.integer("columns", columns, least=1, most=10_000)
        rows = _checks.integer("rows", rows, least=1, most=10_000)
        counts = np.zeros((rows, columns), np.int64)
        for view in self.used:
            add_coverage(counts, view.corners, self.camera.size)
        return counts

    @property
    def covered(self) -> float:
        """Share of the cells of an 8 x 6 grid over the picture that hold at least one corner."""
        return float(np.mean(self.coverage() > 0))


def add_coverage(counts: NDArray[np.int64], corners: NDArray[np.float32], size: tuple[int, int]) -> None:
    """Add the corners of one view to the counts of the cells."""
    rows, columns = counts.shape
    x = np.clip(((corners[:, 0] + 0.5) * columns / size[0]).astype(int), 0, columns - 1)
    y = np.clip(((corners[:, 1] + 0.5) * rows / size[1]).astype(int), 0, rows - 1)
    np.add.at(counts, (y, x), 1)
