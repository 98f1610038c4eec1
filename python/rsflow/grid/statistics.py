"""Means of many grids over the same nodes: the mean flow, and how it fluctuates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._shared import Shared, alone
from ..errors import ShapeError
from .result import Grid

__all__ = ["GridStatistics"]

F64 = NDArray[np.float64]


class GridStatistics(Shared):
    """Mean displacement of each node over many grids and its fluctuations, in memory that does not grow with them.

    A node counts where it was measured.

    Examples
    --------
    >>> import rsflow
    >>> found = rsflow.grid.GridStatistics()
    >>> for seed in range(3):
    ...     scene = rsflow.synthetic.particle_pair(lambda x, y: (2.0 + 0.1 * seed, 0.0), size=(64, 64), seed=seed)
    ...     found.add(rsflow.displacement_grid(scene.prev, scene.next))
    >>> bool(abs(found.mean - (2.1, 0.0)).max() < 0.02), int(found.count.min())
    (True, 3)
    """

    def __init__(self) -> None:
        self._nodes: tuple[F64, F64] | None = None
        self._count = np.zeros((0, 0))
        self._mean = np.zeros((0, 0, 2))
        self._squares = np.zeros((0, 0, 2, 2))
        self._noise = np.zeros((0, 0, 2, 2))

    def __repr__(self) -> str:
        rows, columns = self._count.shape
        most = int(self._count.max()) if self._count.size else 0
        return f"GridStatistics({columns} x {rows} nodes, up to {most} grids)"

    @alone
    def add(self, grid: Grid) -> None:
        """Take in a grid.

        Parameters
        ----------
        grid : Grid
            Of the same nodes as those before it.
        """
        _checks.instance("grid", grid, Grid, "a Grid")
        nodes = grid.x.astype(np.float64), grid.y.astype(np.float64)
        if self._nodes is None:
            self._nodes = nodes
            shape = grid.status.shape
            self._count, self._mean = np.zeros(shape), np.zeros((*shape, 2))
            self._squares, self._noise = np.zeros((*shape, 2, 2)), np.zeros((*shape, 2, 2))
        elif not all(np.array_equal(a, b) for a, b in zip(self._nodes, nodes, strict=True)):
            raise ShapeError(f"grid: got {grid.status.shape} nodes, expected those of the grids before it")
        valid = grid.valid
        self._count += valid
        value = np.where(valid[..., None], grid.raw.astype(np.float64), self._mean)
        before = value - self._mean
        self._mean = self._mean + before / np.maximum(self._count, 1.0)[..., None]
        after = value - self._mean
        self._squares += before[..., :, None] * after[..., None, :]
        self._noise += np.where(valid[..., None, None], grid.covariance.astype(np.float64), 0.0)

    @property
    def count(self) -> NDArray[np.int64]:
        """In how many grids each node was measured, shape (ny, nx)."""
        return self._count.astype(np.int64)

    @property
    def mean(self) -> F64:
        """Mean displacement (u, v) in pixels, shape (ny, nx, 2); NaN where a node was never measured."""
        return np.where(self._count[..., None] > 0, self._mean, np.nan)

    @property
    def fluctuation(self) -> F64:
        """Covariance of u and v over the grids, shape (ny, nx, 2, 2), with what noise adds; NaN below two grids."""
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self._squares / (self._count - 1.0)[..., None, None]
        return np.where(self._count[..., None, None] > 1, found, np.nan)

    @property
    def noise(self) -> F64:
        """Mean covariance of a measurement, shape (ny, nx, 2, 2): what noise adds to `fluctuation`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._noise / np.where(self._count > 0, self._count, np.nan)[..., None, None]
