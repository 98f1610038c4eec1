"""Find the motion between two frames: led by the one before, else from the picture's shift, else from points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._rotation import rotation_matrix
from ..camera.model import Camera
from ..shift import ShiftStatus
from . import plane
from .result import VelocityStatus
from .start import Turned, followed_points, whole_shift

F64 = NDArray[np.float64]

# The fewest tiles that a motion is judged by: twice the unknowns, in two equations each.
LEAST_TILES = 6
# Of the tiles that show something, this part moves with the plane.
HALF = 0.5
# Another motion that holds for this part of what holds for the plane may be that of the ground.
_COMPARABLE = 0.6
# On ground that repeats, motions of more heights a second than this are left out.
_LIKELY_HEIGHTS_S = 10.0
# Levels of the pyramid: where the motion before leads, and where the picture's shift does.
_LED, _SOUGHT = 2, 4
# The share of the shown tiles below which a motion that was led to is sought again from the pictures.
_DOUBTED = 0.6


@dataclass(frozen=True)
class Task:
    """Two frames, and what is known of the camera between them: `covariance` (3, 3) of the rotation beyond the told."""

    camera: Camera
    follower: plane.Follower
    prev: NDArray[Any]
    image: NDArray[Any]
    mask: NDArray[np.bool_] | None
    interval: plane.Interval
    covariance: F64
    numbers: tuple[int, ...]

    def turned(self) -> Turned | None:
        """Where the told rotation alone puts pixels; None without one."""
        if not self.interval.turn.any():
            return None
        by = rotation_matrix(-self.interval.turn)

        def to(pixels: F64) -> F64:
            rays = self.camera.undistort_points(pixels, normalized=True).astype(np.float64)
            x = rays @ by[:, :2].T + by[:, 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                x = x[:, :2] / np.where(x[:, 2] > 1e-9, x[:, 2], np.nan)[:, None]
            return np.asarray(self.camera.distort_points(x, normalized=True), dtype=np.float64)

        return to


@dataclass(frozen=True)
class Found:
    """A motion, or why there is none."""

    motion: plane.Motion | None
    status: VelocityStatus


def find(task: Task, led: Sequence[float] | None) -> Found:
    """Find the motion; `led` (6,) is where the motion before leads."""
    best: plane.Motion | None = None
    if led is not None:
        best = task.follower.motion(task.interval, led, task.covariance, levels=_LED, numbers=task.numbers)
        if best is not None and _holds(best, _DOUBTED):
            return Found(best, VelocityStatus.OK)
    turned = task.turned()
    longest = task.camera.fx * _LIKELY_HEIGHTS_S * task.interval.dt_s
    shift, status = whole_shift(task.prev, task.image, turned, task.mask, longest)
    if status is ShiftStatus.AMBIGUOUS:
        return Found(None, VelocityStatus.AMBIGUOUS)
    related = status is ShiftStatus.VALID
    if related:
        down = task.interval.down
        way = -shift / (task.camera.fx, task.camera.fy) / max(float(down[2]), 0.2)
        sought = task.follower.motion(
            task.interval, [*way.tolist(), 0.0, 0.0, 0.0, 0.0], task.covariance, levels=_SOUGHT, numbers=task.numbers
        )
        best = _better(best, sought)
        if best is not None and _holds(best, _DOUBTED):
            return Found(best, VelocityStatus.OK)
    matches = followed_points(task.prev, task.image, shift if related else np.zeros(2), turned, task.mask)
    if len(matches) >= LEAST_TILES:
        fitted = task.follower.fit(task.interval, matches, task.covariance)
        if fitted is not None and np.isfinite(fitted.values).all():
            led = fitted.values.tolist()
            sought = task.follower.motion(task.interval, led, task.covariance, levels=_LED, numbers=task.numbers)
            best = _better(best, sought)
    return _judged(best, status, related)


def _judged(best: plane.Motion | None, status: ShiftStatus, related: bool) -> Found:
    shown = 0 if best is None else _shown(best)
    if best is not None and _holds(best, HALF):
        return Found(best, VelocityStatus.OK)
    if status in (ShiftStatus.NO_TEXTURE, ShiftStatus.APERTURE, ShiftStatus.TOO_SMALL) and shown < LEAST_TILES:
        return Found(None, VelocityStatus.NO_TEXTURE)
    if not related:
        return Found(None, VelocityStatus.SCENE_CUT)
    if shown < LEAST_TILES:
        return Found(None, VelocityStatus.TOO_FEW_POINTS)
    return Found(None, VelocityStatus.INCONSISTENT)


def _shown(motion: plane.Motion) -> int:
    """Count the tiles that show something."""
    return int(np.count_nonzero(motion.status > plane.LOW_TEXTURE)) + int(np.count_nonzero(motion.plane))


def _holds(motion: plane.Motion, part: float) -> bool:
    """Say whether the frames can be laid over each other by a motion."""
    count = int(np.count_nonzero(motion.plane))
    return motion.settled and count >= LEAST_TILES and count >= part * _shown(motion)


def _better(one: plane.Motion | None, other: plane.Motion | None) -> plane.Motion | None:
    """Give the motion that more tiles follow."""
    if one is None or other is None:
        return one or other
    return other if np.count_nonzero(other.plane) > np.count_nonzero(one.plane) else one


def second_motion(task: Task, motion: plane.Motion) -> bool:
    """Say whether another motion holds for nearly as much of the picture: then either may be that of the ground."""
    ground = int(np.count_nonzero(motion.plane))
    others = motion.status > plane.LOW_TEXTURE
    if np.count_nonzero(others) < _COMPARABLE * ground:
        return False
    if np.count_nonzero(motion.status == plane.FIXED) >= _COMPARABLE * ground:
        return True
    # Only where the picture does not move with the plane.
    height, width = task.prev.shape
    mask = np.zeros((height, width), np.bool_)
    half = 0.5 * np.sqrt(height * width / max(len(motion.status), 1))
    for x, y in motion.tiles[others, :2]:
        top, left = max(int(y - half), 0), max(int(x - half), 0)
        mask[top : int(y + half) + 1, left : int(x + half) + 1] = True
    if task.mask is not None:
        mask &= task.mask
    shift, status = whole_shift(task.prev, task.image, None, mask, np.inf)
    if status is not ShiftStatus.VALID:
        return False
    return float(np.hypot(*(shift - motion.moved_px()))) > 1.0
