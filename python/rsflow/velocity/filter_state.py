"""What a filter believes at one time: the state, its covariance, and how it goes on.

docs/explanation/algorithms.md, section "Velocities filtered over time: VelocityFilter".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import kalman
from .kalman import ACCELERATION, BIAS, DELAY, HEADING, POSITION, STATES, VELOCITY

__all__ = ["Belief", "Sight", "Turning"]

F64 = NDArray[np.float64]

# Of a component that was never measured, in m/s.
_UNKNOWN_SPEED = 100.0
# Random walk over a second of a heading whose change nobody measured, in rad.
_UNKNOWN_TURN = 0.5
# Random walk over a second of a gyro's bias, in rad/s: a cheap gyro's.
_BIAS_WALK = 1e-4


@dataclass(frozen=True)
class Turning:
    """How the heading goes on: its rate with a variance, for means over `dt_s`; infinite where it is not known.

    `gyro` (4,) is the derivative of the rate by gyro bias and delay, where a gyro measured it. Its error lasts for
    `lasts_s`: what is left of a bias is not another in the next frame.
    """

    rate_rad_s: float = 0.0
    variance: float = math.inf
    dt_s: float = 0.0
    gyro: F64 | None = None
    lasts_s: float = 0.0

    def over(self, dt_s: float) -> tuple[float, float, F64 | None]:
        """Give the turn over a time, its variance, and its derivative by gyro bias and delay."""
        if not math.isfinite(self.variance):
            return 0.0, _UNKNOWN_TURN**2 * dt_s, None
        # The error of a rate is that of its whole interval: a part of it has its share of the angle's variance.
        variance = self.variance * dt_s * max(dt_s, self.dt_s, self.lasts_s)
        return self.rate_rad_s * dt_s, variance, None if self.gyro is None else self.gyro * dt_s


@dataclass(frozen=True)
class Sight:
    """How a velocity was measured.

    Attributes
    ----------
    down : (3,) float64
        Straight down in the axes of the body.
    arm : (3, 3) float64
        What a gyro's error does to a velocity: reading too much by e it lets the ground seem to turn, and the body to
        move by e times the height.
    change : (3,) float64
        Change of the rate, in rad/s^2: a gyro that is late by a time reads too much by minus this.
    share, offset : (3, N) float64
        What is common to all frames does, see `CommonCauses.effects`.
    """

    down: F64
    arm: F64
    change: F64
    share: F64
    offset: F64


@dataclass(frozen=True)
class Belief:
    """State (N,) at a time, and its covariances (2, N, N) with what is common to all frames and without.

    `walk` is the power of the jerk, `memory_s` how long the common causes last, see `kalman.advance`.
    """

    mean: F64
    covariances: F64
    t_s: float
    walk: float
    memory_s: F64

    @classmethod
    def begin(cls, t_s: float, memory_s: F64, options: Mapping[str, float]) -> Belief:
        """Know nothing but the deviations that were stated, and of the causes after these how long they last."""
        size = STATES + len(memory_s)
        variances = np.zeros(size)
        variances[BIAS] = options["gyro_bias_std_rad_s"] ** 2
        variances[DELAY] = options["rate_delay_std_s"] ** 2
        covariances = np.stack([np.diag(variances)] * 2)
        covariances[0, STATES:, STATES:] = np.eye(len(memory_s))
        return cls(np.zeros(size), covariances, t_s, options["acceleration_walk_m_s2"] ** 2, memory_s)

    @property
    def covariance(self) -> F64:
        """The covariance, with what is common to all frames."""
        return np.asarray(self.covariances[0], dtype=np.float64)

    def at(self, t_s: float, turning: Turning) -> Belief:
        """Carry it on to a later time; an earlier one leaves it as it is."""
        dt = t_s - self.t_s
        if not dt > 0:
            return self
        turn, variance, gyro = turning.over(dt)
        mean, covariances = kalman.advance(
            self.mean,
            self.covariances,
            dt,
            walk=self.walk,
            turn_rad=turn,
            turn_variance=variance,
            gyro=gyro,
            memory_s=self.memory_s,
        )
        if covariances[0, BIAS, BIAS].any():
            covariances[:, BIAS, BIAS] += np.eye(3) * _BIAS_WALK**2 * dt
        return replace(self, mean=mean, covariances=covariances, t_s=t_s)

    def design(self, sight: Sight) -> tuple[F64, F64]:
        """Give the derivative of a measured velocity by the state, (3, N), and the velocity that is expected."""
        turn, change = kalman.heading_matrix(float(self.mean[HEADING]))
        level = kalman.level_from_body(sight.down)
        velocity = level.T @ turn.T @ self.mean[VELOCITY]
        design = sight.share * velocity[:, None] + sight.offset
        design[:, VELOCITY] = level.T @ turn.T
        design[:, HEADING] = level.T @ change.T @ self.mean[VELOCITY]
        design[:, BIAS] = sight.arm
        design[:, DELAY] = -sight.arm @ sight.change
        return design, velocity + design[:, 10:14] @ self.mean[10:14]

    def body_velocity(self, down: F64) -> tuple[F64, F64]:
        """Give the velocity in the axes of the body, and its covariance."""
        none = np.zeros((3, len(self.mean)))
        nothing = Sight(down, np.zeros((3, 3)), np.zeros(3), none, none)
        design, velocity = self.design(nothing)
        return velocity, design @ self.covariance @ design.T

    def updated(self, residual: F64, design: F64, noise: F64) -> Belief:
        """Take in a measurement; what is common to all frames stays as unsure as it is."""
        mean, covariances = kalman.consider_update(self.mean, self.covariances, residual, design, noise)
        return replace(self, mean=mean, covariances=covariances)

    def seeded(self, z: F64, noise: F64, sight: Sight, seen: NDArray[np.bool_], acceleration_std: float) -> Belief:
        """Let velocity and acceleration be those of one measurement alone, the rest as it is."""
        mean, covariances = self.mean.copy(), self.covariances.copy()
        covariances[:, 3:9, :] = covariances[:, :, 3:9] = 0.0
        mean[3:9] = 0.0
        design, others = replace(self, mean=mean).design(sight)
        inverse = design[:, VELOCITY].T
        mean[VELOCITY] = inverse @ np.where(seen, np.where(seen, z, 0.0) - others, 0.0)
        # The velocity is inverse (z - others - noise): with the other states it has their errors in common.
        design, _ = replace(self, mean=mean).design(sight)
        design[:, VELOCITY] = 0.0
        design[~seen] = 0.0
        link = -inverse @ design
        filled = np.where(np.outer(seen, seen), noise, 0.0) + np.diag(np.where(seen, 0.0, _UNKNOWN_SPEED**2))
        shared = link @ covariances
        own = link @ covariances @ link.T + inverse @ filled @ inverse.T
        covariances[:, VELOCITY, :], covariances[:, :, VELOCITY] = shared, shared.transpose(0, 2, 1)
        covariances[:, VELOCITY, VELOCITY] = own
        covariances[:, ACCELERATION, ACCELERATION] = np.eye(3) * acceleration_std**2
        return replace(self, mean=mean, covariances=covariances)

    def from_origin(self, time_s: float) -> Belief:
        """Let the position be the way since a time ago, at which it was zero."""
        back = np.eye(len(self.mean))
        back[POSITION, VELOCITY] = time_s * np.eye(3)
        back[POSITION, ACCELERATION] = -0.5 * time_s**2 * np.eye(3)
        return replace(self, mean=back @ self.mean, covariances=back @ self.covariances @ back.T)

    def astray(self, way_m: F64) -> Belief:
        """Let the position be off by a way that may have been gone or not."""
        covariances = self.covariances.copy()
        covariances[:, POSITION, POSITION] += np.outer(way_m, way_m)
        return replace(self, covariances=covariances)
