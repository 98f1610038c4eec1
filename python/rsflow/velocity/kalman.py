"""The arithmetic of the filter: constant acceleration over any time, causes that stay the same, updates, a gate.

docs/explanation/algorithms.md, section "Velocities filtered over time: VelocityFilter".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ACCELERATION",
    "BIAS",
    "DELAY",
    "HEADING",
    "POSITION",
    "STATES",
    "VELOCITY",
    "advance",
    "consider_update",
    "cross",
    "distance",
    "heading_matrix",
    "level_from_body",
]

F64 = NDArray[np.float64]

# Places in the state; what is common to all frames follows after it.
POSITION, VELOCITY, ACCELERATION = slice(0, 3), slice(3, 6), slice(6, 9)
HEADING, BIAS, DELAY, STATES = 9, slice(10, 13), 13, 14


def advance(
    state: F64,
    covariances: F64,
    dt_s: float,
    *,
    walk: float,
    turn_rad: float,
    turn_variance: float,
    gyro: F64 | None,
    memory_s: F64,
) -> tuple[F64, F64]:
    """Carry the state and both its covariances (2, N, N) on by `dt_s`: with what is common to all frames, and without.

    `walk` is the variance of the change of acceleration in a second; `turn_rad` the change of heading meanwhile, and
    `gyro` (4,) its derivative by gyro bias and delay where a gyro measured it. `memory_s` is how long the last states,
    which have unit variance, keep their value: infinite, or the time constant of a Gauss-Markov process of first order.
    """
    first = len(state) - len(memory_s)
    kept = np.exp(-dt_s / memory_s)
    step = np.diag(np.concatenate([np.ones(first), kept]))
    axes = np.arange(3)
    step[axes, axes + 3] = step[axes + 3, axes + 6] = dt_s
    step[axes, axes + 6] = 0.5 * dt_s**2
    if gyro is not None:
        step[HEADING, 10:14] = gyro
    state = step @ state
    state[HEADING] += turn_rad
    covariances = step @ covariances @ step.T
    # White jerk, integrated three times (Bar-Shalom, Li and Kirubarajan 2001, equation 6.2.3-8).
    noise = walk * np.array(
        [
            [dt_s**5 / 20, dt_s**4 / 8, dt_s**3 / 6],
            [dt_s**4 / 8, dt_s**3 / 3, dt_s**2 / 2],
            [dt_s**3 / 6, dt_s**2 / 2, dt_s],
        ]
    )
    for axis in range(3):
        covariances[:, axis:9:3, axis:9:3] += noise
    covariances[:, HEADING, HEADING] += turn_variance
    covariances[0, first:, first:] += np.diag(1.0 - kept**2)
    return state, covariances


def consider_update(state: F64, covariances: F64, residual: F64, design: F64, noise: F64) -> tuple[F64, F64]:
    """Take in a measurement by the gain of the covariance without what is common to all frames, `covariances[1]`.

    The other one says what that is worth: what is common keeps its variance, and no number of measurements makes the
    rest surer than it allows. It is not in the gain, as small errors of its effect would pass for knowledge of it.
    Joseph's form, which holds for any gain.
    """
    own = covariances[1]
    gain = np.linalg.solve(design @ own @ design.T + noise, design @ own).T
    keep = np.eye(len(state)) - gain @ design
    updated = keep @ covariances @ keep.T + gain @ noise @ gain.T
    return state + gain @ residual, 0.5 * (updated + updated.transpose(0, 2, 1))


def distance(covariance: F64, residual: F64, design: F64, noise: F64) -> float:
    """Give the Mahalanobis distance of a residual from what the state says."""
    expected = design @ covariance @ design.T + noise
    return float(np.sqrt(max(float(residual @ np.linalg.solve(expected, residual)), 0.0)))


def heading_matrix(heading_rad: float) -> tuple[F64, F64]:
    """Give the axes of the start from level axes turned by a heading about straight down, and its derivative."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return turn, np.array([[-sin, -cos, 0.0], [cos, -sin, 0.0], [0.0, 0.0, 0.0]])


def level_from_body(down: F64) -> F64:
    """Give the shortest rotation that takes a unit vector `down` of the body to (0, 0, 1)."""
    x, y, z = down
    if z < -1.0 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    share = 1.0 / (1.0 + z)
    return np.array([[1.0 - x * x * share, -x * y * share, -x], [-x * y * share, 1.0 - y * y * share, -y], [x, y, z]])


def cross(vector: F64) -> F64:
    """Give the matrix that makes ``cross(vector, other)`` of `other`."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
