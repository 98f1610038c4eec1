"""Whether another motion explains the pictures as well: that of something else, or of ground that repeats."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...shift import ShiftStatus
from . import plane
from .start import whole_shift
from .task import Task

F64 = NDArray[np.float64]

# Another motion that holds for this part of what holds for the plane may be that of the ground.
_COMPARABLE = 0.6
# So is one that holds for this part of what stands still: that is what goes with the camera.
_COMPARABLE_TO_STILL = 0.3
# It is looked for where this part of the plane's tiles does not move with it.
_SUSPECT = 0.15
# A pixel is that of the motion that leaves less than this part of what the other leaves.
_CLEARLY = 0.4
# Motions that differ by less than this many pixels are one.
_APART_PX = 1.0
# A picture that moves by less than this stands still; where so many tiles beside those of the plane do not, it is in
# doubt.
_STILL_PX = 0.3
_HIDDEN = 0.4
# Side of the square over which that is asked, in pixels.
_SIDE = 7
# Ground repeats where a picture looks like itself elsewhere, as a correlation, further away than so many pixels.
_REPEATS = 0.3
_FROM = 5
# The picture on which that is looked for is at most so wide.
_WIDTH = 200
# A motion is another candidate if so many of the tiles follow it, and leave no more than so many times the residual.
_AS_MANY = 0.8
_AS_WELL = 1.6


def second_motion(task: Task, motion: plane.Motion) -> bool:
    """Say whether another motion holds for nearly as much of the picture: then either may be that of the ground."""
    others = motion.status > plane.LOW_TEXTURE
    if np.count_nonzero(others) < _SUSPECT * motion.count:
        return False
    moved = motion.moved_px()
    still = float(np.hypot(*moved)) < _STILL_PX
    if 2 * np.count_nonzero(motion.status == plane.FIXED) >= np.count_nonzero(others):
        shift = np.zeros(2)
    else:
        around = _around(task, motion.tiles[others, :2], len(motion.status))
        shift, status = whole_shift(task.prev, task.image, None, around, np.inf)
        if status is not ShiftStatus.VALID:
            # What stands still may be part of the vehicle, and what does not the ground that it hides.
            return bool(still and np.count_nonzero(others) >= _HIDDEN * motion.count)
    if np.hypot(*(shift - moved)) < _APART_PX:
        return False
    ground, other = _supports(task, motion, shift)
    return other >= (_COMPARABLE_TO_STILL if still else _COMPARABLE) * ground


def _around(task: Task, middles: F64, count: int) -> NDArray[np.bool_]:
    """Give the pixels of some of `count` tiles."""
    height, width = task.prev.shape
    mask = np.zeros((height, width), np.bool_)
    half = 0.5 * np.sqrt(height * width / max(count, 1))
    for x, y in middles:
        top, left = max(int(y - half), 0), max(int(x - half), 0)
        mask[top : int(y + half) + 1, left : int(x + half) + 1] = True
    if task.mask is not None:
        mask &= task.mask
    return mask


def _supports(task: Task, motion: plane.Motion, shift: F64) -> tuple[int, int]:
    """Count the pixels that clearly move with the plane, and those that clearly move by `shift`."""
    import cv2

    height, width = task.prev.shape
    which = motion.plane
    x, y = motion.tiles[which, 0], motion.tiles[which, 1]
    design = np.column_stack([np.ones_like(x), x, y])
    affine = np.linalg.lstsq(design, motion.tiles[which, 2:4], rcond=None)[0]
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    prev, image = task.prev.astype(np.float32), task.image.astype(np.float32)

    def left(to_x: NDArray[Any], to_y: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        moved = cv2.remap(image, to_x.astype(np.float32), to_y.astype(np.float32), cv2.INTER_LINEAR)
        difference = moved - prev
        mean = cv2.boxFilter(difference, -1, (_SIDE, _SIDE))
        square = cv2.boxFilter(difference * difference, -1, (_SIDE, _SIDE)) - mean * mean
        inside = (to_x >= 0) & (to_y >= 0) & (to_x <= width - 1) & (to_y <= height - 1)
        return square, inside

    of_plane, here = left(
        u + affine[0, 0] + affine[1, 0] * u + affine[2, 0] * v, v + affine[0, 1] + affine[1, 1] * u + affine[2, 1] * v
    )
    of_other, there = left(u + float(shift[0]), v + float(shift[1]))
    # What noise leaves is no evidence for either.
    shows = here & there & (np.maximum(of_plane, of_other) > 4.0 * max(motion.residual, 0.3) ** 2)
    if task.mask is not None:
        shows &= task.mask
    return (
        int(np.count_nonzero(shows & (of_plane < _CLEARLY * of_other))),
        int(np.count_nonzero(shows & (of_other < _CLEARLY * of_plane))),
    )


def is_ambiguous(task: Task, motion: plane.Motion) -> tuple[bool, float]:
    """Say whether the ground repeats so that another likely motion explains the pictures as well.

    Beside that, how many heights a second the slowest of those is that do so and were left out as too fast; 0: none.
    """
    left_out = []
    focal = np.array([task.camera.fx, task.camera.fy])
    moved = motion.moved_px()
    for period in _periods(task.prev, task.mask):
        for sign in (1.0, -1.0):
            way = motion.values[:2] - sign * period / focal / max(float(task.interval.down[2]), 0.2)
            start = [*way.tolist(), *motion.values[2:].tolist()]
            other = task.follower.motion(task.interval, start, task.covariance, levels=1)
            if other is None or np.hypot(*(other.moved_px() - moved)) < 0.5 * np.hypot(*period):
                continue
            if other.count < _AS_MANY * motion.count or other.residual > _AS_WELL * motion.residual + 0.1:
                continue
            likely = [np.hypot(*m.values[:2]) < task.likely for m in (motion, other)]
            if likely[1] or not likely[0]:
                return True, 0.0
            left_out.append(float(np.hypot(*other.values[:2])) / task.interval.dt_s)
    return False, min(left_out, default=0.0)


def _periods(image: NDArray[Any], mask: NDArray[np.bool_] | None) -> list[F64]:
    """Displacements, in pixels, at which a picture looks like itself; none for most."""
    import cv2

    height, width = image.shape
    factor = max(1.0, width / _WIDTH)
    frame = image.astype(np.float32)
    known = np.isfinite(frame) if mask is None else mask & np.isfinite(frame)
    if not known.all():
        frame = np.where(known, frame, np.float32(frame[known].mean(dtype=np.float64) if known.any() else 0.0))
    # Squares of what float32 holds are more than it holds.
    frame /= max(float(np.abs(frame).max()), 1e-30)
    if factor > 1.0:
        frame = cv2.resize(frame, (round(width / factor), round(height / factor)), interpolation=cv2.INTER_AREA)
    frame = frame - cv2.GaussianBlur(frame, (0, 0), 8.0)
    rows, columns = frame.shape
    size = (2 * rows, 2 * columns)
    found = np.fft.irfft2(np.abs(np.fft.rfft2(frame, size)) ** 2, size)
    # Of as many pixels as overlap.
    counts = np.fft.irfft2(np.abs(np.fft.rfft2(np.ones_like(frame), size)) ** 2, size)
    half = (rows // 2, columns // 2)

    def middle(of: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([of[-half[0] :, : half[1]], of[: half[0], : half[1]]])

    shown = middle(found) / np.maximum(middle(counts), 1.0) / max(float(found[0, 0] / counts[0, 0]), 1e-12)
    shown = shown.astype(np.float32)
    peak = (shown == cv2.dilate(shown, np.ones((5, 5), np.uint8))) & (shown > _REPEATS)
    y, x = np.nonzero(peak)
    y = y - half[0]
    far = (np.hypot(x, y) > _FROM) & (x < half[1] - 2) & (np.abs(y) < half[0] - 2)
    # Each and its opposite are one.
    far &= (x > 0) | (y > 0)
    x, y = x[far], y[far]
    order = np.argsort(-shown[y + half[0], x])[:4]
    return [np.array([x[k], y[k]], dtype=np.float64) * factor for k in order]
