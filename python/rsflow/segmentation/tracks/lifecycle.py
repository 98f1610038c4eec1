"""How things begin, turn out to be two, are listed, and are given up."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from . import sharing
from .followed import HIDDEN, SEEN, Followed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .matching import Matches
    from .measuring import Measured
    from .regions_seen import Regions

    F64 = NDArray[np.float64]

# Deviation of a velocity before it is measured: in pixels, and as a share of the thing's size.
_UNKNOWN_PX, _UNKNOWN_SHARE = 2.0, 0.35
# A thing without a number is forgotten when it is not seen for so many frames.
_PATIENCE_UNLISTED = 2
# A hidden thing is given up when its place is not known to within this share of its size.
_LOST_SHARE = 1.0
# So much must say, frame by frame, that a thing is two; a region is looked at for a neck every
# second frame, and tells this much against it where there is none.
_TWO, _LOOKED_AT, _NO_NECK = 3.0, 2, 0.03
# What begins within this share of a thing's size beside it may be a part of it.
_BESIDE_SHARE = 0.3
# A part of a thing is one of its own when it was seen apart in so many frames more than together; it is none when it
# was together with it in so many more, moving against it by less than this.
_OF_ITS_OWN, _ONE, _AGAINST_PX = 12, 4, 0.7
# A thing goes along with another one in its region if it has less than so much of its area, and they move alike, in
# pixels and as a share of the speed, or it was hardly ever seen alone: a foot swings. After so many frames, and as many
# as it was seen alone before, it is a part of that.
_SMALL, _ALONG_PX, _ALONG_SHARE = 0.35, 0.5, 0.25
_SWALLOWED, _MOST_ALONE = 6, 60
# A thing is looked at where so much of its area is seen.
_WHOLE = 0.6
# Halves are two things when they have moved against each other by so much of their size.
_APART_SHARE = 0.4
# What halves have moved against each other fades by this factor with each look that sees none of it.
_FADES = 0.8
# What moves at less than this share of the thing's speed is what it has left, not another thing.
_LEFT_BEHIND = 0.3


def begin(things: Followed, regions: Regions, numbers: list[int], frame: int, steps: float) -> None:
    """Follow regions that belong to nothing."""
    if not numbers:
        return
    size = regions.size[numbers]
    known = np.isfinite(regions.motion[numbers, 0])
    variance = np.zeros((len(numbers), 2, 3))
    variance[..., 0] = (0.3 + 0.02 * size) ** 2
    unknown = (_UNKNOWN_PX + _UNKNOWN_SHARE * size) ** 2
    measured = regions.motion_variance[numbers] / steps**2 + 0.05**2
    variance[..., 2] = np.where(known[:, None], np.minimum(measured, unknown), unknown)
    things.append(
        len(numbers),
        age=1,
        first=frame,
        state=SEEN,
        informed=known,
        flowing=known,
        place=regions.centre[numbers],
        velocity=np.where(known[:, None], regions.motion[numbers] / steps, 0.0),
        variance=variance,
        size=size,
        area=regions.area[numbers],
        pixels=regions.area[numbers],
        box=regions.box[numbers],
        centre=regions.centre[numbers],
        histogram=regions.histogram[numbers],
        patch=regions.picture[numbers],
        surprise=1.0,
        ground=np.nan,
        motion=np.nan,
        key=things.next_keys(len(numbers)),
        kin=_kin(things, regions, numbers),
    )


def _kin(things: Followed, regions: Regions, numbers: list[int]) -> NDArray[np.int64]:
    """Give the key of the thing beside each region that it may be a part of, 0 for none."""
    kin = np.zeros(len(numbers), np.int64)
    near = np.flatnonzero(things.state == SEEN)
    if not len(near):
        return kin
    box, other = regions.box[numbers][:, None], things.box[near][None]
    gap = np.maximum(np.maximum(box[..., :2], other[..., :2]) - np.minimum(box[..., 2:], other[..., 2:]), 0).max(axis=2)
    best = np.argmin(gap, axis=1)
    beside = gap.min(axis=1) <= _BESIDE_SHARE * things.size[near[best]].max(axis=1)
    kin[beside] = things.key[near[best[beside]]]
    return kin


def fuse(things: Followed, regions: Regions, matches: Matches, frame: int) -> NDArray[np.bool_]:
    """Say which things are to be forgotten: split from another one, and ever since one with it.

    Gathers what says so: that the two are seen as one region without a neck, and do not move against each other.
    """
    gone = np.zeros(len(things), bool)
    together: set[int] = set()
    for number, members in matches.shared.items():
        for first in members:
            for second in members:
                if things.kin[second] == 0 or things.kin[second] != things.key[first]:
                    continue
                together.add(second)
                if things.apart[second] >= _OF_ITS_OWN:
                    continue
                against = np.hypot(*(things.velocity[second] - things.velocity[first]))
                if against > _AGAINST_PX or (len(members) == 2 and sharing.necked(regions, number)[0]):
                    continue
                things.apart[second] -= 1
                if things.apart[second] <= -_ONE:
                    gone[second] = True
                    boxes = np.stack([things.place - things.size / 2, things.place + things.size / 2], axis=1)
                    low = boxes[[first, second], 0].min(axis=0)
                    high = boxes[[first, second], 1].max(axis=0)
                    things.place[first], things.size[first] = (low + high) / 2, high - low
                    things.area[first] += things.area[second]
                    things.parts[first] = -_TWO
    gone |= _swallowed(things, matches)
    seen = (things.kin > 0) & (things.state == SEEN)
    seen[list(together)] = False
    things.apart[seen] = np.minimum(things.apart[seen] + 1, _OF_ITS_OWN)
    return gone


def _swallowed(things: Followed, matches: Matches) -> NDArray[np.bool_]:
    """Say which things go along within a larger one: a foot that was seen before the rest, a part that was torn off."""
    inside = np.zeros(len(things), bool)
    for members in matches.shared.values():
        largest = max(members, key=lambda thing: (things.area[thing], -thing))
        speed = float(np.hypot(*things.velocity[largest]))
        for thing in members:
            against = float(np.hypot(*(things.velocity[thing] - things.velocity[largest])))
            small = things.area[thing] <= _SMALL * things.area[largest]
            alike = against <= max(_ALONG_PX, _ALONG_SHARE * speed) or things.alone[thing] < _OF_ITS_OWN
            inside[thing] = small and alike
    things.within[:] = np.where(inside, things.within + 1, 0)
    return np.asarray(things.within >= _SWALLOWED + np.minimum(things.alone, _MOST_ALONE))


def part(
    things: Followed,
    regions: Regions,
    matches: Matches,
    seen: Measured,
    motion: NDArray[np.floating] | None,
    frame: int,
) -> None:
    """Gather what says that things are two, and split those of which enough does."""
    in_shared = {thing for members in matches.shared.values() for thing in members}
    for thing in range(len(things)):
        number = int(matches.region[thing])
        if number < 0 or thing in in_shared or seen.area[thing] < _WHOLE * things.area[thing]:
            continue
        pieces = matches.pieces.get(thing)
        if pieces:
            piece = max(pieces, key=lambda other: (regions.area[other], -other))
            areas = (float(regions.area[number]), float(regions.area[piece]))
            looks = sharing.parted(regions.box[number], regions.box[piece], areas)
            boxes = regions.box[[number, piece]]
            things.parts[thing] += looks
        elif (things.first[thing] + frame) % _LOOKED_AT == 0:
            looks, boxes = sharing.necked(regions, number)
            things.parts[thing] = _with(things.parts[thing], looks)
            if not looks and motion is not None:
                boxes = _by_motion(things, regions, thing, number, motion)
                looks = float(boxes.any())
                things.parts[thing] += _TWO * looks
        else:
            continue
        if things.parts[thing] >= _TWO and looks:
            _split(things, regions, matches, seen, thing, boxes, frame, torn=looks < 1)


def _with(parts: float, looks: float) -> float:
    """Add what one look says; what said before that it is one fades."""
    if looks or parts < 0:
        return parts + (looks or 0.5)
    return max(parts - _NO_NECK, 0.0)


def _by_motion(things: Followed, regions: Regions, thing: int, number: int, motion: NDArray[np.floating]) -> F64:
    """Give the boxes of two halves that have moved against each other too far for one thing; zeros where none has."""
    against = sharing.halves(regions, number, motion)
    now: NDArray[np.bool_] = np.asarray(against.any(axis=1))
    things.strips[thing] *= np.where(now[:, None], 1.0, _FADES)
    things.strips[thing] += _LOOKED_AT * against
    far = np.hypot(things.strips[thing, :, 0], things.strips[thing, :, 1])
    axis = int(np.argmax(far))
    box = regions.box[number]
    boxes = np.zeros((2, 4))
    if now[axis] and far[axis] > _APART_SHARE * (box[2:] - box[:2]).max():
        boxes[:] = box
        boxes[0, 2 + axis] = boxes[1, axis] = (box[axis] + box[2 + axis]) / 2
    return boxes


def _split(
    things: Followed,
    regions: Regions,
    matches: Matches,
    seen: Measured,
    thing: int,
    boxes: F64,
    frame: int,
    *,
    torn: bool,
) -> None:
    """Let the second of two parts be a thing of its own; where the first may just be torn, for the time being."""
    pieces = matches.pieces.get(thing, [])
    sizes = boxes[:, 2:] - boxes[:, :2]
    centres = (boxes[:, 2:] + boxes[:, :2] - 1) / 2
    # The one that stays is the nearer to where the thing was expected.
    areas = sizes.prod(axis=1)
    areas = areas / areas.sum() * max(seen.area[thing], 1.0)
    motion = things.velocity[thing]
    if pieces:
        other = max(pieces, key=lambda piece: (regions.area[piece], -piece))
        areas[1] = regions.area[other]
        areas[0] = seen.area[thing] - areas[1]
        own = regions.motion[other]
        speed = float(np.hypot(*motion))
        if np.isfinite(own[0]):
            if things.listed[thing] and np.hypot(*own) < _LEFT_BEHIND * speed:
                return
            motion = own
        pieces.remove(other)
        matches.split[other] = len(things)
    row = {name: getattr(things, name)[thing] for name in things.names()}
    row |= {
        "id": 0,
        "age": things.age[thing] + 1,
        "missed": 0,
        "alone": 0,
        "within": 0,
        "place": centres[1],
        "centre": centres[1],
        "velocity": motion,
        "size": sizes[1],
        "area": areas[1],
        "pixels": areas[1],
        "box": boxes[1],
        "state": SEEN,
        "parts": 0.0,
        "strips": np.zeros((2, 2)),
        "key": things.next_keys(1)[0],
        "kin": things.key[thing],
        "apart": 0 if torn else _OF_ITS_OWN // 2,
        "ground": np.full(2, np.nan),
        "first": frame,
        "histogram": np.zeros_like(things.histogram[thing]),
    }
    things.append(1, **row)
    seen.grow(boxes[1], areas[1], centres[1])
    for name, value in (("place", centres[0]), ("size", sizes[0]), ("area", areas[0]), ("parts", 0.0), ("strips", 0.0)):
        getattr(things, name)[thing] = value
    seen.box[thing], seen.area[thing], seen.centre[thing] = boxes[0], areas[0], centres[0]


def number(things: Followed, listed: NDArray[np.bool_], next_id: int) -> int:
    """List things, with a number for those that have none; give the next one."""
    things.listed[:] = listed
    new = np.flatnonzero(listed & (things.id == 0))
    things.id[new] = np.arange(next_id, next_id + len(new))
    return next_id + len(new)


def lost(things: Followed, shape: tuple[int, int], max_missed: int) -> NDArray[np.bool_]:
    """Say which things are given up."""
    height, width = shape
    # What was seen for a few frames alone is not waited for longer than that.
    patience = np.where(things.id > 0, things.age, _PATIENCE_UNLISTED)
    gone = things.missed > np.minimum(patience, max_missed)
    outside = (things.place < 0).any(axis=1) | (things.place > (width - 1, height - 1)).any(axis=1)
    unsure = np.sqrt(things.variance[..., 0].max(axis=1, initial=0.0))
    out: NDArray[np.bool_] = gone | (
        (things.state == HIDDEN) & (outside | (unsure > _LOST_SHARE * things.size.max(axis=1, initial=0.0)))
    )
    return out
