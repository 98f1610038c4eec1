"""The path that a camera takes: a pose at any time, and the mean motion between two, exact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._rotation import rotation_matrix
from ..errors import OptionError, ShapeError

F64 = NDArray[np.float64]

# A velocity or rate that is a function of time is taken as constant for so long, around the middle.
STEP_S = 0.001
# So long before the first frame and after the last such functions are followed, for instruments that lag behind.
_BEYOND_S = 0.5
_MOST_STEPS = 2_000_000


@dataclass(frozen=True)
class Path:
    """A camera's pose at any time: body velocity and rate are constant within each interval between knots.

    The position within an interval is linear in time, so that the mean velocity of an interval, taken in the camera's
    axes half-way through, is exactly the one that was asked for.
    """

    t_s: F64
    position_m: F64
    rotation: F64
    velocity_m_s: F64
    rate_rad_s: F64

    def at(self, t_s: float | F64) -> tuple[F64, F64]:
        """Position (3,) and rotation (3, 3) from the camera's axes to the world's; of times (...), (..., 3) and so on.

        Goes on past the ends.
        """
        count = len(self.velocity_m_s)
        t = np.asarray(t_s, dtype=np.float64)
        if count == 0:
            return np.broadcast_to(self.position_m[0], (*t.shape, 3)), np.broadcast_to(
                self.rotation[0], (*t.shape, 3, 3)
            )
        k = np.clip(np.searchsorted(self.t_s, t, side="right") - 1, 0, count - 1)
        since, span = t - self.t_s[k], self.t_s[k + 1] - self.t_s[k]
        step = (self.position_m[k + 1] - self.position_m[k]) * (since / span)[..., None]
        turn = self.rate_rad_s[k] * since[..., None]
        by = rotation_matrix(turn) if t.ndim == 0 else rotation_matrices(turn)
        return self.position_m[k] + step, self.rotation[k] @ by

    def rate_at(self, t_s: F64) -> F64:
        """Angular rate at times (N,), in the camera's axes: (N, 3)."""
        count = len(self.rate_rad_s)
        if count == 0:
            return np.zeros((len(t_s), 3))
        return self.rate_rad_s[np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, count - 1)]

    def means(self, start_s: F64, stop_s: F64) -> tuple[F64, F64]:
        """Mean velocity, in the axes half-way through, and mean rate between times (N,): (N, 3) each."""
        (before, turned), (after, turns) = self.at(start_s), self.at(stop_s)
        half = self.at((start_s + stop_s) / 2)[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            over = 1.0 / (stop_s - start_s)[:, None]
            velocity = np.einsum("nji,nj->ni", half, after - before) * over
            rate = rotation_vectors(np.swapaxes(turned, 1, 2) @ turns) * over
        return velocity, rate


def rotation_matrices(vectors: F64) -> F64:
    """Rotations (..., 3, 3) by |vector| radians about each of the vectors (..., 3), right-handed."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = (vectors[..., k] for k in range(3))
    zero = np.zeros_like(x)
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vectors.shape[:-1], 3, 3)
    # sin(a) / a and (1 - cos(a)) / a^2, right at 0 too: numpy's sinc is of pi x.
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + first * k + second * (k @ k), dtype=np.float64)


def rotation_vectors(rotations: F64) -> F64:
    """Vectors (N, 3) of rotations (N, 3, 3) by less than pi."""
    twice = np.stack([rotations[:, i, j] - rotations[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1)
    sine = np.linalg.norm(twice, axis=1) / 2
    angle = np.arctan2(sine, (np.trace(rotations, axis1=1, axis2=2) - 1) / 2)
    scale = np.where(sine > 1e-12, angle / np.where(sine > 1e-12, 2 * sine, 1.0), 0.5)
    return np.asarray(twice * scale[:, None], dtype=np.float64)


Motion = ArrayLike | Callable[[float], ArrayLike]


def path_from_rates(
    times_s: F64, height_m: float, velocity_m_s: Motion, rate_rad_s: Motion, tilt_rad: tuple[float, float]
) -> Path:
    """Integrate body velocity and rate from a start above the world's origin at the first of the times."""
    if len(times_s) < 1 or (np.diff(times_s) <= 0).any():
        got = f"{len(times_s)} times, not each later than the one before" if len(times_s) else "no time"
        raise OptionError(f"times_s: got {got}, expected finite times in seconds, each later than the one before")
    knots, first = times_s, 0
    if callable(velocity_m_s) or callable(rate_rad_s):
        knots, first = _knots(times_s)
    intervals = np.searchsorted(times_s, (knots[:-1] + knots[1:]) / 2, side="right") - 1
    velocity, rate = (
        _steps(name, given, len(times_s) - 1, knots, intervals)
        for name, given in (("velocity_m_s", velocity_m_s), ("rate_rad_s", rate_rad_s))
    )
    position, attitude = np.empty((len(knots), 3)), np.empty((len(knots), 3, 3))
    position[first] = (0.0, 0.0, -float(height_m))
    attitude[first] = rotation_matrix((tilt_rad[0], 0.0, 0.0)) @ rotation_matrix((0.0, tilt_rad[1], 0.0))
    way = [(k, k + 1, k) for k in range(first, len(knots) - 1)] + [(k + 1, k, k) for k in range(first - 1, -1, -1)]
    for start, stop, k in way:
        dt = float(knots[stop] - knots[start])
        middle = attitude[start] @ rotation_matrix(rate[k] * (dt / 2))
        position[stop] = position[start] + middle @ velocity[k] * dt
        attitude[stop] = attitude[start] @ rotation_matrix(rate[k] * dt)
        if position[stop][2] >= 0 and times_s[0] <= knots[stop] <= times_s[-1]:
            raise OptionError(
                f"height_m, velocity_m_s: got {height_m:g} m and a way on which the camera reaches the ground at "
                f"t = {knots[stop]:g} s, expected one above it"
            )
    return Path(knots, position, attitude, velocity, rate)


def _knots(times_s: F64) -> tuple[F64, int]:
    """Give times close enough for functions of time, the frames' among them, and the place of the first frame."""
    edges = np.concatenate([[times_s[0] - _BEYOND_S], times_s, [times_s[-1] + _BEYOND_S]])
    counts = np.ceil(np.diff(edges) / STEP_S - 1e-6).astype(int).clip(1)
    if counts.sum() > _MOST_STEPS:
        span = times_s[-1] - times_s[0]
        raise OptionError(
            f"times_s: got {span:g} s with a motion that is a function of time, "
            f"expected at most {_MOST_STEPS * STEP_S:g} s"
        )
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(edges, edges[1:], counts, strict=False)]
    return np.concatenate([*parts, edges[-1:]]), int(counts[0])


def _steps(name: str, given: Motion, count: int, knots: F64, intervals: NDArray[np.intp]) -> F64:
    """Velocity or rate of each interval between knots, (K - 1, 3)."""
    if callable(given):
        of_time = _checks.function(name, given, 1)
        values = [
            _checks.vector(name, of_time(float(t)), 3, "three finite numbers") for t in (knots[:-1] + knots[1:]) / 2
        ]
        value = np.array(values).reshape(-1, 3)
    else:
        expected = f"finite numbers, (3,) or ({count}, 3)"
        value = _checks.array(name, given, ..., expected, finite=True).astype(np.float64)
        if value.shape not in ((3,), (count, 3)):
            raise ShapeError(f"{name}: got shape {value.shape}, expected {expected}")
        if value.ndim == 1:
            value = np.broadcast_to(value, (len(intervals), 3))
        else:
            value = value[np.clip(intervals, 0, count - 1)] if count else np.zeros((len(intervals), 3))
    if value.size and np.abs(value).max() > 1e6:
        raise OptionError(f"{name}: got {np.abs(value).max():g}, expected numbers up to 1e6")
    return np.array(value, dtype=np.float64)
