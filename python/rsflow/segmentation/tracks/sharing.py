"""Whose pixel is whose in a region that several things share, and whether a thing is two."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .followed import Followed
    from .regions_seen import Regions

    F64 = NDArray[np.float64]

# A region is divided on a grid of about so many places.
_PLACES = 10_000
# Motion tells things in a region apart if they differ by so many pixels per frame, and counts at most so much beside
# the place, which counts 1 at the rim of a thing.
_DIFFERENT_PX = 0.7
_MOST_MOTION = 3.0


def divide(
    things: Followed, regions: Regions, number: int, members: list[int], motion: NDArray[np.floating] | None
) -> tuple[NDArray[np.intp], tuple[slice, slice]]:
    """Say for each pixel of a region's box which of its members it belongs to, -1 where the region is not.

    A pixel is that thing's whose place and motion it fits best.
    """
    left, top, right, bottom = (int(edge) for edge in regions.box[number])
    step = max(1, int(np.sqrt((right - left) * (bottom - top) / _PLACES)))
    window = np.s_[top:bottom:step, left:right:step]
    inside = regions.labels[window] == regions.label[number]
    y = np.arange(top, bottom, step)[:, None]
    x = np.arange(left, right, step)[None]
    half = np.maximum(things.size[members] / 2, 1)
    place, velocity = things.place[members], things.velocity[members]
    misfit = np.stack([((x - px) / w) ** 2 + ((y - py) / h) ** 2 for (px, py), (w, h) in zip(place, half, strict=True)])
    apart = velocity[:, None] - velocity[None]
    if motion is not None and np.hypot(apart[..., 0], apart[..., 1]).max() > _DIFFERENT_PX:
        seen = np.asarray(motion[window], np.float64)
        spread = (0.25 * np.hypot(apart[..., 0], apart[..., 1]).max() + 0.5) ** 2
        off = ((seen[None] - velocity[:, None, None]) ** 2).sum(axis=3) / spread
        misfit += np.where(np.isfinite(off), np.minimum(off, _MOST_MOTION), 0.0)
    whose = np.where(inside, np.argmin(misfit, axis=0), -1)
    if step > 1:
        whose = np.repeat(np.repeat(whose, step, axis=0), step, axis=1)[: bottom - top, : right - left]
        whose[regions.labels[top:bottom, left:right] != regions.label[number]] = -1
    return whose, (slice(top, bottom), slice(left, right))


# Two parts are two things' if each has so much of the area.
_LEAST_PART = 0.25
# Or so much, if it is as long as this share of the other one: a foot is not, a thing beside a larger one is.
_LONG_PART, _LONG = 0.08, 0.6
# Beside each other are parts that share so much of the lower one's height and are taller than wide, as people are;
# others are mostly one thing that is torn.
_BESIDE = 0.5
_BESIDE_COUNTS, _OTHER_COUNTS = 1.0, 0.25
# Others must be so far apart, of the smaller one's size.
_GAP = 0.25
# A region has a neck where a column has fewer of its pixels than this share of the fullest on either side.
_NECK = 0.45
# Narrower regions, in pixels, show none.
_NARROWEST = 16
# Two halves move as two things do if most of the change lies between them: of a thing that turns or grows a third.
_SUDDEN = 0.6
# So much must differ, in pixels per frame, and so many of a strip's samples must be known.
_LEAST_PX, _LEAST_KNOWN = 0.3, 6
_STRIPS = 4
_SAMPLES = 16


def parted(first: F64, second: F64, areas: tuple[float, float]) -> float:
    """Say how much two boxes, each of a part of this area, look like two things': 0 not at all."""
    gap = np.maximum(first[:2], second[:2]) - np.minimum(first[2:], second[2:])
    sizes = first[2:] - first[:2], second[2:] - second[:2]
    long = sorted(float(size.max()) for size in sizes)
    if min(areas) < (_LONG_PART if long[0] >= _LONG * long[1] else _LEAST_PART) * sum(areas):
        return 0.0
    upright = all(size[1] > size[0] for size in sizes)
    if upright and gap[0] >= 0 and -gap[1] >= _BESIDE * min(size[1] for size in sizes):
        return _BESIDE_COUNTS
    return _OTHER_COUNTS if gap.max() >= _GAP * min(size.max() for size in sizes) else 0.0


def necked(regions: Regions, number: int) -> tuple[float, F64]:
    """Say how much a region looks like two upright things beside each other that touch, and give their boxes."""
    none = 0.0, np.zeros((2, 4))
    left, top, right, bottom = (int(edge) for edge in regions.box[number])
    width = right - left
    if width < _NARROWEST or width > 2 * (bottom - top):
        return none
    inside = regions.labels[top:bottom, left:right] == regions.label[number]
    column = inside.sum(axis=0)
    middle = column[width // 4 : -(width // 4)]
    place = width // 4 + int(np.argmin(middle))
    sides = column[:place].max(), column[place + 1 :].max()
    if column[place] > _NECK * min(sides):
        return none
    boxes = np.zeros((2, 4))
    areas = []
    for part, (start, stop) in enumerate(((0, place), (place, width))):
        rows = np.flatnonzero(inside[:, start:stop].any(axis=1))
        boxes[part] = left + start, top + rows[0], left + stop, top + rows[-1] + 1
        areas.append(float(column[start:stop].sum()))
    looks = parted(boxes[0], boxes[1], (areas[0], areas[1]))
    return (looks, boxes) if looks >= _BESIDE_COUNTS else none


def halves(regions: Regions, number: int, motion: NDArray[np.floating]) -> F64:
    """Motion of the right half of a region against its left one, and of the lower against the upper one: (2, 2).

    Zero where it does not change from one half to the other, or changes evenly as that of what turns or grows.
    """
    out = np.zeros((2, 2))
    left, top, right, bottom = (int(edge) for edge in regions.box[number])
    steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    x, y = (left + steps * (right - left)).astype(np.intp), (top + steps * (bottom - top)).astype(np.intp)
    place = np.ix_(y, x)
    seen = np.where((regions.labels[place] == regions.label[number])[..., None], motion[place], np.nan)
    for axis, turned in enumerate((seen.transpose(1, 0, 2), seen)):
        strips = turned.reshape(_STRIPS, -1, 2)
        known = np.isfinite(strips[..., 0])
        count = known.sum(axis=1)
        if (count < _LEAST_KNOWN).any():
            continue
        # What is not known comes last.
        order = np.sort(np.where(known[..., None], strips, np.inf), axis=1)
        medians = order[np.arange(_STRIPS), (count - 1) // 2]
        change = medians[2] - medians[1]
        whole = medians[3] - medians[0]
        far = float(np.hypot(*change))
        if far >= _LEAST_PX and far >= _SUDDEN * float(np.hypot(*whole)) and change @ whole > 0:
            out[axis] = medians[2:].mean(axis=0) - medians[:2].mean(axis=0)
    return out
