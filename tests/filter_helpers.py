"""Made measurements for the velocity filter: a body whose acceleration walks at random, and what is measured of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsflow import Velocity, VelocityStatus

# Steps of the walk within a frame's interval.
FINE = 8


@dataclass
class Walk:
    """Truth at the times of frames: position, velocity, acceleration, heading; of intervals the mean velocity."""

    t_s: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    heading: np.ndarray
    mean_body: np.ndarray


def walk(rng: np.random.Generator, t_s: np.ndarray, *, power: float, start: float, speed: float, yaw: float) -> Walk:
    """A body with white jerk of that power, an acceleration `start` at first, and a constant yaw rate."""
    x = np.concatenate([np.zeros(3), speed * rng.standard_normal(3), start * rng.standard_normal(3)])
    states, heading, means = [x.copy()], [0.0], [np.zeros(3)]
    for dt in np.diff(t_s):
        step, before, way = dt / FINE, heading[-1], np.zeros(3)
        for k in range(FINE):
            jerk = rng.standard_normal(3) * np.sqrt(power / step)
            p, v, a = x[:3].copy(), x[3:6].copy(), x[6:].copy()
            x[:3] = p + v * step + a * step**2 / 2 + jerk * step**3 / 6
            x[3:6] = v + a * step + jerk * step**2 / 2
            x[6:] = a + jerk * step
            angle = before + yaw * (k + 0.5) * step
            way += turned(x[:3] - p, -angle)
        means.append(way / dt)
        heading.append(before + yaw * dt)
        states.append(x.copy())
    s = np.array(states)
    return Walk(t_s, s[:, :3], s[:, 3:6], s[:, 6:], np.array(heading), np.array(means))


def turned(v: np.ndarray, angle: float) -> np.ndarray:
    """`v` turned about z."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], v[2]])


def velocity(t_s: float, dt_s: float, v: np.ndarray | None, noise: np.ndarray, **common: np.ndarray) -> Velocity:
    """A velocity with its covariance from parts; None: a frame without one."""
    if v is None:
        status, v, covariance, parts = VelocityStatus.NO_TEXTURE, np.full(3, np.nan), np.diag(np.full(3, np.inf)), {}
    else:
        status = VelocityStatus.OK
        parts = {"displacement": noise, **{name.replace("_", " "): part for name, part in common.items()}}
        covariance = sum(parts.values())
    return Velocity(t_s, dt_s, *map(float, v), covariance, status, 90, 1.0, 0.0, parts=parts)
