"""Where to begin: the picture's shift as a whole, and points followed by themselves.

They are asked where the motion before does not lead on: at the first frames, after a jump, and where the picture turns
or grows so much that nothing else holds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...shift import ShiftStatus, estimate_shift
from ...tracking import detect_corners, track_points

F64 = NDArray[np.float64]
# Takes pixels (N, 2) of the first frame and gives where a rotation alone puts them in the second; NaN behind.
Turned = Callable[[F64], F64]

# The shift is found on pictures of at most this width: finer ones only cost time.
_SEED_WIDTH = 320
# Deviation in pixels that a point's covariance is raised by: sampling, quantisation and the shape of the pixel leave
# errors of this size that the residual of a window does not show.
_FLOOR_PX = 0.004
# A pixel made of several counts where all of them do, up to rounding.
_WHOLE = 0.999


def followed_points(
    prev: NDArray[Any], after: NDArray[Any], shift: F64, turned: Turned | None, mask: NDArray[np.bool_] | None
) -> F64:
    """Find points in `prev` and follow them into `after`, from a start that is off by no more than a window takes in.

    Returns
    -------
    (N, 7) float64
        x, y in `prev`, x, y in `after`, covariance xx, xy, yy.
    """
    window = int(np.clip((min(prev.shape) // 5) | 1, 9, 21))
    corners = detect_corners(prev, max_corners=300, quality=0.002, min_distance=max(6, window // 2), mask=mask)
    points = np.asarray(corners, dtype=np.float64)
    if len(points) == 0:
        return np.zeros((0, 7))
    start = points + shift
    if turned is not None:
        there = turned(start)
        start = np.where(np.isfinite(there), there, points)
    height, width = prev.shape
    expected = ((start >= 0) & (start <= (width - 1, height - 1))).all(axis=1)
    points, start = points[expected].astype(np.float32), start[expected].astype(np.float32)
    if len(points) == 0:
        return np.zeros((0, 7))
    tracks = track_points(prev, after, points, window_size=window, initial=start, mask=mask, next_mask=mask)
    good = np.asarray(tracks.valid)
    covariance = np.asarray(tracks.covariance, dtype=np.float64)[good] + _FLOOR_PX**2 * np.eye(2)
    spread = covariance.reshape(-1, 4)[:, [0, 1, 3]]
    return np.hstack([points[good].astype(np.float64), tracks.points[good].astype(np.float64), spread])


def whole_shift(
    prev: NDArray[Any],
    after: NDArray[Any],
    turned: Turned | None,
    mask: NDArray[np.bool_] | None,
    longest_px: float,
) -> tuple[F64, ShiftStatus]:
    """Find where the picture went as a whole before it turned, (2,) in pixels, and whether there is such a thing.

    Where it repeats, displacements beyond `longest_px` are left out; what is still ambiguous is told.
    """
    height, width = prev.shape
    factor = max(1.0, width / _SEED_WIDTH)
    size = (round(width / factor), max(1, round(height / factor)))
    scale = np.array([width / size[0], height / size[1]])
    if mask is not None:
        # Rounded weights, and what is no number, reach over pixels that count.
        prev, after = (np.where(mask, frame, frame.dtype.type(0)) for frame in (prev, after))
    if factor > 1.0:
        import cv2

        prev, after = (cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in (prev, after))
        if mask is not None:
            mask = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) > _WHOLE
    roi, mask_after = None, mask
    if turned is not None:
        after = _turned_back(after, scale, turned)
        if mask is not None:
            mask_after = _turned_back(mask.astype(np.float32), scale, turned) > _WHOLE
        # What the turn brought in at the border was never seen.
        x, y = size[0] // 8, size[1] // 8
        roi = (x, y, size[0] - 2 * x, size[1] - 2 * y)
    shift = estimate_shift(prev, after, roi=roi, mask=mask, next_mask=mask_after)
    if shift.status is ShiftStatus.AMBIGUOUS:
        most = max(longest_px / float(scale.max()), 1.0) if np.isfinite(longest_px) else None
        shift = estimate_shift(prev, after, roi=roi, mask=mask, next_mask=mask_after, max_displacement=most)
    return np.array([shift.dx, shift.dy]) * scale, shift.status


def _turned_back(after: NDArray[Any], scale: F64, turned: Turned) -> NDArray[Any]:
    """`after` as it would look without the rotation: near enough for a seed, as the lens is taken for straight."""
    import cv2

    height, width = after.shape
    corners = np.array([(0, 0), (width - 1, 0), (width - 1, height - 1), (0, height - 1)], dtype=np.float64)
    to = (turned((corners + 0.5) * scale - 0.5) + 0.5) / scale - 0.5
    if not np.isfinite(to).all():
        return after
    H = cv2.getPerspectiveTransform(corners.astype(np.float32), to.astype(np.float32))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(after, H, (width, height), flags=flags, borderMode=cv2.BORDER_REFLECT))
