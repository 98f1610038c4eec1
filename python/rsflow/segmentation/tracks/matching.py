"""Which region belongs to which thing: one each, several to one that is torn, one to several that have merged."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from .assignment import assign

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .followed import Followed
    from .regions_seen import Regions

    F64 = NDArray[np.float64]

# The most that a pair may cost, in squared deviations of two components (99.97 %).
_MOST = 16.0
# Deviation of a region's centre, as a share of the thing's size: limbs, holes and shadows come and go.
_CENTRE_SHARE = 0.25
# And as a share of its speed: it may turn.
_TURN_SHARE = 0.3
# A thing's width and height change by a factor of e^0.5 from one frame to another as easily as its centre by a
# deviation; more than this each never counts, as parts of it may be missing.
_SIZE_DEVIATION = 0.5
_MOST_SIZE = 4.0
# What is cut off by the picture's border still shows so many pixels.
_LEAST_SIZE = 1.0
# Likewise its motion, in pixels and as a share of itself, and its grey levels (squared Hellinger distance).
_MOTION_PX, _MOTION_SHARE = 1.0, 0.3
_MOST_MOTION = 4.0
_GREY = 0.06
_MOST_GREY = 9.0
# A piece belongs to a thing if so much of its box lies in the thing's, which may be so much larger than predicted.
_PIECE_INSIDE = 0.7
_PIECE_MARGIN = 0.15
_TORN_SIZE = 1.35
# A thing may be in a region with others if so much of its predicted box is in the region's.
_COVERED = 0.5


@dataclasses.dataclass
class Matches:
    """Whose the regions are.

    Attributes
    ----------
    region : (n,) int
        The region of each thing, -1 for none.
    pieces : dict of int to list of int
        By thing, further regions that are parts of it.
    shared : dict of int to list of int
        By region, all the things in it, where these are several.
    left : list of int
        Regions that belong to none.
    split : dict of int to int
        By region, the thing that a part of another one has become.
    """

    region: NDArray[np.intp]
    pieces: dict[int, list[int]]
    shared: dict[int, list[int]]
    left: list[int]
    split: dict[int, int] = dataclasses.field(default_factory=dict)


def overlaps(a: F64, b: F64) -> F64:
    """Area that boxes (n, 4) share with boxes (m, 4)."""
    width = np.minimum(a[:, None, 2], b[None, :, 2]) - np.maximum(a[:, None, 0], b[None, :, 0])
    height = np.minimum(a[:, None, 3], b[None, :, 3]) - np.maximum(a[:, None, 1], b[None, :, 1])
    return np.asarray(np.clip(width, 0, None) * np.clip(height, 0, None))


def boxes_of(place: F64, size: F64) -> F64:
    """Boxes around places."""
    return np.concatenate([place - size / 2, place + size / 2], axis=1)


def match(things: Followed, regions: Regions, lasting: NDArray[np.bool_], shape: tuple[int, int]) -> Matches:
    """Find whose each region is; only `lasting` things may be within others' regions."""
    count = len(things)
    region = np.full(count, -1, np.intp)
    every = list(range(len(regions)))
    if not count or not every:
        return Matches(region, {}, {}, every)
    for row, column in assign(_cost(things, regions, shape), _MOST):
        region[row] = column
    predicted = boxes_of(things.place, things.size)
    taken = set(region[region >= 0].tolist())
    left = [number for number in every if number not in taken]
    pieces: dict[int, list[int]] = {}
    if left:
        pieces, left = _pieces(things, regions, region, predicted, left)
    shared: dict[int, list[int]] = {}
    ahead = things.place + things.velocity
    inside = ((ahead >= 0) & (ahead <= (shape[1] - 1, shape[0] - 1))).all(axis=1)
    lost = np.flatnonzero((region < 0) & lasting & inside)
    if len(lost):
        shared = _shared(things, regions, region, predicted, lost)
        left = [number for number in left if number not in shared]
        # One that is in a region by itself has it, however large it was thought to be.
        for number in [number for number, members in shared.items() if len(members) == 1]:
            region[shared.pop(number)[0]] = number
    return Matches(region, pieces, shared, left)


