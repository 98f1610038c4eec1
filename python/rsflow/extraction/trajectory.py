"""The path of the camera over the ground, from its velocities.

docs/explanation/algorithms.md, section "The path, and how it drifts".
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .drift import Drift
from .gaps import UNSEEN

if TYPE_CHECKING:
    from ..velocity import Velocity

__all__ = ["Trajectory"]

# Changes of velocity that it takes to say how the velocity goes on over a gap.
_LEAST_CHANGES = 4
# A stretch without velocities is rarely as smooth as those with.
_ROUGHER = 2.0


_PLACE = ("x_m", "y_m", "z_m", "heading_rad", "distance_m")
_DEVIATIONS = ("x_std_m", "y_std_m", "z_std_m", "heading_std_rad", "distance_std_m")
_COVARIANCES = ("cov_xx_m2", "cov_xy_m2", "cov_xz_m2", "cov_yy_m2", "cov_yz_m2", "cov_zz_m2")


class Trajectory:
    """Integrate velocities to a path over level ground, in the body's axes at the first frame, made level.

    The body's axes are the camera's by default. Where straight down is known each velocity is turned into level axes,
    by the shortest way. The heading is integrated from the turn about straight down: of the rate that was used, else as
    it was fitted. Over a gap the
    velocity is carried on from the one before to the one after, and the path gets the variance of a velocity that walks
    at random as it does elsewhere and as the ends of the gap show, and no less than a motion asks for that may stop,
    turn round or go several times as fast: nothing constrains it in a gap. How the errors add up says `Drift`.
    """

    def __init__(self) -> None:
        self._at = np.zeros(3)
        self._heading = 0.0
        self._distance = self._measured = 0.0
        self._segment = 1
        self._drift = Drift()
        # The last velocity, in the path's axes, and when; the start of the path where there was none yet.
        self._last: tuple[float, Any] | None = None
        self._begin_s = math.nan
        self._end_s = math.nan
        self._waiting = self._missing = 0
        self._missing_s = 0.0
        self._changes = 0
        self._walk = 0.0
        # Of all gaps carried over: what their variance is to that of the walk, and what their own ends add.
        self._gap_share = self._gap_change = 0.0
        # And the least variance of their ways: what may go on unseen.
        self._gap_least = 0.0
        self._measured_s = 0.0

    def add(
        self, velocity: Velocity, frame: int, *, down: Any = None, gyro_std_rad_s: float | None = None
    ) -> dict[str, Any]:
        """Give the row of ``trajectory.csv`` at a velocity; its position is NaN where there is none.

        `down` (3,) is straight down in the body's axes half-way through the interval, of any length, where it is known.
        `gyro_std_rad_s` is the deviation of a gyro's rate, which lasts: infinite where there was none and the rate was
        solved for, None where there was one and nobody stated it.
        """
        row: dict[str, Any] = {"frame": frame, "t_s": velocity.t_s}
        first = velocity.status.name == "FIRST_FRAME"
        if first:
            self._begin_s = velocity.t_s
        self._end_s = velocity.t_s
        if velocity.valid:
            level = _level(down)
            self._step(velocity, level, *_turning(velocity, level, gyro_std_rad_s))
        elif not first:
            self._waiting += 1
            return row | dict.fromkeys((*_PLACE, *_DEVIATIONS, *_COVARIANCES), math.nan) | {"segment": self._segment}
        covariance = self._drift.covariance
        gaps = self._gap_variance(self._gap_share, self._gap_change, self._gap_least)
        # Of a variance that is infinite the covariances are not known; they stay what they are without the gap.
        covariance[np.arange(3), np.arange(3)] += gaps
        x, y, z = (float(value) for value in self._at)
        if math.isnan(z):
            covariance[2, :] = covariance[:, 2] = 0.0
            covariance[2, 2] = math.inf
        std = np.sqrt(np.diag(covariance)).tolist()
        place = (x, y, z, self._heading, self._distance)
        deviations = (*std, self._drift.heading_std_rad, self._distance_std())
        spread = [float(covariance[i, k]) for i, k in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
        return row | {
            "segment": self._segment,
            **dict(zip(_PLACE, place, strict=True)),
            **dict(zip(_DEVIATIONS, deviations, strict=True)),
            **dict(zip(_COVARIANCES, spread, strict=True)),
        }

    def figures(self) -> dict[str, Any]:
        """Give the length of the way with its deviation, and what of it was not measured; NaN where it is not known."""
        distance, std, lost_s = self._distance, self._distance_std(), self._missing_s
        if self._waiting:
            # It ends in a gap.
            since = self._begin_s if self._last is None else self._last[0]
            time = self._end_s - since
            speed = math.nan if self._last is None else float(np.hypot(*self._last[1][:2]))
            distance += speed * time
            least = (UNSEEN * max(speed, self._mean_speed()) * time) ** 2
            std = math.hypot(std, math.sqrt(self._gap_variance(_share(time, open_end=True), 0.0, least)))
            lost_s += time
        known = math.isfinite(std) and math.isfinite(distance)
        return {
            "distance_m": distance if known else math.nan,
            "distance_std_m": std if known else math.inf,
            "distance_measured_m": self._measured,
            "distance_unmeasured": self._missing + self._waiting,
            "distance_unmeasured_s": lost_s,
        }

    def _distance_std(self) -> float:
        gaps = self._gap_variance(self._gap_share, self._gap_change, self._gap_least)
        return math.sqrt(self._drift.distance_variance + gaps)

    def _step(self, velocity: Velocity, level: Any, rate: float, lasting: float, independent: float) -> None:
        dt = velocity.dt_s
        turn = rate * dt
        self._drift.turn(lasting * dt, independent * dt)
        # The velocity is in the axes half-way through the interval.
        middle = self._heading + turn / 2
        cos, sin = math.cos(middle), math.sin(middle)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ level
        v = np.array([velocity.vx_m_s, velocity.vy_m_s, velocity.vz_m_s])
        known = np.nan_to_num(v)
        along = rotation @ known
        if np.isnan(v).any():
            along[2] = math.nan
        if self._waiting:
            self._carry(along, velocity.t_s - dt)
        elif self._last is not None:
            # Half a step of change on either side of the time between: a random walk with this variance a second.
            self._walk += float((np.nan_to_num(along - self._last[1])[:2] ** 2).sum()) / 2 / dt
            self._changes += 1
        self._last = (velocity.t_s, along)
        self._at = self._at + along * dt
        self._heading += turn
        speed = float(np.hypot(along[0], along[1]))
        self._distance += speed * dt
        self._measured += speed * dt
        self._measured_s += dt
        self._drift.add(velocity.parts, known, rotation, dt)

    def _carry(self, after: Any, until_s: float) -> None:
        """Go on over a gap that ends with the velocity `after`."""
        open_end = self._last is None
        since, before = (self._begin_s, after) if self._last is None else self._last
        time = until_s - since
        # Frames out of order leave no time to go anywhere in.
        time = time if time > 0 else 0.0
        middle = 0.5 * (before + after)
        if time > 0:
            share = _share(time, open_end=open_end)
            self._gap_share += share
            self._gap_change += share * float(((after - before)[:2] ** 2).sum()) / 2 / time
            fastest = max(float(np.hypot(*before[:2])), float(np.hypot(*after[:2])), self._mean_speed())
            self._gap_least += (UNSEEN * fastest * time) ** 2
        self._at = self._at + middle * time
        self._distance += float(np.hypot(*middle[:2])) * time
        self._segment += 1
        self._missing += self._waiting
        self._missing_s += time
        self._waiting = 0

    def _mean_speed(self) -> float:
        return self._measured / self._measured_s if self._measured_s > 0 else 0.0

    def _gap_variance(self, share: float, change: float, least: float) -> float:
        """Variance of the way along one axis over gaps; infinite where too few velocities tell how they change."""
        if share <= 0:
            return 0.0
        if self._changes < _LEAST_CHANGES:
            return math.inf
        return max(_ROUGHER**2 * (share * self._walk / self._changes + change), least)


def _share(time: float, *, open_end: bool) -> float:
    """Variance of the way over a gap, to that of the walk a second: the walk is held at both ends, or at one."""
    return time**3 / (3.0 if open_end else 12.0)


def _level(down: Any) -> Any:
    """Give the rotation (3, 3) that takes straight down to the third axis by the shortest way; identity without it."""
    if down is None or not np.isfinite(down).all():
        return np.eye(3)
    x, y, z = np.asarray(down, dtype=np.float64) / np.linalg.norm(down)
    if z < -0.9999:
        # Axes with the third one up: over its first.
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + z)


def _turning(velocity: Velocity, level: Any, gyro_std_rad_s: float | None) -> tuple[float, float, float]:
    """Give the rate of the turn about straight down, and the deviations of its error: lasting, and of this frame alone.

    A rate that comes of a gyro's (deviation g, lasting) and of the pictures' (independent) has the deviation s: the
    gyro's part of its error is s^2 / g.
    """
    rate = float(level[2] @ velocity.rate_rad_s)
    if not math.isfinite(rate):
        return (velocity.yaw_rate_rad_s if math.isfinite(velocity.yaw_rate_rad_s) else 0.0), 0.0, 0.0
    variance = float(level[2] @ velocity.rate_covariance @ level[2])
    if not 0 <= variance < math.inf:
        return rate, 0.0, 0.0
    std = math.sqrt(variance)
    lasting = std if gyro_std_rad_s is None or gyro_std_rad_s <= std else variance / gyro_std_rad_s
    return rate, lasting, math.sqrt(max(variance - lasting**2, 0.0))
