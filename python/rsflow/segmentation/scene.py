"""The scene without what moves, in colour: remembered over a film, and put in the place of what moves.

For each pixel of a canvas two states are kept, each with its colour and how often it was seen still, and a third that
is not sure yet. Behind a thing stands the state that was seen last, before it came or, within a short look-ahead, after
it left; the picture of the whole film has the one that was seen most. With a moving camera the canvas lies over the
scene, and the camera's motion carries each frame to it.

docs/explanation/algorithms.md, section "The scene behind what moves".
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks
from .._display import options
from . import regions
from .patches import boxes_of, canvas, cut, hatched, parts_around
from .scene_memory import SceneMemory, apart, light_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from .patches import Part
    from .result import MotionSegmentation

    U8 = NDArray[np.uint8]
    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

__all__ = ["StaticScene", "frames_ahead"]

# After so many first frames, every so many is looked at: things move on, the scene does not.
_EAGER, _EVERY = 6, 8
# Share of the frame's smaller side, and pixels: so near to what moves a pixel may be its own.
_RIM_SHARE, _LEAST_RIM = 1 / 160, 2
# What is put in has the light around it, as it is within this many pixels, unless it differs by more levels than these
# from most of it.
_LIGHT_REACH, _LIGHT_STEP, _LIGHT_LEVELS = 16, 8, 24.0
# Light has changed when the mean of the picture, or of what is around a thing, changed by more levels.
_OTHER_LIGHT = 2.0
# In so many first frames a pixel that differs by more levels from what was seen there later is of a thing.
_EARLY, _GONE_LEVELS = 10, 40
# The canvas of a moving camera is wider than the frame by this share on each side, and is laid anew when the frame
# leaves it, or is larger or smaller on it by this factor.
_PADDING, _ZOOM = 0.25, 1.3
# The picture of a frame waits so long, and no more than so many frames, for what is seen behind its things later.
_LOOK_AHEAD_S, _LOOK_AHEAD_FRAMES = 1.5, 60
# Memory that frames which wait for what comes after them may take.
_WAITING_BYTES = 64_000_000


@dataclass
class _Waiting:
    """A frame whose picture waits for what is seen behind its things."""

    picture: U8
    hidden: Mask
    parts: list[Part]
    to_canvas: F64
    early: bool


class StaticScene:
    """Keep the scene behind what moves, and give each frame with it in place of what moves.

    Parameters
    ----------
    look_ahead : int
        For how many frames a picture waits for what is seen behind its things later, unless memory is short.

    Raises
    ------
    OptionError
        If `look_ahead` is below 0.

    Examples
    --------
    >>> import rsflow
    >>> segmenter, scene = rsflow.MotionSegmenter(), StaticScene(look_ahead=2)
    >>> ready = []
    >>> for frame in rsflow.synthetic.flight_with_object(frames=5):
    ...     ready += scene.add(segmenter.update(frame.image))
    >>> len(ready), len(scene.finish())
    (3, 2)
    """

    def __init__(self, *, look_ahead: int = 0) -> None:
        self._look_ahead = _checks.integer("look_ahead", look_ahead, least=0)
        self._waiting: deque[_Waiting] = deque()
        self._memory: SceneMemory | None = None
        self._to_canvas: F64 = np.eye(3)
        # From the first frame, or the first after a cut.
        self._first: F64 = np.eye(3)
        self._size = (0, 0)
        self._learned = self._since = self._taken = 0
        self._level = 0.0

    def __repr__(self) -> str:
        told = options(look_ahead=self._look_ahead)
        return f"StaticScene({told}): {'no frame yet' if self._memory is None else f'{self._taken} frames'}"

    def add(self, seen: MotionSegmentation, picture: NDArray[Any] | None = None) -> list[U8]:
        """Take the next frame; give the pictures that are complete.

        Parameters
        ----------
        seen : MotionSegmentation
            Of `MotionSegmenter.update`.
        picture : ndarray, optional
            The frame in colour, to be kept instead of its grey levels.

        Returns
        -------
        list of ndarray of uint8, (height, width, 3)
            Blue, green, red: each frame without what moves, `look_ahead` frames after it was taken; the scene stands
            in its place, or hatching where none is known.

        Raises
        ------
        ShapeError
            If the picture is not of the frame's size.
        """
        shown, hidden, ready = self._take(seen, picture)
        if seen.mask is not None:
            hidden = hidden & seen.mask
        parts = parts_around(boxes_of(hidden), self._size, _LIGHT_REACH)
        self._waiting.append(_Waiting(shown, hidden, parts, self._to_canvas, self._taken <= _EARLY))
        most = min(self._look_ahead, _WAITING_BYTES // (shown.nbytes + hidden.nbytes))
        while len(self._waiting) > most:
            ready.append(self._completed(self._waiting.popleft()))
        return ready

    def learn(self, seen: MotionSegmentation, picture: NDArray[Any] | None = None) -> None:
        """Take the next frame for the scene alone: no picture of it is wanted."""
        self._take(seen, picture)

    def _take(self, seen: MotionSegmentation, picture: NDArray[Any] | None) -> tuple[U8, Mask, list[U8]]:
        """Learn from a frame; give what it shows, what is hidden by things, and pictures of what was before a cut."""
        shown = canvas(seen.moving.shape, seen.image, picture)
        ready: list[U8] = []
        if self._memory is None or self._size != shown.shape[:2] or not seen.valid:
            # Nothing leads from what was before to here.
            ready = self.finish()
            self._size = (shown.shape[0], shown.shape[1])
            self._memory, self._to_canvas, self._first = SceneMemory(self._size), np.eye(3), np.eye(3)
            self._learned = self._taken = 0
        self._taken += 1
        self._follow(seen)
        hidden = regions.dilated(seen.moving, 2 * self._rim() + 1)
        self._since += 1
        level = float(shown[::16, ::16].mean())
        due = self._learned < _EAGER or self._since >= _EVERY or abs(level - self._level) > _OTHER_LIGHT
        if seen.valid and due:
            self._since, self._level = 0, level
            self._learned += 1
            self._learn(shown, ~hidden if seen.mask is None else ~hidden & seen.mask)
        return shown, hidden, ready

    def _rim(self) -> int:
        return max(_LEAST_RIM, round(_RIM_SHARE * min(self._size)))

    def finish(self) -> list[U8]:
        """Give the pictures that still wait, as `add` does, with what is known."""
        ready = [self._completed(waiting) for waiting in self._waiting]
        self._waiting.clear()
        return ready

    def best(self) -> tuple[U8, Mask] | None:
        """Give the scene of all frames, as the last one would show it.

        Returns
        -------
        (ndarray of uint8, (height, width, 3), ndarray of bool, (height, width)) or None
            The picture, and where it is known; None before the first frame.
        """
        import cv2

        if self._memory is None:
            return None
        picture, known = self._memory.mostly()
        if self._memory.shape != self._size or not np.array_equal(self._to_canvas, np.eye(3)):
            size = (self._size[1], self._size[0])
            back = np.linalg.inv(self._to_canvas)
            picture = np.asarray(cv2.warpPerspective(picture, back, size), np.uint8)
            known = np.asarray(cv2.warpPerspective(known, back, size, flags=cv2.INTER_NEAREST), np.uint8)
        return picture, known > 0

    def ground(self, corner: tuple[float, float], size: tuple[int, int], scale: float) -> tuple[U8, Mask] | None:
        """Give the scene as the first frame would show it, and where it is known; None before a frame.

        Parameters
        ----------
        corner : (x, y)
            Upper left corner in pixels of the first frame; it may lie outside of it.
        size : (width, height)
            Of the picture.
        scale : float
            Pixels of the picture a pixel of the first frame.
        """
        import cv2

        if self._memory is None:
            return None
        picture, known = self._memory.mostly()
        placed = np.diag([scale, scale, 1.0]) @ _shift(-corner[0], -corner[1]) @ np.linalg.inv(self._first)
        flags = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        picture = np.asarray(cv2.warpPerspective(picture, placed, size, flags=flags), np.uint8)
        return picture, np.asarray(cv2.warpPerspective(known, placed, size, flags=cv2.INTER_NEAREST)) > 0

    def state(self) -> dict[str, Any]:
        """Give what `restore` needs to go on, but for the pictures that wait."""
        return {
            "planes": [] if self._memory is None else self._memory.planes(),
            "to_canvas": self._to_canvas,
            "first": self._first,
            "size": self._size,
            "counts": (self._learned, self._since, self._taken, self._level),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` gave."""
        planes = list(state["planes"])
        self._memory = None
        if planes:
            self._memory = SceneMemory(planes[0].shape)
            if [(plane.shape, plane.dtype) for plane in planes] != [(p.shape, p.dtype) for p in self._memory.planes()]:
                raise ValueError("what was seen behind things is damaged")
            self._memory.replace(planes)
        self._to_canvas, self._first, self._size = state["to_canvas"], state["first"], tuple(state["size"])
        self._learned, self._since, self._taken, self._level = state["counts"]

    def _follow(self, seen: MotionSegmentation) -> None:
        """Carry the map to the canvas on; where the frame leaves the canvas, lay another."""
        assert self._memory is not None
        motion = seen.camera_motion
        if not seen.valid or np.array_equal(motion, np.eye(3)):
            return
        to_canvas = self._to_canvas @ np.linalg.inv(motion)
        self._to_canvas = to_canvas / to_canvas[2, 2]
        corners = _corners(self._to_canvas, self._size)
        left, top = corners.min(axis=0)
        right, bottom = corners.max(axis=0)
        high, wide = self._memory.shape
        across = np.hypot(*(corners[2] - corners[0])) / np.hypot(*self._size)
        if left < 0 or top < 0 or right > wide - 1 or bottom > high - 1 or not 1 / _ZOOM < across < _ZOOM:
            self._lay()

    def _lay(self) -> None:
        """Lay the canvas around the frame at hand, with what it has of the old one."""
        import cv2

        assert self._memory is not None
        high, wide = self._size
        up, aside = round(_PADDING * high), round(_PADDING * wide)
        placed = np.array([[1.0, 0, aside], [0, 1, up], [0, 0, 1]])
        moved = placed @ np.linalg.inv(self._to_canvas)
        size = (wide + 2 * aside, high + 2 * up)
        # Once for each of many frames: pixels are taken as they are, since mixing them would blur more every time.
        planes = self._memory.planes()
        flags = cv2.INTER_NEAREST
        self._memory.replace([np.asarray(cv2.warpPerspective(plane, moved, size, flags=flags)) for plane in planes])
        for waiting in self._waiting:
            waiting.to_canvas = moved @ waiting.to_canvas
        self._first = moved @ self._first
        self._to_canvas = placed

    def _learn(self, shown: U8, still: Mask) -> None:
        """Take a frame into the memory where it is still."""
        import cv2

        assert self._memory is not None
        visible = still.view(np.uint8) * np.uint8(255)
        high, wide = self._size
        part = (0, 0, wide, high)
        if not np.array_equal(self._to_canvas, np.eye(3)):
            corners = _corners(self._to_canvas, self._size)
            left, top = np.floor(corners.min(axis=0)).astype(int)
            right, bottom = np.ceil(corners.max(axis=0)).astype(int) + 1
            part = (max(left, 0), max(top, 0), min(right, self._memory.shape[1]), min(bottom, self._memory.shape[0]))
            moved = _shift(-part[0], -part[1]) @ self._to_canvas
            size = (part[2] - part[0], part[3] - part[1])
            shown = np.asarray(cv2.warpPerspective(shown, moved, size), np.uint8)
            visible = np.asarray(cv2.warpPerspective(visible, moved, size, flags=cv2.INTER_NEAREST), np.uint8)
        self._memory.see(part, shown, visible, self._memory.follow_light(part, shown, visible))

    def _completed(self, waiting: _Waiting) -> U8:
        """Give the picture of a frame with the scene in the place of what moves."""
        import cv2

        out = waiting.picture
        if waiting.early and self._learned >= _EAGER:
            self._look_again(waiting)
        for part in waiting.parts:
            at = cut(part)
            hidden = waiting.hidden[at]
            if hidden.any():
                scene, known = self._behind(part, waiting.to_canvas)
                filled = hatched(_relit(scene, out[at], hidden, known > 0), known > 0, part[:2])
                cv2.copyTo(filled, hidden.view(np.uint8), out[at])
        return out

    def _look_again(self, waiting: _Waiting) -> None:
        """Find what moved in one of the first frames by what was seen there afterwards: nothing told it then."""
        import cv2

        whole = (0, 0, self._size[1], self._size[0])
        scene, known = self._behind(whole, waiting.to_canvas)
        channels = [[np.asarray(plane, np.uint8) for plane in cv2.split(each)] for each in (scene, waiting.picture)]
        far = apart(*channels)
        other = cv2.bitwise_and(cv2.compare(far, _GONE_LEVELS, cv2.CMP_GT), known)
        # Edges that are a pixel off are no things.
        other = cv2.morphologyEx(other, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
        if other.any():
            rim = 2 * self._rim() + 5
            waiting.hidden = waiting.hidden | regions.dilated(other.view(bool), rim)
            waiting.parts = parts_around(boxes_of(waiting.hidden), self._size, _LIGHT_REACH)

    def _behind(self, part: Part, to_canvas: F64) -> tuple[U8, U8]:
        """Give the scene at a part of a frame, and where it is known."""
        import cv2

        assert self._memory is not None
        if self._memory.shape == self._size and np.array_equal(to_canvas, np.eye(3)):
            return self._memory.lately(part)
        corners = _corners(to_canvas @ _shift(part[0], part[1]), (part[3] - part[1], part[2] - part[0]))
        left, top = np.floor(corners.min(axis=0)).astype(int) - 1
        right, bottom = np.ceil(corners.max(axis=0)).astype(int) + 2
        high, wide = self._memory.shape
        there = (max(left, 0), max(top, 0), min(right, wide), min(bottom, high))
        size = (part[2] - part[0], part[3] - part[1])
        if there[0] >= there[2] or there[1] >= there[3]:
            return np.zeros((size[1], size[0], 3), np.uint8), np.zeros((size[1], size[0]), np.uint8)
        scene, known = self._memory.lately(there)
        back = np.linalg.inv(_shift(-there[0], -there[1]) @ to_canvas @ _shift(part[0], part[1]))
        behind = np.asarray(cv2.warpPerspective(scene, back, size), np.uint8)
        if left >= 0 and top >= 0 and right <= wide and bottom <= high and cv2.countNonZero(known) == known.size:
            return behind, np.full((size[1], size[0]), 255, np.uint8)
        return behind, np.asarray(cv2.warpPerspective(known, back, size, flags=cv2.INTER_NEAREST), np.uint8)


def frames_ahead(rate: float) -> int:
    """Give for how many frames the picture of one waits at this number of frames a second."""
    return min(math.ceil(_LOOK_AHEAD_S * rate), _LOOK_AHEAD_FRAMES)


def _shift(x: float, y: float) -> F64:
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def _corners(to_canvas: F64, size: tuple[int, int]) -> F64:
    """Where the corners of a picture of (height, width) come to, (4, 2), around it."""
    right, bottom = size[1] - 1, size[0] - 1
    mapped = np.array([[0, 0, 1], [right, 0, 1], [right, bottom, 1], [0, bottom, 1]], float) @ to_canvas.T
    out: F64 = mapped[:, :2] / mapped[:, 2:]
    return out


def _relit(scene: U8, shown: U8, hidden: Mask, known: Mask) -> U8:
    """Give the scene the light that the frame has around what is hidden: the mean difference nearby, or all around."""
    import cv2

    some = np.s_[::_LIGHT_STEP, ::_LIGHT_STEP]
    beside = (known & ~hidden)[some]
    if not beside.any():
        return scene
    off = cv2.subtract(shown[some], scene[some], dtype=cv2.CV_32F)
    usual = np.median(off[beside], axis=0)
    if np.abs(usual).max() > _OTHER_LIGHT:
        # Contrast has changed as well as brightness.
        tables = [
            light_table(*(picture[some][beside][:, channel] for picture in (scene, shown))) for channel in range(3)
        ]
        same = np.arange(256, dtype=np.uint8)
        lit = cv2.LUT(scene, np.stack([same if table is None else table for table in tables], axis=1)[None])
        scene = np.asarray(lit, np.uint8)
        off = cv2.subtract(shown[some], scene[some], dtype=cv2.CV_32F)
        usual = np.median(off[beside], axis=0)
    counts = (beside & (np.abs(off - usual).max(axis=2) <= _LIGHT_LEVELS)).astype(np.float32)
    size = (2 * (_LIGHT_REACH // _LIGHT_STEP) + 1,) * 2
    summed = cv2.blur((off - usual) * counts[..., None], size, borderType=cv2.BORDER_CONSTANT)
    nearby = cv2.blur(counts, size, borderType=cv2.BORDER_CONSTANT)
    light = summed / (nearby + 0.02)[..., None] + usual
    if np.abs(light).max() < 1:
        return scene
    # As whole levels up and down: OpenCV enlarges and adds those many at a time.
    for add, change in ((cv2.add, light), (cv2.subtract, -light)):
        coarse = np.rint(np.clip(change, 0, 255)).astype(np.uint8)
        if coarse.any():
            scene = add(scene, cv2.resize(coarse, (scene.shape[1], scene.shape[0])))
    return scene
