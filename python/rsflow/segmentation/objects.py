"""Things that move: connected regions of a mask, followed over time under one number each."""

from __future__ import annotations

import dataclasses
import numbers
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .. import _checks
from .._display import options
from .._shared import Shared, alone
from ..errors import ShapeError
from .object_table import TrackedObject
from .regions import labelled

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["ObjectTracker"]

# Share of a region's pixels whose motion must be known for their median to be its motion.
_ENOUGH_MOTION = 0.3
# A region whose area changes by more than this factor from frame to frame has become another: the way of its centre is
# not its motion.
_OTHER_SHAPE = 1.4


# The number of a region that is not listed yet.
_UNNUMBERED = 0


@dataclasses.dataclass
class _Track:
    id: int
    mask: NDArray[np.bool_]
    origin: tuple[int, int]
    velocity: tuple[float, float]
    age: int
    missed: int = 0


class ObjectTracker(Shared):
    """Give the regions of successive masks numbers that last.

    A region belongs to the track whose region of the frame before, moved on by its velocity and the camera's motion,
    it overlaps most. Where several regions overlap one track, the best keeps the number.

    Parameters
    ----------
    min_area : int
        Regions of fewer pixels are left out.
    max_missed : int
        For how many frames a track lives without a region.
    min_age : int
        In how many frames in a row a region must be seen before it gets a number and is listed: what flickers up in one
        frame is noise. The regions of the very first mask are listed at once.

    Attributes
    ----------
    labels : (height, width) int32
        The number at each pixel of the last frame, 0 where there is none.

    Raises
    ------
    OptionError
        If a parameter is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> tracker = ObjectTracker(min_area=4)
    >>> for x in (10, 13, 16):
    ...     mask = np.zeros((40, 60), bool)
    ...     mask[10:20, x : x + 8] = True
    ...     (thing,) = tracker.update(mask, np.where(mask[..., None], (3.0, 0.0), 0.0))
    >>> thing.id, thing.age_frames, thing.x, thing.vx_px_per_frame
    (1, 3, 19.5, 3.0)
    """

    _state_types: ClassVar = {
        **dict.fromkeys(("min_area", "max_missed", "min_age", "_next_id"), (numbers.Integral,)),
        "_started": (bool, np.bool_),
        "_tracks": (list,),
        "labels": (np.ndarray,),
    }

    def __init__(self, *, min_area: int = 1, max_missed: int = 5, min_age: int = 1) -> None:
        for name, value, least in (("min_area", min_area, 1), ("max_missed", max_missed, 0), ("min_age", min_age, 1)):
            _checks.integer(name, value, least=least)
        self.min_area = min_area
        self.max_missed = max_missed
        self.min_age = min_age
        self._started = False
        self._tracks: list[_Track] = []
        self._next_id = 1
        self.labels: NDArray[np.int32] = np.zeros((0, 0), np.int32)

    def __repr__(self) -> str:
        told = options(min_area=self.min_area, max_missed=self.max_missed, min_age=self.min_age)
        return f"ObjectTracker({told}): {sum(track.id != _UNNUMBERED for track in self._tracks)} objects followed"

    @alone
    def update(
        self,
        mask: NDArray[np.bool_],
        motion: NDArray[np.floating] | None = None,
        camera_motion: NDArray[np.float64] | None = None,
    ) -> tuple[TrackedObject, ...]:
        """Take the regions of the next frame.

        Parameters
        ----------
        mask : ndarray of bool, (height, width)
            What moves.
        motion : ndarray, (height, width, 2), optional
            Motion against the surroundings in pixels per frame, at this frame's pixels, NaN where unknown. Without
            it the velocity is the way of the centre.
        camera_motion : ndarray, (3, 3), optional
            Where the camera's motion takes a pixel of the frame before; by default it stands still.

        Returns
        -------
        tuple of TrackedObject
            By number.

        Raises
        ------
        ShapeError
            If the sizes do not fit together.
        """
        mask = np.ascontiguousarray(_checks.mask("mask", mask))
        if mask.size == 0:
            raise ShapeError(f"mask: got shape {mask.shape}, expected at least one pixel")
        if motion is not None:
            motion = _checks.array("motion", motion, (*mask.shape, 2), f"numbers, {(*mask.shape, 2)}, as the mask has")
        if self.labels.size and mask.shape != self.labels.shape:
            raise ShapeError(f"mask: got shape {mask.shape}, expected that of those before, {self.labels.shape}")
        if camera_motion is not None:
            camera_motion = _checks.array("camera_motion", camera_motion, (3, 3), "finite numbers, (3, 3)", finite=True)
        _, labels, stats, centres = labelled(mask)
        regions = [label for label in range(1, len(stats)) if stats[label, 4] >= self.min_area]
        numbers = np.zeros(len(stats), np.int32)
        places = self._associate(labels, stats, regions, camera_motion)
        out, tracks = [], []
        min_age = self.min_age if self._started else 1
        self._started = True
        for label in regions:
            left, top, width, height, area = (int(n) for n in stats[label])
            region = labels[top : top + height, left : left + width] == label
            track = places.get(label)
            velocity = _velocity(region, (left, top), motion, track, centres[label], camera_motion)
            if track is None:
                track = _Track(_UNNUMBERED, region, (left, top), velocity, 0)
            age = track.age + 1
            number = track.id
            if number == _UNNUMBERED and age >= min_age:
                number = self._next_id
                self._next_id += 1
            known = np.isfinite(velocity).all()
            numbers[label] = number
            tracks.append(_Track(number, region, (left, top), velocity if known else track.velocity, age))
            if number != _UNNUMBERED:
                x, y = (float(n) for n in centres[label])
                out.append(TrackedObject(number, x, y, (left, top, width, height), area, *velocity, age))
        seen = {track.id for track in tracks}
        for track in self._tracks:
            if track.id not in seen and track.id != _UNNUMBERED and track.missed < self.max_missed:
                track.origin = self._predicted(track, camera_motion)
                track.missed += 1
                tracks.append(track)
        self._tracks = tracks
        self.labels = np.take(numbers, labels)
        return tuple(sorted(out, key=lambda thing: thing.id))

    def _predicted(self, track: _Track, camera_motion: NDArray[np.float64] | None) -> tuple[int, int]:
        """Upper left corner of a track's region in the next frame."""
        left, top = track.origin
        x, y = left + track.mask.shape[1] / 2, top + track.mask.shape[0] / 2
        dx, dy = (v if np.isfinite(v) else 0.0 for v in track.velocity)
        if camera_motion is not None:
            mapped = camera_motion @ (x, y, 1.0)
            dx, dy = dx + mapped[0] / mapped[2] - x, dy + mapped[1] / mapped[2] - y
        return round(left + dx), round(top + dy)

    def _associate(
        self,
        labels: NDArray[np.int32],
        stats: NDArray[np.int32],
        regions: list[int],
        camera_motion: NDArray[np.float64] | None,
    ) -> dict[int, _Track]:
        """Which track each region continues: pairs by overlap with the prediction over both, the largest first."""
        pairs = []
        height, width = labels.shape
        for number, track in enumerate(self._tracks):
            left, top = self._predicted(track, camera_motion)
            rows = slice(max(top, 0), min(top + track.mask.shape[0], height))
            columns = slice(max(left, 0), min(left + track.mask.shape[1], width))
            if rows.start >= rows.stop or columns.start >= columns.stop:
                continue
            inside = track.mask[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
            found, counts = np.unique(labels[rows, columns][inside], return_counts=True)
            for label, count in zip(found.tolist(), counts.tolist(), strict=True):
                if label in regions:
                    area, other = int(track.mask.sum()), int(stats[label, 4])
                    if count > 0.1 * min(area, other):
                        # The likest, so that a thing keeps its number beside fragments that it once was in.
                        pairs.append((-count / (area + other - count), -track.age, number, label))
        places: dict[int, _Track] = {}
        taken: set[int] = set()
        for _, _, number, label in sorted(pairs):
            if number not in taken and label not in places:
                taken.add(number)
                places[label] = self._tracks[number]
        return places


def _velocity(
    region: NDArray[np.bool_],
    origin: tuple[int, int],
    motion: NDArray[np.floating] | None,
    track: _Track | None,
    centre: NDArray[np.float64],
    camera_motion: NDArray[np.float64] | None,
) -> tuple[float, float]:
    left, top = origin
    if motion is not None:
        inside = motion[top : top + region.shape[0], left : left + region.shape[1]][region]
        inside = inside[np.isfinite(inside).all(axis=1)]
        if len(inside) >= _ENOUGH_MOTION * np.count_nonzero(region):
            return float(np.median(inside[:, 0])), float(np.median(inside[:, 1]))
    if track is None or track.missed:
        return np.nan, np.nan
    rows, columns = np.nonzero(track.mask)
    area = np.count_nonzero(region)
    if not area / _OTHER_SHAPE <= len(rows) <= area * _OTHER_SHAPE:
        return np.nan, np.nan
    x, y = track.origin[0] + columns.mean(), track.origin[1] + rows.mean()
    if camera_motion is not None:
        mapped = camera_motion @ (x, y, 1.0)
        x, y = mapped[0] / mapped[2], mapped[1] / mapped[2]
    return float(centre[0] - x), float(centre[1] - y)
