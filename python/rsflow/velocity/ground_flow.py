"""Points of the ground followed from one frame to the next, as the velocity needs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..shift import estimate_shift
from ..tracking import detect_corners, track_points

F64 = NDArray[np.float64]
# Takes pixels (N, 2) of the first frame and gives where a rotation alone puts them in the second; NaN behind.
Turned = Callable[[F64], F64]

# The seed for large motion is found on pictures of at most this width: finer ones only cost time.
_SEED_WIDTH = 320
# Deviation in pixels that a point's covariance is raised by: sampling, quantisation and the shape of the pixel leave
# errors of this size that the residual of a window does not show.
_FLOOR_PX = 0.004
# A pixel made of several counts where all of them do, up to rounding.
_WHOLE = 0.999


@dataclass(frozen=True)
class GroundFlow:
    """Points that were followed, in pixels, with the covariance (N, 2, 2) of their displacement.

    `deformed` says which were followed with a window that turns and grows, so that the displacement is the point's own.
    `offered` counts the points that were looked for and should be inside the second picture; `related` says whether
    the whole pictures could be laid over each other.
    """

    before: F64
    after: F64
    covariance: F64
    deformed: NDArray[np.bool_]
    window: int
    offered: int
    related: bool

    def only(self, which: NDArray[np.bool_]) -> GroundFlow:
        """Keep the points where `which` is True."""
        return replace(
            self,
            before=self.before[which],
            after=self.after[which],
            covariance=self.covariance[which],
            deformed=self.deformed[which],
        )

    def moved(self, to: F64) -> GroundFlow:
        """Put the same displacements at other places of the first frame."""
        return replace(self, before=to, after=to + (self.after - self.before))


def window_for(shape: tuple[int, ...]) -> int:
    """Side of the windows: 21 pixels, less in pictures that hold only a few of these."""
    return int(np.clip((min(shape) // 5) | 1, 9, 21))


def follow(
    prev: NDArray[Any], after: NDArray[Any], turned: Turned | None, mask: NDArray[np.bool_] | None = None
) -> GroundFlow:
    """Find points in `prev` and follow them into `after`.

    Parameters
    ----------
    prev, after : (height, width)
        Frames of one size.
    turned : callable or None
        Takes pixels (N, 2) of `prev` and gives where the known rotation alone puts them; None without a rotation.
    mask : (height, width) bool, optional
        Pixels that count, of either frame.
    """
    window = window_for(prev.shape)
    corners = detect_corners(prev, max_corners=400, quality=0.002, min_distance=max(6, window // 2), mask=mask)
    points = np.asarray(corners, dtype=np.float64)
    if len(points) == 0:
        return GroundFlow(points, points, np.zeros((0, 2, 2)), np.zeros(0, np.bool_), window, 0, True)
    seed, related = _seed(prev, after, turned, mask)
    start = points + seed if turned is None else _or_given(turned(points + seed), points)
    height, width = prev.shape
    expected = ((start >= 0) & (start <= (width - 1, height - 1))).all(axis=1)
    points, start = points[expected], start[expected]
    if len(points) == 0:
        return GroundFlow(points, points, np.zeros((0, 2, 2)), np.zeros(0, np.bool_), window, 0, related)
    tracks = track_points(
        prev,
        after,
        points.astype(np.float32),
        window_size=window,
        initial=start.astype(np.float32),
        mask=mask,
        next_mask=mask,
    )
    good = np.asarray(tracks.valid)
    covariance = np.asarray(tracks.covariance, dtype=np.float64)[good] + _FLOOR_PX**2 * np.eye(2)
    before = points[good].astype(np.float32).astype(np.float64)
    return GroundFlow(
        before,
        np.asarray(tracks.points, dtype=np.float64)[good],
        covariance,
        np.asarray((tracks.deformation[good] != np.eye(2, dtype=np.float32)).any(axis=(1, 2))),
        window,
        int(expected.sum()),
        related,
    )


def _or_given(pixels: F64, given: F64) -> F64:
    """`pixels`, or `given` where they are not known."""
    return np.where(np.isfinite(pixels), pixels, given)


def _seed(
    prev: NDArray[Any], after: NDArray[Any], turned: Turned | None, mask: NDArray[np.bool_] | None
) -> tuple[F64, bool]:
    """Find where the picture went as a whole before it turned, in pixels, and whether there is such a thing."""
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
    if not shift.valid:
        return np.zeros(2), False
    return np.array([shift.dx, shift.dy]) * scale, True


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


def overlap(points: F64, window: int) -> F64:
    """Share of the window's pixels that each pair of points has in common, (N, N)."""
    apart = np.abs(points[:, None, :] - points[None, :, :]) / window
    return np.asarray(np.prod(np.clip(1.0 - apart, 0.0, None), axis=2), dtype=np.float64)


