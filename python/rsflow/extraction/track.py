"""The path of the camera over the ground, from its velocities."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..velocity import Velocity

__all__ = ["Track"]


class Track:
    """Integrate velocities to a path over level ground, in the camera's axes at the first frame.

    The heading is integrated from the turn about straight down where the velocity came with one. Across a gap the way
    is unknown: a new segment is set on at the last place. The displacement's errors are independent from frame to
    frame and add as variances; those of height, focal length and principal point stay the same and add as they are.
    """

    def __init__(self) -> None:
        self._at = np.zeros(3)
        self._heading = 0.0
        self._distance = 0.0
        self._segment = 1
        self._gap = False
        self._independent = np.zeros(3)
        self._lasting: dict[str, Any] = {}

    def add(self, velocity: Velocity, frame: int) -> dict[str, Any]:
        """Give the row of ``track.csv`` at a velocity; its position is NaN where there is none."""
        row: dict[str, Any] = {"frame": frame, "t_s": velocity.t_s}
        if velocity.valid:
            self._step(velocity)
        elif velocity.status.name != "FIRST_FRAME":
            self._gap = True
            nothing = dict.fromkeys(("x_m", "y_m", "z_m", "heading_rad", "x_std_m", "y_std_m"), math.nan)
            return row | nothing | {"segment": self._segment, "distance_m": self._distance}
        std = np.sqrt(self._independent + sum(part**2 for part in self._lasting.values()))
        x, y, z = self._at
        return row | {
            "segment": self._segment,
            "x_m": float(x),
            "y_m": float(y),
            "z_m": float(z),
            "heading_rad": self._heading,
            "x_std_m": float(std[0]),
            "y_std_m": float(std[1]),
            "distance_m": self._distance,
        }

    def _step(self, velocity: Velocity) -> None:
        if self._gap:
            self._segment += 1
            self._gap = False
        dt = velocity.dt_s
        turn = velocity.yaw_rate_rad_s * dt if math.isfinite(velocity.yaw_rate_rad_s) else 0.0
        # The velocity is in the axes half-way through the interval.
        middle = self._heading + turn / 2
        cos, sin = math.cos(middle), math.sin(middle)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        v = np.array([velocity.vx_m_s, velocity.vy_m_s, velocity.vz_m_s])
        self._at = self._at + rotation @ v * dt
        self._heading += turn
        self._distance += float(np.hypot(v[0], v[1])) * dt
        for name, part in velocity.parts.items():
            spread = np.where(np.isfinite(part), part, 0.0)
            if name == "displacement":
                self._independent = self._independent + np.diag(rotation @ spread @ rotation.T) * dt**2
            else:
                # One cause that stays: the error of each frame has the sign of what it scales.
                error = rotation @ (np.sign(v) * np.sqrt(np.maximum(np.diag(spread), 0.0))) * dt
                self._lasting[name] = self._lasting.get(name, np.zeros(3)) + error
