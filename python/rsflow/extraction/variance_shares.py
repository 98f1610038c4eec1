"""Where the uncertainty of the velocities of a whole source comes from: the share of each cause in their variance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..velocity import Velocity

__all__ = ["VarianceShares"]


class VarianceShares:
    """Sums, over frames, the variance of the speed over ground that each cause gives.

    It is that along the velocity; of a velocity of zero, the mean over all directions.
    """

    def __init__(self) -> None:
        self.variance: dict[str, float] = {}

    def add(self, velocity: Velocity) -> None:
        """Take a frame; one without a velocity has none."""
        if not velocity.valid:
            return
        v = np.array([velocity.vx_m_s, velocity.vy_m_s])
        speed = math.hypot(*v)
        for name, part in velocity.parts.items():
            flat = np.where(np.isfinite(part), part, 0.0)[:2, :2]
            along = float(v @ flat @ v) / speed**2 if speed > 0 else float(np.trace(flat)) / 2
            self.variance[name] = self.variance.get(name, 0.0) + along

    def shares(self) -> dict[str, float]:
        """Give the share of each cause in the variance of all, the largest first; empty where there is none."""
        total = sum(self.variance.values())
        if not (total > 0 and math.isfinite(total)):
            return {}
        return dict(sorted(((name, value / total) for name, value in self.variance.items()), key=lambda item: -item[1]))