def visible(place: F64, size: F64, shape: tuple[int, int]) -> tuple[F64, F64]:
    """Give place and size of what the picture shows of things: its border cuts some off."""
    box = boxes_of(place, size) + 0.5
    limits = np.array([shape[1], shape[0]], np.float64)
    low, high = np.clip(box[:, :2], 0, limits - _LEAST_SIZE), np.clip(box[:, 2:], _LEAST_SIZE, limits)
    high = np.maximum(high, low + _LEAST_SIZE)
    return place + (low + high - box[:, :2] - box[:, 2:]) / 2, high - low


def _cost(things: Followed, regions: Regions, shape: tuple[int, int]) -> F64:
    """Give what it costs that a region is a thing's, in squared deviations."""
    place, size = visible(things.place, things.size, shape)
    off = regions.centre[None] - place[:, None]
    speed = np.hypot(things.velocity[:, 0], things.velocity[:, 1])[:, None, None]
    wide = (
        things.variance[:, None, :, 0] + (_CENTRE_SHARE * things.size[:, None] + 0.5) ** 2 + (_TURN_SHARE * speed) ** 2
    )
    cost = (off * off / wide).sum(axis=2)
    change = np.log(regions.size[None] / size[:, None]) / _SIZE_DEVIATION
    cost += np.minimum(change * change, _MOST_SIZE).sum(axis=2)
    known: NDArray[np.bool_] = np.logical_and(things.informed[:, None], np.isfinite(regions.motion[None, :, 0]))
    if known.any():
        other = np.nan_to_num(regions.motion)[None] - things.velocity[:, None]
        spread = things.variance[:, None, :, 2] + (_MOTION_PX + _MOTION_SHARE * speed) ** 2
        cost += np.where(known, np.minimum((other * other / spread).sum(axis=2), _MOST_MOTION), 0.0)
    if regions.histogram.any():
        alike = (np.sqrt(things.histogram)[:, None] * np.sqrt(regions.histogram)[None]).sum(axis=2)
        cost += np.where(things.histogram.sum(axis=1)[:, None] > 0, np.minimum((1 - alike) / _GREY, _MOST_GREY), 0.0)
    return np.asarray(cost)


def _pieces(
    things: Followed, regions: Regions, region: NDArray[np.intp], predicted: F64, left: list[int]
) -> tuple[dict[int, list[int]], list[int]]:
    """Give regions that lie in the box of a thing to it: it is torn."""
    owners = np.flatnonzero(region >= 0)
    pieces: dict[int, list[int]] = {}
    if not len(owners):
        return pieces, left
    margin = _PIECE_MARGIN * things.size[owners] + 1
    wide = predicted[owners] + np.concatenate([-margin, margin], axis=1)
    boxes = regions.box[left]
    inside = overlaps(wide, boxes) / (regions.size[left].prod(axis=1))[None]
    others = []
    whole = {int(owner): regions.box[region[owner]] for owner in owners}
    for number, column in zip(left, range(len(left)), strict=True):
        best = int(np.argmax(inside[:, column]))
        owner = int(owners[best])
        joined = _union(whole[owner], regions.box[number])
        fits = (joined[2:] - joined[:2] <= _TORN_SIZE * things.size[owner] + 2).all()
        if inside[best, column] >= _PIECE_INSIDE and fits:
            pieces.setdefault(owner, []).append(number)
            whole[owner] = joined
        else:
            others.append(number)
    return pieces, others


def _union(a: F64, b: F64) -> F64:
    return np.concatenate([np.minimum(a[:2], b[:2]), np.maximum(a[2:], b[2:])])


def _shared(
    things: Followed, regions: Regions, region: NDArray[np.intp], predicted: F64, lost: NDArray[np.intp]
) -> dict[int, list[int]]:
    """Find the regions that things without one have merged into."""
    area = np.maximum(things.size[lost].prod(axis=1), 1)
    covered = overlaps(predicted[lost], regions.box) / area[:, None]
    shared: dict[int, list[int]] = {}
    for row, thing in enumerate(lost):
        number = int(np.argmax(covered[row]))
        if covered[row, number] < _COVERED:
            continue
        if number not in shared:
            shared[number] = np.flatnonzero(region == number).tolist()
        shared[number].append(int(thing))
    return {number: sorted(members) for number, members in shared.items()}
