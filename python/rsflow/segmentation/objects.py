"""Things that move: the regions of successive masks, each followed under one number, also behind and beside others.

docs/explanation/algorithms.md, section "Things that move: ObjectTracker".
"""

from __future__ import annotations

import math
import numbers
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from .. import _checks
from .._display import options
from .._shared import Shared, alone
from ..errors import ShapeError
from .tracks import kalman, lifecycle, matching, measuring, picture_motion
from .tracks.followed import HIDDEN, SEEN, Followed
from .tracks.regions_seen import Regions, observe
from .tracks.telling import told
from .tracks.travel import go_on, length, travelling

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .object_table import TrackedObject

    F64 = NDArray[np.float64]

__all__ = ["ObjectTracker"]

# Deviation of the change of velocity in a frame: in pixels, and as a share of the thing's size; up to so many times as
# much for what surprises.
_TURN_PX, _TURN_SHARE = 0.03, 0.003
_LEAST_SURPRISE, _MOST_SURPRISE = 0.02, 16.0


class ObjectTracker(Shared):
    """Give the regions of successive masks numbers that last.

    Each thing has a Kalman filter over the ground for its place and its velocity. A region belongs to the thing whose
    predicted place, size, motion and grey levels fit it best, all of them together. Given the frames, samples of a
    thing's own picture say how far it went. Parts of a thing that is torn are put together; things that merge into one
    region keep their numbers, by their prediction, and share its pixels by place and motion; a hidden thing goes on as
    predicted. A thing that turns out to be two is split.

    Parameters
    ----------
    min_area : int
        Regions of fewer pixels are left out.
    max_missed : int
        For how many frames a thing lives without a region. It is given up before where it would have left the picture,
        or its place is no longer known to within its own size.
    min_age : int
        In how many frames a region must be seen before it gets a number and is listed: what flickers up in one
        frame is noise. The regions of the very first mask are listed at once.
    only_travelling : bool
        List only what gets somewhere: leaves and tape in the wind go nowhere, and the place that a thing has left has
        no motion. A thing that stops stays listed.

    Attributes
    ----------
    labels : (height, width) int32
        The number at each pixel of the last frame, 0 where there is none.
    lasting : (height, width) bool
        Regions of the last frame that have been seen in `min_age` frames, listed or not.

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
    >>> tracker.update(np.zeros((40, 60), bool)), [(hidden.x, hidden.state) for hidden in tracker.hidden]
    ((), [(22.5, 'hidden')])
    """

    _state_version = 3
    _state_types: ClassVar = {
        **dict.fromkeys(("min_area", "max_missed", "min_age", "_next_id", "_frame"), (numbers.Integral,)),
        "only_travelling": (bool, np.bool_),
        "_things": (Followed,),
        **dict.fromkeys(("_t_s", "_interval_s"), (numbers.Real,)),
        **dict.fromkeys(("labels", "lasting", "_to_first"), (np.ndarray,)),
    }

    def __init__(
        self, *, min_area: int = 1, max_missed: int = 30, min_age: int = 1, only_travelling: bool = False
    ) -> None:
        for name, value, least in (("min_area", min_area, 1), ("max_missed", max_missed, 0), ("min_age", min_age, 1)):
            _checks.integer(name, value, least=least)
        self.min_area = min_area
        self.max_missed = max_missed
        self.min_age = min_age
        self.only_travelling = _checks.flag("only_travelling", only_travelling)
        self._next_id = 1
        self._frame = 0
        self._things = Followed()
        # Of the frame before, and of a frame: a velocity per frame is over this.
        self._t_s = self._interval_s = math.nan
        # From the picture at hand to the first one.
        self._to_first: F64 = np.eye(3)
        self.labels: NDArray[np.int32] = np.zeros((0, 0), np.int32)
        self.lasting: NDArray[np.bool_] = np.zeros((0, 0), bool)

    def __repr__(self) -> str:
        told = options(
            min_area=self.min_area,
            max_missed=self.max_missed,
            min_age=self.min_age,
            only_travelling=self.only_travelling,
        )
        return f"ObjectTracker({told}): {int(self._things.listed.sum())} objects followed"

    @property
    def to_first(self) -> F64:
        """Homography (3, 3) from the last frame to the first, in which ways over the ground are told; NaN if lost."""
        return self._to_first.copy()

    @alone
    def update(
        self,
        mask: NDArray[np.bool_],
        motion: NDArray[np.floating] | None = None,
        camera_motion: NDArray[np.float64] | None = None,
        *,
        image: NDArray[Any] | None = None,
        t_s: float | None = None,
    ) -> tuple[TrackedObject, ...]:
        """Take the regions of the next frame.

        Parameters
        ----------
        mask : ndarray of bool, (height, width)
            What moves.
        motion : ndarray, (height, width, 2), optional
            Motion against the surroundings in pixels since the frame before, at this frame's pixels, NaN where
            unknown. Without it the velocity is the way of the centre.
        camera_motion : ndarray, (3, 3), optional
            Where the camera's motion takes a pixel of the frame before; by default it stands still.
        image : ndarray of uint8, uint16 or float32, (height, width), optional
            The frame: then things are followed by their own pictures too. Floating-point levels are of 0 to 255.
        t_s : float, optional
            The frame's time in seconds, for velocities per second and for frames that are missing.

        Returns
        -------
        tuple of TrackedObject
            What is seen in this frame, by number; `hidden` has the rest.

        Raises
        ------
        ShapeError
            If the sizes do not fit together.
        """
        mask, motion, camera_motion, image = self._checked(mask, motion, camera_motion, image)
        steps = self._steps(_checks.number_or_none("t_s", t_s, of="seconds", or_nan=True))
        self._carry(camera_motion)
        things = self._things
        if not len(things) and not mask.any():
            # Most frames of most cameras: nothing is followed, and nothing begins.
            self.labels, self.lasting = np.zeros(mask.shape, np.int32), np.zeros(mask.shape, bool)
            self._frame += 1
            return ()
        turn = _TURN_PX + _TURN_SHARE * things.size.max(axis=1, initial=0.0)
        turn = turn * np.sqrt(np.clip(things.surprise, _LEAST_SURPRISE, _MOST_SURPRISE))
        before = things.place.copy()
        kalman.predict(things.place, things.velocity, things.variance, steps, turn)
        things.way += things.place - before
        levels = None if image is None else picture_motion.smoothed(image)
        regions = observe(mask, motion, image, self.min_area, levels)
        matches = matching.match(things, regions, things.listed, mask.shape)
        ridden = picture_motion.ride(things, regions, matches.region, levels, mask, steps)
        seen = measuring.measure(things, regions, matches, motion, mask.shape, ridden)
        measuring.believe(things, seen, before, steps)
        picture_motion.go_along(things, ridden, things.place - before)
        alone = np.flatnonzero(seen.state == SEEN)
        things.patch[alone] = regions.picture[matches.region[alone]]
        lifecycle.part(things, regions, matches, seen, motion, self._frame)
        measuring.remember(things, seen, mask.shape)
        fused = lifecycle.fuse(things, regions, matches, self._frame)
        go_on(things)
        lifecycle.begin(things, regions, matches.left, self._frame, steps)
        self._list()
        self._label(mask, regions, matches, seen)
        self._follow_over_ground()
        gone = np.append(fused, np.zeros(len(things) - len(fused), bool))
        things.keep(~(gone | lifecycle.lost(things, mask.shape, self.max_missed)))
        self._frame += 1
        return told(things, things.listed & (things.state != HIDDEN), self._interval_s)

    @property
    def hidden(self) -> tuple[TrackedObject, ...]:
        """Things that the last frame does not show, where they are predicted."""
        things = self._things
        return told(things, things.listed & (things.state == HIDDEN), self._interval_s)

    def _checked(self, mask: Any, motion: Any, camera_motion: Any, image: Any) -> Any:
        mask = np.ascontiguousarray(_checks.mask("mask", mask))
        if mask.size == 0:
            raise ShapeError(f"mask: got shape {mask.shape}, expected at least one pixel")
        if motion is not None:
            motion = _checks.array("motion", motion, (*mask.shape, 2), f"numbers, {(*mask.shape, 2)}, as the mask has")
        if self.labels.size and mask.shape != self.labels.shape:
            raise ShapeError(f"mask: got shape {mask.shape}, expected that of those before, {self.labels.shape}")
        if camera_motion is not None:
            camera_motion = _checks.array("camera_motion", camera_motion, (3, 3), "finite numbers, (3, 3)", finite=True)
        if image is not None:
            image = _checks.frame("image", image)
            if image.shape != mask.shape:
                raise ShapeError(f"image: got shape {image.shape}, expected that of the mask, {mask.shape}")
        return mask, motion, camera_motion, image

    def _steps(self, t_s: float | None) -> float:
        """How many frames have passed: one, or by the times."""
        steps = 1.0
        t_s = math.nan if t_s is None else t_s
        passed = t_s - self._t_s
        if passed > 0:
            if math.isnan(self._interval_s):
                self._interval_s = passed
            steps = passed / self._interval_s
        self._t_s = t_s
        return steps

    def _carry(self, camera_motion: F64 | None) -> None:
        """Take everything along with the camera's motion into the picture at hand."""
        if camera_motion is None or np.array_equal(camera_motion, np.eye(3)):
            return
        things = self._things
        if len(things):
            moved, slope = kalman.carried(things.place, camera_motion)
            seen = np.isfinite(moved[:, 0] + moved[:, 1])
            things.keep(seen)
            moved, slope = moved[seen], slope[seen]
            scale = np.sqrt(np.abs(np.linalg.det(slope)))
            shift = moved - things.place
            things.box += np.concatenate([shift, shift], axis=1)
            things.place[...] = moved
            for vectors in (things.velocity, things.way, things.corner, things.carried, things.alongside):
                vectors[...] = (slope @ vectors[:, :, None])[:, :, 0]
            samples, _ = kalman.carried(things.patch[:, :, 1:3].reshape(-1, 2).astype(np.float64), camera_motion)
            things.patch[:, :, 1:3] = np.nan_to_num(samples).reshape(len(things), -1, 2)
            things.size *= scale[:, None]
            things.area *= scale * scale
            things.variance *= (scale * scale)[:, None, None]
        to_first = self._to_first @ np.linalg.pinv(camera_motion)
        self._to_first = to_first / to_first[2, 2] if abs(to_first[2, 2]) > 1e-12 else np.full((3, 3), np.nan)

    def _follow_over_ground(self) -> None:
        things = self._things
        if not len(things):
            return
        if np.isfinite(self._to_first).all():
            now, _ = kalman.carried(things.place, self._to_first)
        else:
            now = np.full_like(things.place, np.nan)
        step = length(now - things.ground)
        things.travelled += np.where(np.isfinite(step), step, 0.0)
        things.ground = now

    def _list(self) -> None:
        """Decide what counts as a thing."""
        things = self._things
        if self.only_travelling:
            listed = (things.age >= self.min_age) & travelling(things)
        else:
            listed = things.listed | (things.age >= (self.min_age if self._frame else 1))
        self._next_id = lifecycle.number(things, listed, self._next_id)

    def _label(
        self, mask: NDArray[np.bool_], regions: Regions, matches: matching.Matches, seen: measuring.Measured
    ) -> None:
        """Give each pixel the number of its thing."""
        things = self._things
        shown = np.where(things.listed, things.id, 0).astype(np.int32)
        old = things.age >= (self.min_age if self._frame else 1)
        owner = np.full(len(regions), -1)
        own = matches.region >= 0
        owner[matches.region[own]] = np.flatnonzero(own)
        for thing, pieces in matches.pieces.items():
            owner[pieces] = thing
        for region, thing in matches.split.items():
            owner[region] = thing
        owner[matches.left] = np.arange(len(things) - len(matches.left), len(things))
        labels, lasting = np.zeros(mask.shape, np.int32), np.zeros(mask.shape, bool)
        for number, thing in enumerate(owner.tolist()):
            if number in seen.divided or (thing >= 0 and (shown[thing] or old[thing])):
                left, top, right, bottom = map(int, regions.box[number])
                window = np.s_[top:bottom, left:right]
                inside = regions.labels[window] == regions.label[number]
                lasting[window] |= inside
                if thing >= 0 and shown[thing]:
                    labels[window][inside] = shown[thing]
        self.labels, self.lasting = labels, lasting
        for members, whose, window in seen.divided.values():
            here = np.append(shown[members], 0)[whose]
            self.labels[window] = np.where(whose >= 0, here, self.labels[window])
