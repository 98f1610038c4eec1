"""What a frame says of each thing, and what is believed of it then."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from . import kalman, sharing
from .followed import HIDDEN, MERGED, SEEN, Followed
from .regions_seen import histograms

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .matching import Matches
    from .picture_motion import Ridden
    from .regions_seen import Regions

    F64 = NDArray[np.float64]

# Deviation of the place that a region's centre gives: in pixels, as a share of its size, and of how much its width and
# height differ from the thing's.
_PLACE_PX, _PLACE_SHARE, _SHAPE_SHARE = 0.3, 0.02, 0.5
# Of one that the picture's border cuts off, by its other edge.
_EDGE_PX, _EDGE_SHARE = 1.0, 0.1
# The same for a share in a region with others, of its size.
_MERGED_SHARE = 0.3
# What is seen of a thing beside others is less than this share of its area: it is behind them.
_VISIBLE = 0.25
# Or its grey levels are further than this from the thing's (squared Hellinger distance).
_OTHER_GREY = 0.4
# Deviation of a velocity that a region's motion gives, beside that of the median.
_MOTION_PX, _MOTION_SHARE = 0.05, 0.03
# How fast the scatter of the motions follows, a frame.
_SCATTER_FOLLOWS = 0.1
# How fast size, area and grey levels follow, a frame; while a thing is new all it saw counts alike.
_FOLLOWS = 0.1
_GREY_FOLLOWS = 0.05


@dataclasses.dataclass
class Measured:
    """What a frame says of each thing; NaN and infinite variance where it says nothing."""

    box: F64
    area: F64
    centre: F64
    centre_variance: F64
    motion: F64
    motion_variance: F64
    histogram: F64
    state: NDArray[np.int64]
    # By region, whose pixel is whose, and where.
    divided: dict[int, tuple[list[int], NDArray[np.intp], tuple[slice, slice]]]

    def grow(self, box: F64, area: float, centre: F64) -> None:
        """Add a thing that is seen."""
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                row = np.zeros((1, *value.shape[1:]), value.dtype)
                setattr(self, item.name, np.concatenate([value, row]))
        self.box[-1], self.area[-1], self.centre[-1] = box, area, centre


def measure(
    things: Followed,
    regions: Regions,
    matches: Matches,
    motion: NDArray[np.floating] | None,
    shape: tuple[int, int],
    ridden: Ridden,
) -> Measured:
    """Take from the regions what they say of the things they belong to."""
    count = len(things)
    out = Measured(
        box=np.zeros((count, 4)),
        area=np.zeros(count),
        centre=np.full((count, 2), np.nan),
        centre_variance=np.full((count, 2), np.inf),
        motion=np.full((count, 2), np.nan),
        motion_variance=np.full((count, 2), np.inf),
        histogram=np.zeros_like(things.histogram),
        state=np.full(count, HIDDEN),
        divided={},
    )
    own = matches.region >= 0
    at = matches.region[own]
    if len(at):
        for name in ("box", "area", "centre", "motion", "histogram"):
            getattr(out, name)[own] = getattr(regions, name)[at]
        out.motion_variance[own] = _motion_variance(regions.motion[at], regions.motion_variance[at])
        out.state[own] = SEEN
    for thing, pieces in matches.pieces.items():
        _add_pieces(out, regions, thing, [int(matches.region[thing]), *pieces])
    if len(at):
        _by_border(out, things, np.flatnonzero(own), shape)
    for number, members in matches.shared.items():
        _share(out, things, regions, number, members, motion)
    things.contrast = np.maximum(things.contrast, ridden.contrast)
    told = np.isfinite(ridden.motion[:, 0]) & (out.state != HIDDEN)
    out.motion[told] = ridden.motion[told]
    out.motion_variance[told] = np.maximum(ridden.variance[told], _scatter(things, ridden.motion)[told])
    return out


def _scatter(things: Followed, motion: F64) -> F64:
    """Give the variance of the motions that the pictures of the things say, by how these change from frame to frame."""
    change = (motion - things.motion) ** 2 / 2
    known = np.isfinite(change)
    things.scatter += np.where(known, _SCATTER_FOLLOWS * (np.nan_to_num(change) - things.scatter), 0.0)
    things.motion[:] = motion
    return things.scatter


def _motion_variance(motion: F64, variance: F64) -> F64:
    speed = np.hypot(motion[:, 0], motion[:, 1])[:, None]
    return np.where(np.isfinite(speed), variance + _MOTION_PX**2 + (_MOTION_SHARE * speed) ** 2, np.inf)


def _cut(box: F64, shape: tuple[int, int]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Say along each axis whether the picture's border cuts boxes off, at their lower and at their upper end."""
    limits = np.array([shape[1], shape[0]])
    return box[:, :2] <= 0, box[:, 2:] >= limits


