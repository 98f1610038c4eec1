"""The motion over a plane as `_core` finds it, and how it follows from the displacements and what else is known.

docs/explanation/algorithms.md, section "Velocity over a plane: VelocityEstimator".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ... import _core
from ...camera.model import Camera

F64 = NDArray[np.float64]

# Statuses of tiles, as lk-core has them.
PLANE, OUTSIDE, LOW_TEXTURE, UNMATCHED, OUTLIER, FIXED = range(6)
# Numbers whose effect can be asked for beside those of the lens, from 0 on: the direction down, the readout.
DOWN_X, DOWN_Y, READOUT = -1, -2, -3
# Of a rotation that nothing is known of: the inverse of its variance.
_ANY = 1.0


@dataclass(frozen=True)
class Interval:
    """What is known about the camera between two frames, in its own axes.

    Attributes
    ----------
    turn : (3,) float64
        Its rotation vector in radians, as far as it was told.
    down : (3,) float64
        Unit vector straight down at the second frame.
    dt_s : float
    readout : float
        Time from the first row to the last, in intervals.
    growth : (3,) float64
        How much the rotation grows from one interval to the next, in radians.
    """

    turn: F64
    down: F64
    dt_s: float
    readout: float
    growth: F64 = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Motion:
    """A motion over a plane: way (3,) in heights and rotation beyond the told one (3,), half-way in the camera's axes.

    `normal` (6, 6) and `right` (6,) are the normal equations of the displacements alone. `tiles` (N, 11) are rows of
    middle, displacement, residual, weight, information, correlation; `status` (N,) what became of each.
    """

    values: F64
    normal: F64
    right: F64
    responses: F64
    scale: float
    widened: float
    residual: float
    correlation: float
    settled: bool
    tiles: F64
    status: NDArray[np.uint8]

    @property
    def plane(self) -> NDArray[np.bool_]:
        """Which tiles move with the plane."""
        which: NDArray[np.bool_] = self.status == PLANE
        return which

    @property
    def count(self) -> int:
        """How many tiles move with the plane."""
        return int(np.count_nonzero(self.plane))

    def alike(self) -> float:
        """Median correlation of the tiles that move with the plane."""
        which = self.plane
        return float(np.median(self.tiles[which, 10])) if which.any() else 0.0

    def moved_px(self) -> F64:
        """Median displacement of the tiles of the plane, (2,)."""
        which = self.plane
        if not which.any():
            return np.full(2, np.nan)
        ordered = np.sort(self.tiles[which, 2:4], axis=0)
        return np.asarray(0.5 * (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]))

    def rotation(self, tilt: F64 | None, at: F64) -> tuple[F64, F64]:
        """Rotation (3,) beyond the told one that the displacements say, and its covariance.

        `tilt` (2, 2) is the covariance of straight down, or None where that is exact, and `at` (2,) its mean.
        """
        normal, right = self._whole(tilt is not None)
        normal[range(3, 6), range(3, 6)] += _ANY
        if tilt is not None:
            precision = np.linalg.inv(tilt)
            normal[6:, 6:] += precision
            right = np.concatenate([right[:6], right[6:] + precision @ at])
        inverse = np.linalg.inv(normal)
        return inverse[3:6] @ right, np.asarray(inverse[3:6, 3:6], dtype=np.float64)

    def _whole(self, tilted: bool) -> tuple[F64, F64]:
        """Give the normal equations of the displacements alone, for motion and, where not exact, straight down."""
        if not tilted:
            return self.normal.copy(), self.right
        count = len(self.responses)
        down = self.responses[-2:]
        normal = np.zeros((8, 8))
        normal[:6, :6] = self.normal
        normal[6:, :6] = down[:, :6]
        normal[:6, 6:] = down[:, :6].T
        normal[6:, 6:] = down[:, 7 + count - 2 :]
        right = np.concatenate([self.right, down[:, 6] + down[:, :6] @ self.values])
        return normal, right.astype(np.float64)

    def known(self, prior: Prior) -> Known:
        """Give the motion under what is known of rotation and straight down."""
        tilted = len(prior.mean) == 5
        normal, right = self._whole(tilted)
        size = len(right)
        precision = np.zeros((size, size))
        precision[3:, 3:] = np.linalg.inv(prior.covariance)
        precision[range(3), range(3)] = 1e-4
        inverse = np.linalg.inv(normal + precision)
        at = np.concatenate([np.zeros(3), prior.mean])
        told = inverse[:, 3:] @ precision[3:, 3:]
        count = len(self.responses)
        *lens, readout = self.responses[: count - (2 if tilted else 0)]
        sides = np.array([*lens, readout])[:, :6]
        if tilted:
            sides = np.hstack([sides, np.array([*lens, readout])[:, 7 + count - 2 :]])
        values = inverse @ (right + precision @ at)
        moved = values.copy()
        moved[:6] -= self.values
        along = sides[-1]
        return Known(
            values=values,
            readout=(
                float(readout[6] - along @ moved),
                float(readout[7 + len(lens)] - along @ inverse @ along),
            ),
            noise=inverse @ normal @ inverse,
            rotation=told[:, :3] @ prior.cover[:3, :3] @ told[:, :3].T,
            both=told @ prior.cover @ told.T,
            changes=-(inverse[:3] @ sides[:-1].T).T,
        )


@dataclass(frozen=True)
class Prior:
    """What is known of rotation (3) and, where it is not exact, of straight down (2).

    `covariance` is that under which the motion is the most likely one, `cover` that which may really be.
    """

    mean: F64
    covariance: F64
    cover: F64

    @classmethod
    def of(cls, covariance: F64, cover: F64, tilt: F64 | None, at: F64, *, carried: bool) -> Prior:
        """Put together; an error of the rotation that carried straight down turns both."""
        if tilt is None:
            return cls(np.zeros(3), covariance, cover)

        def joined(rotation: F64) -> F64:
            whole = np.zeros((5, 5))
            whole[:3, :3] = rotation
            whole[3:, 3:] = tilt
            # What the carrying itself put into the tilt goes together with the rotation, as far as both have it.
            share = min(_least(rotation[:2, :2]), 0.5 * _least(tilt)) if carried else 0.0
            whole[[0, 1], [3, 4]] = whole[[3, 4], [0, 1]] = -share
            return whole

        return cls(np.concatenate([np.zeros(3), at]), joined(covariance), joined(cover))


def _least(covariance: F64) -> float:
    """Give the smaller variance along any direction of a (2, 2) covariance, or nearly."""
    (a, b), (_, c) = covariance.tolist()
    return max(0.5 * float(a + c) - float(np.hypot(0.5 * (a - c), b)), 0.0)


@dataclass(frozen=True)
class Known:
    """A motion under what is known: `values` (6 or 8,): way, rotation, and tilt.

    `noise` is its covariance from the displacements, `rotation` that from what is not known of the rotation, `both`
    that from rotation and tilt. `readout` is what speaks for a longer readout, per interval, and how much it would if
    it were one interval longer. `changes` (N, 3) are those of the way for one unit of each number of the lens.
    """

    values: F64
    readout: tuple[float, float]
    noise: F64
    rotation: F64
    both: F64
    changes: F64

    @property
    def covariance(self) -> F64:
        """Of all values."""
        return self.noise + self.both


class Follower:
    """Frames of one camera, and the motion between the last two."""

    def __init__(self, camera: Camera) -> None:
        lens = (camera.model, (camera.fx, camera.fy), (camera.cx, camera.cy), list(camera.distortion))
        self._lens = lens
        self._rows = camera.height
        self._tracker = _core.PlaneTracker(*lens)

    def push(self, image: NDArray[np.generic], mask: NDArray[np.bool_] | None) -> None:
        """Take the next frame."""
        self._tracker.push(image, mask)

    def take_back(self) -> None:
        """Take the last frame back."""
        self._tracker.take_back()

    def motion(
        self,
        interval: Interval,
        start: Sequence[float],
        covariance: F64,
        *,
        levels: int = 2,
        numbers: Sequence[int] = (),
    ) -> Motion | None:
        """Find the motion near a start (6,), with this covariance (3, 3) of the rotation beyond the told one."""
        found = self._tracker.motion(_task(interval, start, levels, covariance, numbers))
        return None if found is None else _motion(found)

    def fit(self, interval: Interval, matches: F64, covariance: F64, numbers: Sequence[int]) -> Motion | None:
        """Find the motion from points: rows of x, y, x, y in the next frame, covariance xx, xy, yy."""
        found = _core.fit_plane(
            *self._lens, self._rows, np.ascontiguousarray(matches), _task(interval, [0.0] * 6, 1, covariance, ())
        )
        if found is None:
            return None
        # Points say nothing of lens, readout and straight down: what is known of these stands.
        motion = _motion(found)
        return replace(motion, responses=np.zeros((len(numbers), 7 + len(numbers))))


def _task(
    interval: Interval, start: Sequence[float], levels: int, covariance: F64, numbers: Sequence[int]
) -> _core._PlaneTask:
    turn, down, growth = (tuple(v.tolist()) for v in (interval.turn, interval.down, interval.growth))
    rows = tuple(tuple(row) for row in covariance.tolist())
    return ((turn, down, interval.readout, growth), tuple(start), levels, ((0.0, 0.0, 0.0), rows), list(numbers))  # type: ignore[return-value]


def _motion(found: _core._PlaneFound) -> Motion:
    (values, normal, pull, responses), (scale, widened, residual, correlation, settled), (tiles, status) = found
    right = normal @ values + pull
    return Motion(values, normal, right, responses, scale, widened, residual, correlation, settled, tiles, status)