def centers(frame: NDArray[Any], points: F64, window: int, mask: NDArray[np.bool_] | None = None) -> F64:
    """Where in its window each point's displacement was really measured, (N, 2), in pixels of the frame.

    A window that grows or turns between the frames does not have one displacement. The least squares of Lucas and
    Kanade then give the one at a mean of its pixels, weighted by the gradients after gain and offset were taken out of
    them: with g these gradients, (sum g g')^-1 sum g g' x for a growth. It can lie several pixels off the middle.
    Pixels that `mask` leaves out, and gradients made of them, count for nothing.
    """
    height, width = frame.shape
    half = window // 2
    steps = np.arange(-half, half + 1)
    column = np.clip(np.rint(points[:, 0]).astype(int)[:, None] + steps, 1, width - 2)
    row = np.clip(np.rint(points[:, 1]).astype(int)[:, None] + steps, 1, height - 2)
    image = frame.astype(np.float32)
    gradients = np.stack([0.5 * (image[:, 2:] - image[:, :-2])[1:-1], 0.5 * (image[2:] - image[:-2])[:, 1:-1]])
    at = (row[:, :, None] - 1, column[:, None, :] - 1)
    count = window * window
    g = gradients[:, *at].reshape(2, len(points), count)
    level = image[1:-1, 1:-1][at].reshape(len(points), count)
    if mask is None:
        free = g - g.mean(axis=2, keepdims=True)
        level = level - level.mean(axis=1, keepdims=True)
    else:
        # A gradient is of five pixels.
        whole = mask[1:-1, 1:-1] & mask[1:-1, 2:] & mask[1:-1, :-2] & mask[2:, 1:-1] & mask[:-2, 1:-1]
        counts = whole[at].reshape(len(points), count)
        share = 1.0 / np.maximum(counts.sum(axis=1), 1)
        g, level = np.where(counts, g, 0), np.where(counts, level, 0)
        free = np.where(counts, g - (g.sum(axis=2) * share)[..., None], 0)
        level = np.where(counts, level - (level.sum(axis=1) * share)[:, None], 0)
    share = np.einsum("knp,np->kn", free, level) / np.maximum(np.einsum("np,np->n", level, level), 1e-6)
    free = free - share[:, :, None] * level
    x = np.stack(
        [
            np.broadcast_to((column[:, None, :] - points[:, 0, None, None]), (len(points), window, window)),
            np.broadcast_to((row[:, :, None] - points[:, 1, None, None]), (len(points), window, window)),
        ]
    )
    x = x.reshape(2, len(points), count).astype(np.float32)
    structure = np.einsum("inp,jnp->nij", free, g).astype(np.float64)
    moment = np.einsum("inp,jnp,jnp->ni", free, g, x).astype(np.float64)
    determinant = np.linalg.det(structure)
    safe = determinant > 1e-6 * np.maximum(np.trace(structure, axis1=1, axis2=2) ** 2, 1e-12)
    offset = np.zeros((len(points), 2))
    offset[safe] = np.linalg.solve(structure[safe], moment[safe][:, :, None])[:, :, 0]
    # A mean of the window's pixels cannot lie outside of it; weights that are not positive could say so.
    return np.asarray(points + np.clip(offset, -half, half), dtype=np.float64)
