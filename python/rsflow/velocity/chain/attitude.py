"""Straight down in the camera's axes: as told, or carried along by the camera's rotation and seen in the pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._rotation import rotation_matrix

F64 = NDArray[np.float64]

# Level ground where nobody tells: a camera is mounted, and ground is level, to about a degree, in radians.
_LEVEL_RAD = 0.02
# How fast straight down walks from where it is carried, in radians per root of a second.
_WALK_RAD = 1e-3
# It is never known better than this: the pictures' own errors are not those of chance alone.
_LEAST_RAD = 7e-4


class Attitude:
    """Straight down, and its covariance about the camera's x and y axes.

    Parameters
    ----------
    std_rad : float or None
        Of a direction that is told, or of level ground; None: what is told is exact.
    """

    def __init__(self, std_rad: float | None) -> None:
        self._std = std_rad
        level = _LEVEL_RAD if std_rad is None else std_rad
        self.down = np.array([0.0, 0.0, 1.0])
        self.covariance = level**2 * np.eye(2)
        # Where it begins: level ground, or as it was told last.
        self._begin = self.down, self.covariance
        # As it was told last, if that was at the frame before.
        self.told: F64 | None = None

    def tell(self, down: F64 | None) -> tuple[F64 | None, F64 | None]:
        """Take straight down (3,) at a frame, None where nobody tells; give what was told before and now."""
        before, self.told = self.told, down
        if down is not None:
            self.down = down
            self.covariance = (self._std or 0.0) ** 2 * np.eye(2)
            self._begin = down, (self._std or _LEVEL_RAD) ** 2 * np.eye(2)
        return before, down

    def carry(self, turn: F64, covariance: F64, dt_s: float) -> tuple[F64, F64]:
        """Give straight down, and its covariance, after the camera turned by `turn` (3,), in radians."""
        if self.told is not None:
            return self.down, self.covariance
        spread = self.covariance + covariance[:2, :2] + (_WALK_RAD**2 * dt_s + _LEAST_RAD**2) * np.eye(2)
        return rotation_matrix(-turn) @ self.down, spread

    def correct(self, down: F64, by: F64, covariance: F64) -> None:
        """Take what the pictures say: straight down, turned by `by` (2,) about x and y."""
        self.down = rotation_matrix([by[0], by[1], 0.0]) @ down
        self.covariance = 0.5 * (covariance + covariance.T)

    def begin_anew(self) -> None:
        """Forget where the pictures carried it."""
        self.down, self.covariance = self._begin

    def state(self) -> dict[str, Any]:
        """Everything that is known, to be kept."""
        return {"down": self.down, "covariance": self.covariance, "told": self.told, "begin": self._begin}

    def restore(self, kept: dict[str, Any]) -> None:
        """Take over what `state` gave."""
        self.down, self.covariance, self.told = kept["down"], kept["covariance"], kept["told"]
        self._begin = kept["begin"]
