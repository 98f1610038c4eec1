"""What is wrong alike in every frame, a height or a focal length, or for a while. It does not average out.

docs/explanation/algorithms.md, section "Velocities filtered over time: VelocityFilter".
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .kalman import STATES
from .result import Velocity

__all__ = ["CommonCauses"]

F64 = NDArray[np.float64]

# How much of the mean covariance of a cause is left after one more frame: some 30 frames count.
_KEPT = 0.97


class CommonCauses:
    """Causes of unit variance that follow the state, and what each does to a velocity, learned from its parts.

    A height that is wrong scales the velocity. A focal length scales each axis by itself. Of any other cause nothing is
    known but its covariance: it adds a velocity that stays. All of it is told as a share of the velocity, or as what it
    is on average, and never follows the noise of a single measurement, which would pass for knowledge of the cause.

    Parameters
    ----------
    memory_s : mapping of str to float
        Parts of velocities' covariances, and how long the error of each lasts: infinite, or a time constant.
    """

    def __init__(self, memory_s: Mapping[str, float]) -> None:
        self.places: dict[str, slice] = {}
        lasting: list[float] = []
        for name, memory in memory_s.items():
            count = 1 if name == "height" and math.isinf(memory) else 3
            at = STATES + len(lasting)
            self.places[name] = slice(at, at + count)
            lasting += [memory] * count
        self.memory_s = np.array(lasting, dtype=np.float64)
        self.size = STATES + len(lasting)
        # Of each name the sums of its parts, of the squares of the velocities, and how many there were.
        self._sums: dict[str, tuple[F64, F64, float]] = {}

    def forget(self) -> None:
        """Begin anew."""
        self._sums = {}

    def effects(self, velocity: Velocity) -> tuple[F64, F64]:
        """Give what the causes do to a velocity v: the first of two (3, size) times v, row by row, plus the second."""
        share, offset = np.zeros((3, self.size)), np.zeros((3, self.size))
        v = np.nan_to_num(np.array([velocity.vx_m_s, velocity.vy_m_s, velocity.vz_m_s]))
        for name, place in self.places.items():
            part = velocity.parts.get(name)
            if part is None:
                continue
            part = np.where(np.isfinite(part), part, 0.0)
            lasts = math.isinf(self.memory_s[place.start - STATES])
            if name == "height" and lasts:
                square = float(v @ v)
                share[:, place] = np.sqrt(max(float(v @ part @ v), 0.0)) / square if square > 0.0 else 0.0
                continue
            parts, squares, count = self._sums.get(name, (np.zeros((3, 3)), np.zeros(3), 0.0))
            parts, squares, count = _KEPT * parts + part, _KEPT * squares + v * v, _KEPT * count + 1.0
            self._sums[name] = parts, squares, count
            if name == "focal length" and lasts:
                ratio = np.divide(np.diag(parts), squares, out=np.zeros(3), where=squares > 0.0)
                share[:, place] = np.diag(np.sqrt(np.maximum(ratio, 0.0)))
            else:
                values, vectors = np.linalg.eigh(parts / count)
                offset[:, place] = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        return share, offset

    def own_noise(self, velocity: Velocity) -> F64:
        """Give what of a velocity's covariance is another in every frame."""
        noise = np.array(velocity.covariance, dtype=np.float64)
        finite = np.isfinite(noise)
        for name in self.places:
            part = velocity.parts.get(name)
            if part is not None:
                noise[finite] -= np.where(np.isfinite(part), part, 0.0)[finite]
        known = np.ix_(*[np.isfinite(np.diag(noise))] * 2)
        values, vectors = np.linalg.eigh(noise[known])
        # Rounding must not make a variance negative.
        least = 1e-9 * float(np.trace(np.asarray(velocity.covariance)[known])) + 1e-18
        noise[known] = (vectors * np.maximum(values, least)) @ vectors.T
        return noise
