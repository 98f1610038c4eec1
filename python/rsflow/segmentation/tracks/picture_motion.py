"""How far each thing went by its own picture: samples of it are laid over the next frame.

Dense flow inside of a small thing is often that of the ground around it. Samples that lie on the thing alone, begun
from where it is expected, are not drawn to the ground.

docs/explanation/algorithms.md, section "Things that move: ObjectTracker".
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from .regions_seen import SAMPLES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .followed import Followed
    from .regions_seen import Regions

    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

# Steps of Gauss and Newton, and the longest of each in pixels.
_STEPS, _LONGEST_PX, _CONVERGED_PX = 4, 1.5, 0.01
# Of so many samples one is looked at to choose where to begin.
_SKIPPED = 3
# Samples that are off by more than so many deviations do not count; the deviation is at least so many levels of 256.
_OUTLIER, _LEAST_LEVELS = 3.0, 1.5
# So many samples, and so much of them, must lie on what moves.
_LEAST_SAMPLES, _LEAST_SHARE = 12, 0.4
# Samples so near to a thing's outline show what is around it too.
_CORE_PX, _RIM_WEIGHT = 2, 0.5
# Samples so near tell the same: so many count as one.
_ALIKE = 6.0
# Deviation that no number of samples falls below: in pixels, and as a share of the motion.
_LEAST_PX, _SPEED_SHARE = 0.03, 0.01
# A motion that is less sure than this share of the thing's size, or these pixels, tells nothing.
_UNSURE_PX = 1.0


@dataclasses.dataclass
class Ridden:
    """What the pictures of the things say of a frame; NaN and infinite variance where they say nothing.

    Attributes
    ----------
    motion, variance : (n, 2) float64
        Since the frame before, against the still surroundings, in pixels.
    contrast : (n,) float64
        Deviation of its levels, or root of the mean square of what they are off at rest if that is larger.
    """

    motion: F64
    variance: F64
    contrast: F64


@dataclasses.dataclass
class _Samples:
    """Samples of some things, (n, s) each: weight, place, level, and how that changes along x and y."""

    weight: F64
    x: F64
    y: F64
    level: F64
    gx: F64
    gy: F64

    def some(self, every: int) -> _Samples:
        """Give one of so many samples."""
        return _Samples(*(getattr(self, item.name)[:, ::every] for item in dataclasses.fields(self)))


def smoothed(image: NDArray[Any]) -> NDArray[np.float32]:
    """Give a frame in levels of 256, lightly smoothed, with what is not finite as 0."""
    import cv2

    if image.dtype == np.uint8:
        return np.asarray(cv2.GaussianBlur(image, (5, 5), 1.0), np.float32)
    levels = np.nan_to_num(np.asarray(image, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    if image.dtype == np.uint16:
        levels = levels / np.float32(257)
    return np.asarray(cv2.GaussianBlur(levels, (5, 5), 1.0), np.float32)


def ride(
    things: Followed, regions: Regions, region: NDArray[np.intp], levels: NDArray[np.float32] | None, steps: float
) -> Ridden:
    """Lay the samples of each thing over the frame at hand.

    `region` is that of each thing, -1 for none. The things are where they are predicted.
    """
    count = len(things)
    out = Ridden(np.full((count, 2), np.nan), np.full((count, 2), np.inf), np.zeros(count))
    who = np.flatnonzero((things.patch[:, :, 0] > 0).sum(axis=1) >= _LEAST_SAMPLES)
    if levels is None or not len(who):
        return out
    samples = _Samples(*np.moveaxis(things.patch[who].astype(np.float64), 2, 0))
    on_thing = regions.labels > 0
    start = _best_start(things, regions, region, who, samples, levels, on_thing, steps)
    motion, off, weight, spread = _registered(start, samples, levels, on_thing)
    _, inverse, solvable = _normal(samples, weight, off)
    variance = np.stack([inverse[:, 0], inverse[:, 2]], axis=1) * (_ALIKE * spread * spread)[:, None]
    inside = (weight > 0).sum(axis=1)
    far = np.hypot(*(motion - start).T) > np.maximum(2.0, 0.25 * things.size[who].max(axis=1))
    known = solvable & ~far & (variance.max(axis=1) <= _UNSURE_PX**2)
    known &= (samples.weight * (weight > 0)).sum(axis=1) >= _LEAST_SHARE * samples.weight.sum(axis=1)
    known &= inside >= _LEAST_SAMPLES
    speed = np.hypot(*motion.T)[:, None]
    out.motion[who] = np.where(known[:, None], motion, np.nan)
    out.variance[who] = np.where(known[:, None], variance + _LEAST_PX**2 + (_SPEED_SHARE * speed) ** 2, np.inf)
    still, seen = _off(np.zeros_like(motion), samples, levels, None)
    still, own = still - _middle(still, seen), samples.level - _middle(samples.level, samples.weight > 0)
    out.contrast[who] = np.sqrt(
        np.maximum(_mean(own * own, samples.weight), _mean(still * still, samples.weight * seen))
    )
    return out


def _mean(values: F64, weight: F64) -> F64:
    return np.asarray((weight * values).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9))


def _best_start(
    things: Followed,
    regions: Regions,
    region: NDArray[np.intp],
    who: NDArray[np.intp],
    samples: _Samples,
    levels: NDArray[np.float32],
    on_thing: Mask,
    steps: float,
) -> F64:
    """Give of several motions for each thing the one that its samples fit best."""
    predicted = things.velocity[who] * steps
    own = region[who]
    has = own >= 0
    to_region, by_flow = predicted.copy(), predicted.copy()
    before = things.place[who] - predicted
    to_region[has] = regions.centre[own[has]] - before[has]
    flow = regions.motion[own[has]]
    by_flow[has] = np.where(np.isfinite(flow), flow, predicted[has])
    some = samples.some(_SKIPPED)
    starts = np.stack([predicted, np.zeros_like(predicted), to_region, by_flow])
    costs = np.empty(starts.shape[:2])
    for number, start in enumerate(starts):
        off, seen = _off(start, some, levels, on_thing)
        weight = some.weight * seen
        total = weight.sum(axis=1)
        cost = (weight * np.abs(off - _middle(off, seen))).sum(axis=1) / np.maximum(total, 1e-9)
        costs[number] = np.where(total >= _LEAST_SHARE * some.weight.sum(axis=1), cost, np.inf)
    best = np.argmin(costs, axis=0)
    return np.asarray(starts[best, np.arange(len(who))])


def _registered(
    start: F64, samples: _Samples, levels: NDArray[np.float32], on_thing: Mask
) -> tuple[F64, F64, F64, F64]:
    """Refine motions; give them, what is off with them, the weights of the samples, and the deviation."""
    motion, length = start.copy(), np.full(len(start), np.inf)
    for step in range(_STEPS + 1):
        off, seen = _off(motion, samples, levels, on_thing)
        seen &= samples.weight > 0
        off = off - _middle(off, seen)
        spread = np.maximum(1.4826 * _middle(np.abs(off), seen)[:, 0], _LEAST_LEVELS)
        share = off / (_OUTLIER * spread)[:, None]
        weight = samples.weight * seen * np.clip(1 - share * share, 0, None) ** 2
        if step == _STEPS or length.max(initial=0.0) < _CONVERGED_PX:
            break
        pull, _, _ = _normal(samples, weight, off)
        length = np.hypot(*pull.T)
        pull *= np.minimum(1.0, _LONGEST_PX / np.maximum(length, 1e-9))[:, None]
        motion -= pull
    return motion, off, weight, spread


def _normal(samples: _Samples, weight: F64, off: F64) -> tuple[F64, F64, Mask]:
    """Give the solution of the normal equations, their inverse as xx, xy and yy, and where there is one."""
    total = np.maximum(weight.sum(axis=1), 1e-9)
    gx = samples.gx - ((weight * samples.gx).sum(axis=1) / total)[:, None]
    gy = samples.gy - ((weight * samples.gy).sum(axis=1) / total)[:, None]
    xx, xy, yy = ((weight * one * other).sum(axis=1) for one, other in ((gx, gx), (gx, gy), (gy, gy)))
    bx, by = (weight * gx * off).sum(axis=1), (weight * gy * off).sum(axis=1)
    more = 1e-3 * (xx + yy) + 1e-6
    xx, yy = xx + more, yy + more
    determinant = xx * yy - xy * xy
    inverse = np.stack([yy, -xy, xx], axis=1) / determinant[:, None]
    pull = np.stack([inverse[:, 0] * bx + inverse[:, 1] * by, inverse[:, 1] * bx + inverse[:, 2] * by], axis=1)
    return pull, inverse, np.asarray(xx + yy > 1e-3)


def _off(motion: F64, samples: _Samples, levels: NDArray[np.float32], among: Mask | None) -> tuple[F64, Mask]:
    """Give how much the levels at the samples' new places are off, and which places count."""
    high, wide = levels.shape
    x, y = samples.x + motion[:, :1], samples.y + motion[:, 1:]
    inside = (x >= 0) & (x <= wide - 1) & (y >= 0) & (y <= high - 1)
    x, y = np.clip(np.nan_to_num(x), 0, wide - 1), np.clip(np.nan_to_num(y), 0, high - 1)
    left, top = np.minimum(x.astype(np.intp), max(wide - 2, 0)), np.minimum(y.astype(np.intp), max(high - 2, 0))
    right, down = x - left, y - top
    flat, place = levels.reshape(-1), top * wide + left
    beside, below = min(1, wide - 1), wide * min(1, high - 1)
    upper = flat[place] * (1 - right) + flat[place + beside] * right
    lower = flat[place + below] * (1 - right) + flat[place + below + beside] * right
    if among is not None:
        inside &= among[np.rint(y).astype(np.intp), np.rint(x).astype(np.intp)]
    return upper * (1 - down) + lower * down - samples.level, inside