def _by_border(out: Measured, things: Followed, seen: NDArray[np.intp], shape: tuple[int, int]) -> None:
    """Say where things are that are seen alone: of what the picture's border cuts off, by the edge that is seen."""
    box, size = out.box[seen], things.size[seen]
    extent = box[:, 2:] - box[:, :2]
    deviation = (_PLACE_PX + _PLACE_SHARE * size) ** 2 + (_SHAPE_SHARE * (extent - size)) ** 2
    low, high = _cut(box, shape)
    cut = low | high
    # One that was seen as large before lies beyond the border as far as it was large.
    known = (low ^ high) & (size > extent)
    place = np.where(low, box[:, 2:] - size / 2, box[:, :2] + size / 2) - 0.5
    out.centre[seen] = np.where(known, place, out.centre[seen])
    by_edge = (_EDGE_PX + _EDGE_SHARE * size) ** 2
    out.centre_variance[seen] = np.where(known, by_edge, np.where(cut, deviation + (0.5 * extent) ** 2, deviation))


def _add_pieces(out: Measured, regions: Regions, thing: int, parts: list[int]) -> None:
    box, area = regions.box[parts], regions.area[parts]
    out.box[thing] = np.concatenate([box[:, :2].min(axis=0), box[:, 2:].max(axis=0)])
    out.area[thing] = area.sum()
    out.centre[thing] = (area[:, None] * regions.centre[parts]).sum(axis=0) / area.sum()
    known = np.isfinite(regions.motion[parts, 0])
    if known.any():
        weight = (area * known / area[known].sum())[:, None]
        mean = (weight * np.nan_to_num(regions.motion[parts])).sum(axis=0)
        spread = (weight * np.where(known[:, None], (regions.motion[parts] - mean) ** 2, 0.0)).sum(axis=0)
        least = regions.motion_variance[parts].min(axis=0)
        out.motion[thing] = mean
        out.motion_variance[thing] = _motion_variance(mean[None], (least + spread)[None])[0]


def _share(
    out: Measured,
    things: Followed,
    regions: Regions,
    number: int,
    members: list[int],
    motion: NDArray[np.floating] | None,
) -> None:
    """Divide a region among its members."""
    whose, window = sharing.divide(things, regions, number, members, motion)
    out.divided[number] = (members, whose, window)
    flat = whose.reshape(-1)
    inside = np.flatnonzero(flat >= 0)
    flat = flat[inside]
    y, x = np.divmod(inside, whose.shape[1])
    total = np.bincount(flat, minlength=len(members))
    order = np.argsort(flat, kind="stable")
    starts = np.cumsum(total) - total
    left, top = window[1].start, window[0].start
    edges = regions.box[number]
    predicted = np.concatenate(
        [things.place[members] - things.size[members] / 2, things.place[members] + things.size[members] / 2], axis=1
    )
    for place, thing in enumerate(members):
        out.state[thing] = MERGED
        own = order[starts[place] : starts[place] + total[place]]
        visible = len(own) > 0 and total[place] >= _VISIBLE * things.area[thing]
        if not visible or _looks_other(things, regions, thing, x[own] + left, y[own] + top):
            out.state[thing] = HIDDEN
            out.area[thing] = 0
            out.motion[thing], out.motion_variance[thing] = np.nan, np.inf
            out.centre[thing], out.centre_variance[thing] = np.nan, np.inf
            continue
        xs, ys = x[own] + left, y[own] + top
        out.box[thing] = xs.min(), ys.min(), xs.max() + 1, ys.max() + 1
        out.area[thing] = len(own)
        out.centre[thing] = xs.mean(), ys.mean()
        out.centre_variance[thing] = (_MERGED_SHARE * things.size[thing] + 1) ** 2
        _by_edges(out, things, predicted, place, thing, edges)
        out.motion[thing], out.motion_variance[thing] = _motion_of(motion, xs, ys)
        out.histogram[thing] = 0


def _looks_other(things: Followed, regions: Regions, thing: int, xs: NDArray[np.intp], ys: NDArray[np.intp]) -> bool:
    """Say whether pixels have not the grey levels of a thing."""
    if regions.image is None or not things.histogram[thing].any():
        return False
    grey = regions.image[ys, xs][None]
    here = histograms(grey, np.ones(grey.shape, bool))[0]
    return bool(1 - (np.sqrt(here) * np.sqrt(things.histogram[thing])).sum() > _OTHER_GREY)


