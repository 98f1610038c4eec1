"""Find the motion between two frames: led by the one before, else from the picture's shift, else from points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...shift import ShiftStatus, estimate_shift
from ..result import VelocityStatus
from . import plane
from .others import is_ambiguous
from .start import followed_points, whole_shift
from .task import Task

F64 = NDArray[np.float64]

# The fewest tiles that a motion is judged by: twice the unknowns, in two equations each.
LEAST_TILES = 6
# Of the tiles that show something, this part moves with the plane.
HALF = 0.5
# Levels of the pyramid: where the motion before leads, and where the picture's shift does.
_LED, _SOUGHT = 2, 4
# Of the tiles that show something, a motion that was led to holds for this part; one that was sought for `_MOST`, or
# both pictures are alike wherever it holds. Pictures that have only patches in common do neither.
_DOUBTED = 0.6
_MOST = 0.8
_ALIKE = 0.97


@dataclass(frozen=True)
class Found:
    """A motion, or why there is none.

    `left_out` is how many heights a second another motion is that explains the pictures as well, but for its speed; 0
    where there is none, None where the motion before led on.
    """

    motion: plane.Motion | None
    status: VelocityStatus
    left_out: float | None = None


def find(task: Task, led: Sequence[float] | None) -> Found:
    """Find the motion; `led` (6,) is where the motion before leads."""
    best: plane.Motion | None = None
    if led is not None:
        best = task.follower.motion(task.interval, led, task.covariance, levels=_LED, numbers=task.numbers)
        if best is not None and _holds(best, _DOUBTED):
            return Found(best, VelocityStatus.OK)
    turned = task.turned()
    shift, status = whole_shift(task.prev, task.image, turned, task.mask, task.camera.fx * task.likely)
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
        if best is not None and _is_found(best):
            return _sought(task, best)
    if not related and led is None:
        # Nothing leads: a picture that grows or turns where it is has no shift as a whole.
        nowhere = [0.0] * 6
        best = task.follower.motion(task.interval, nowhere, task.covariance, levels=_SOUGHT, numbers=task.numbers)
        if best is not None and _is_found(best) and best.alike() > _ALIKE:
            return _sought(task, best)
    start = shift if related else np.zeros(2)
    matches = followed_points(task.prev, task.image, start, turned, task.mask)
    if len(matches) >= LEAST_TILES:
        fitted = task.follower.fit(task.interval, matches, task.covariance, task.numbers)
        if fitted is not None and np.isfinite(fitted.values).all():
            led = fitted.values.tolist()
            sought = task.follower.motion(task.interval, led, task.covariance, levels=_LED, numbers=task.numbers)
            best = _better(best, sought)
            if (best is None or _shown(best) < LEAST_TILES) and _holds(fitted, HALF):
                # A picture that is too small for tiles.
                best = fitted
    if best is not None and _is_found(best):
        return _sought(task, best)
    shown = 0 if best is None else _shown(best)
    if status in (ShiftStatus.NO_TEXTURE, ShiftStatus.APERTURE, ShiftStatus.TOO_SMALL) and shown < LEAST_TILES:
        # Blank after a picture that was not: the lens is covered, or the recording jumps.
        itself = estimate_shift(task.prev, task.prev, mask=task.mask, next_mask=task.mask)
        return Found(None, VelocityStatus.SCENE_CUT if itself.valid else VelocityStatus.NO_TEXTURE)
    if not related:
        return Found(None, VelocityStatus.SCENE_CUT)
    if shown < LEAST_TILES:
        return Found(None, VelocityStatus.TOO_FEW_POINTS)
    return Found(None, VelocityStatus.INCONSISTENT)


def _is_found(motion: plane.Motion) -> bool:
    """Say whether a motion that nothing led to holds."""
    # Points have passed their own tests.
    alike = not np.isfinite(motion.correlation) or motion.alike() > _ALIKE
    return _holds(motion, _MOST) or (_holds(motion, HALF) and alike)


def _sought(task: Task, motion: plane.Motion) -> Found:
    """Take a motion that nothing led to, if the ground does not repeat so that another one holds as well."""
    ambiguous, left_out = is_ambiguous(task, motion)
    if ambiguous:
        return Found(None, VelocityStatus.AMBIGUOUS)
    return Found(motion, VelocityStatus.OK, left_out)


def _shown(motion: plane.Motion) -> int:
    """Count the tiles that show something."""
    return int(np.count_nonzero(motion.status > plane.LOW_TEXTURE)) + motion.count


def _holds(motion: plane.Motion, part: float) -> bool:
    """Say whether the frames can be laid over each other by a motion."""
    return motion.settled and motion.count >= max(LEAST_TILES, part * _shown(motion))


def _better(one: plane.Motion | None, other: plane.Motion | None) -> plane.Motion | None:
    """Give the motion that more tiles follow."""
    if one is None or other is None:
        return one or other
    return other if other.count > one.count else one