def _middle(values: F64, counted: Mask) -> F64:
    """Median of the values that count in each row, (n, 1); 0 where none does."""
    order = np.sort(np.where(counted, values, np.inf), axis=1)
    count = counted.sum(axis=1)
    found = order[np.arange(len(order)), np.maximum(count - 1, 0) // 2]
    return np.asarray(np.where(count > 0, found, 0.0)[:, None])


def go_along(things: Followed, ridden: Ridden, shift: F64) -> None:
    """Take the samples to where they are now; `shift` is how far things have gone whose samples do not say."""
    moved = np.where(np.isfinite(ridden.motion), ridden.motion, shift)
    things.patch[:, :, 1] += moved[:, :1]
    things.patch[:, :, 2] += moved[:, 1:]


def sampled(regions: Regions, own: NDArray[np.intp], levels: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """Give samples of some regions by number, as `Followed.patch` has them; none without a picture."""
    rows, columns = np.broadcast_arrays(regions.rows[own][:, :, None], regions.columns[own][:, None, :])
    rows, columns = rows.reshape(len(own), SAMPLES), columns.reshape(len(own), SAMPLES)
    out = np.zeros((*rows.shape, 6), np.float32)
    if levels is None:
        return out
    high, wide = levels.shape
    inside = regions.inside[own]
    label, core = regions.label[own][:, None], inside.copy()
    for down, right in ((0, _CORE_PX), (0, -_CORE_PX), (_CORE_PX, 0), (-_CORE_PX, 0)):
        y, x = np.clip(rows + down, 0, high - 1), np.clip(columns + right, 0, wide - 1)
        core &= regions.labels[y, x] == label
    # Of a small region some places are taken twice.
    count = np.maximum(inside.sum(axis=1), 1)
    out[:, :, 0] = inside * np.where(core, 1.0, _RIM_WEIGHT) * np.minimum(1.0, regions.area[own] / count)[:, None]
    out[:, :, 1], out[:, :, 2] = columns, rows
    out[:, :, 3] = levels[rows, columns]
    out[:, :, 4] = (levels[rows, np.minimum(columns + 1, wide - 1)] - levels[rows, np.maximum(columns - 1, 0)]) / 2
    out[:, :, 5] = (levels[np.minimum(rows + 1, high - 1), columns] - levels[np.maximum(rows - 1, 0), columns]) / 2
    return out