def _by_edges(out: Measured, things: Followed, predicted: F64, place: int, thing: int, edges: F64) -> None:
    """Where a thing is the outermost of those in a region, the region's edge is its own."""
    for axis in (0, 1):
        size = things.size[thing, axis]
        for side, outer in ((0, 1.0), (2, -1.0)):
            others = np.delete(outer * predicted[:, side + axis], place)
            if len(others) and others.min() - outer * predicted[place, side + axis] > 0.2 * size:
                out.centre[thing, axis] = edges[side + axis] + outer * size / 2 - 0.5
                out.centre_variance[thing, axis] = (0.1 * size + 1) ** 2
                break


def _motion_of(motion: NDArray[np.floating] | None, xs: NDArray[np.intp], ys: NDArray[np.intp]) -> tuple[F64, F64]:
    unknown = np.full(2, np.nan), np.full(2, np.inf)
    if motion is None:
        return unknown
    step = max(1, len(xs) // 256)
    seen = np.asarray(motion[ys[::step], xs[::step]], np.float64)
    known = seen[np.isfinite(seen).all(axis=1)]
    if len(known) < 0.3 * len(seen) or len(known) == 0:
        return unknown
    order = np.sort(known, axis=0)
    last = len(order) - 1
    low, median, high = (order[last * part // 4] for part in (1, 2, 3))
    spread = (0.929 * (high - low)) ** 2 / max(1.0, len(xs) * len(known) / len(seen) / 50)
    return median, _motion_variance(median[None], spread[None])[0]


def believe(things: Followed, seen: Measured, start: F64, steps: float) -> None:
    """Correct what is believed of the things by what was measured; `start` is where they were in the frame before."""
    before = things.place.copy()
    off = seen.centre - things.place
    nis = kalman.correct_place(
        things.place,
        things.velocity,
        things.variance,
        np.nan_to_num(off),
        seen.centre_variance,
        _same_shape(things, seen),
    )
    turn = seen.motion / steps - things.velocity
    noise = seen.motion_variance / steps**2
    # The first measurement of a velocity is taken as it is.
    new = ~things.informed & np.isfinite(noise[:, 0])
    more = kalman.correct_velocity(things.place, things.velocity, things.variance, np.nan_to_num(turn), noise)
    if new.any():
        things.velocity[new] = seen.motion[new] / steps
        things.place[new] = seen.centre[new]
        things.variance[new, :, 0] = np.minimum(seen.centre_variance[new], 1e12)
        things.variance[new, :, 1] = 0.0
        things.variance[new, :, 2] = noise[new]
    moving = np.isfinite(seen.motion[:, 0])
    located = np.isfinite(seen.centre_variance).all(axis=1)
    solid = _same_shape(things, seen) & located
    things.informed |= moving | (solid & (things.age > 0))
    things.flowing |= moving
    surprise = (nis + more).mean(axis=1) / 2
    things.surprise += np.where(located | moving, 0.15, 0.0) * (surprise - things.surprise)
    things.way += things.place - before
    things.steps += np.hypot(*(things.place - start).T)
    things.alongside += np.where(moving[:, None], things.place - start, 0.0)
    things.carried += np.where(moving[:, None], np.nan_to_num(seen.motion), 0.0)


def _same_shape(things: Followed, seen: Measured) -> NDArray[np.bool_]:
    ratio = seen.area / things.area
    out: NDArray[np.bool_] = (seen.state == SEEN) & (ratio < 1.4) & (ratio > 1 / 1.4)
    return out


def remember(things: Followed, seen: Measured, shape: tuple[int, int]) -> None:
    """Let what things look like follow what was seen of them, where they were seen alone."""
    alone = seen.state == SEEN
    visible = seen.state != HIDDEN
    things.age += visible
    things.alone += alone
    things.missed[visible] = 0
    things.missed[~visible] += 1
    things.state[:] = seen.state
    things.pixels[:] = seen.area
    things.box[visible] = seen.box[visible]
    things.centre[visible] = seen.centre[visible]
    things.centre[~visible] = things.place[~visible]
    rate = np.where(alone, np.maximum(_FOLLOWS, 1.0 / np.maximum(things.age, 1)), 0.0)
    size = seen.box[:, 2:] - seen.box[:, :2]
    low, high = _cut(seen.box, shape)
    # What is cut off is as large as it was, and what comes in larger than it seemed.
    cut, part = low | high, (low | high).any(axis=1)
    most = np.where(alone[:, None], np.maximum(things.size, size), things.size)
    things.size[:] = np.where(cut, most, things.size + rate[:, None] * (size - things.size))
    area = np.where(alone, np.maximum(things.area, seen.area), things.area)
    things.area[:] = np.where(part, area, things.area + rate * (seen.area - things.area))
    grey = alone & seen.histogram.any(axis=1)
    fresh = grey & ~things.histogram.any(axis=1)
    rate = np.where(fresh, 1.0, np.where(grey, _GREY_FOLLOWS, 0.0))[:, None]
    things.histogram += rate * (seen.histogram - things.histogram)
