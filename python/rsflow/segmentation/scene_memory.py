"""What was seen at each pixel of a scene: the states that its colour had while nothing moved there.

docs/explanation/algorithms.md, section "The scene behind what moves".
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .patches import cut
from .regions import pixels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .patches import Part

    U8 = NDArray[np.uint8]

__all__ = ["SceneMemory", "apart", "light_table"]

# Colours that differ by at most so many levels in each channel are one state; more where the picture is noisy, by this
# many of its deviations.
_SAME_LEVELS, _SAME_DEVIATIONS, _MOST_LEVELS = 14, 4.0, 48
# Light has changed when half of some pixels changed by more levels than this; fewer pixels do not tell.
_SAME_LIGHT, _LEAST_LOOKED_AT = 1.5, 50
# States that differ by at most so many levels are one in two lights.
_LIGHT_LEVELS = 24
# A state counts when it was seen so often in a row.
_CONFIRMED = 2
# One of so many sights is the scene, whatever was there before.
_LASTING = 8
# A disc: gaps that are smaller are closed.
_AROUND = np.array([[0, 1, 1, 1, 0], [1] * 5, [1] * 5, [1] * 5, [0, 1, 1, 1, 0]], np.uint8)


class SceneMemory:
    """What was seen at each pixel of a canvas of (height, width)."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        # Channels of their own: OpenCV then works on each a vector at a time.
        self.now, self.other, self.next = ([np.zeros(shape, np.uint8) for _ in range(3)] for _ in range(3))
        self.now_seen, self.other_seen = np.zeros(shape, np.uint16), np.zeros(shape, np.uint16)
        self.next_seen = np.zeros(shape, np.uint8)

    def planes(self) -> list[NDArray[Any]]:
        """Give all of it, in a fixed order."""
        return [*self.now, *self.other, *self.next, self.now_seen, self.other_seen, self.next_seen]

    def replace(self, planes: list[NDArray[Any]]) -> None:
        """Put others in the place of `planes`."""
        self.now, self.other, self.next = planes[:3], planes[3:6], planes[6:9]
        self.now_seen, self.other_seen, self.next_seen = planes[9:]
        self.shape = (planes[0].shape[0], planes[0].shape[1])

    def see(self, part: Part, picture: U8, still: U8, levels: int) -> None:
        """Take in a picture of a part of the canvas where it is still."""
        import cv2

        at = cut(part)
        channels = [np.asarray(channel, np.uint8) for channel in cv2.split(picture)]
        far = apart(channels, [plane[at] for plane in self.now])
        known = cv2.compare(self.now_seen[at], 0, cv2.CMP_GT)
        first = cv2.bitwise_and(still, cv2.bitwise_not(known))
        if first.any():
            # Nothing to compare with: what is seen first is what is known.
            for channel, now in zip(channels, self.now, strict=True):
                cv2.copyTo(channel, first, now[at])
            far[first > 0] = 0
            known |= first
        same = cv2.bitwise_and(cv2.bitwise_and(cv2.compare(far, levels, cv2.CMP_LE), known), still)
        for channel, now in zip(channels, self.now, strict=True):
            # A quarter of the way: noise is halved, and slow light is followed.
            cv2.copyTo(cv2.addWeighted(channel, 0.25, now[at], 0.75, 0), same, now[at])
        counted = self.now_seen[at]
        cv2.add(counted, 1, counted, mask=same)
        self.next_seen[at][same > 0] = 0
        rows, columns = pixels(cv2.bitwise_and(still, cv2.bitwise_not(same)).view(bool))
        if len(rows):
            self._change(rows + part[1], columns + part[0], picture[rows, columns], levels)

    def _change(self, rows: NDArray[np.int32], columns: NDArray[np.int32], colors: U8, levels: int) -> None:
        """Take in pixels that are not as before: seen so again they are the state of now."""
        at = rows, columns
        wide = colors.astype(np.int16)
        before = np.stack([plane[at] for plane in self.next], axis=1)
        again = (np.abs(wide - before).max(axis=1) <= levels) & (self.next_seen[at] > 0)
        seen = np.where(again, self.next_seen[at] + 1, 1).astype(np.uint8)
        mixed = np.where(again[:, None], (wide + before + 1) >> 1, wide).astype(np.uint8)
        for plane, color in zip(self.next, mixed.T, strict=True):
            plane[at] = color
        self.next_seen[at] = seen
        sure = seen >= _CONFIRMED
        if sure.any():
            self._turn((rows[sure], columns[sure]), mixed[sure], seen[sure], levels)

    def _turn(self, at: tuple[NDArray[np.int32], NDArray[np.int32]], colors: U8, seen: U8, levels: int) -> None:
        """Make these colours the state of now; the one before stays where it was seen more than the other."""
        now = np.stack([plane[at] for plane in self.now], axis=1)
        other = np.stack([plane[at] for plane in self.other], axis=1)
        now_seen, other_seen = self.now_seen[at], self.other_seen[at]
        back = (np.abs(colors.astype(np.int16) - other).max(axis=1) <= levels) & (other_seen > 0)
        keeps = back | (now_seen >= other_seen)
        for plane, color in zip(self.other, np.where(keeps[:, None], now, other).T, strict=True):
            plane[at] = color
        self.other_seen[at] = np.where(keeps, now_seen, other_seen)
        for plane, color in zip(self.now, colors.T, strict=True):
            plane[at] = color
        self.now_seen[at] = seen + np.where(back, np.minimum(other_seen, 60_000), 0)
        self.next_seen[at] = 0

    def follow_light(self, part: Part, picture: U8, still: U8) -> int:
        """Bring all into the light of a picture of a part; by how many levels a pixel may then differ from its state.

        Both are told by a look at some pixels.
        """
        rows, columns = cut(part)
        some = np.s_[::7, ::5]
        at = (still[some] > 0) & (self.now_seen[rows, columns][some] > 0)
        if np.count_nonzero(at) < _LEAST_LOOKED_AT:
            return _SAME_LEVELS
        now = picture[some][at]
        before = np.stack([plane[rows, columns][some][at] for plane in self.now], axis=1)
        spread = 0.0
        for channel in range(3):
            table = light_table(before[:, channel], now[:, channel])
            if table is not None:
                self._relight(channel, table)
                before[:, channel] = table[before[:, channel]]
            off = np.abs(now[:, channel].astype(np.int16) - before[:, channel])
            spread = max(spread, 1.4826 * float(np.median(off)))
        return int(np.clip(_SAME_DEVIATIONS * spread, _SAME_LEVELS, _MOST_LEVELS))

    def _relight(self, channel: int, table: U8) -> None:
        """Give a channel of all states other levels."""
        import cv2

        for planes in (self.now, self.other, self.next):
            cv2.LUT(planes[channel], table, planes[channel])

    def lately(self, part: Part) -> tuple[U8, U8]:
        """Give what was seen last in a part, and where anything was, 0 or 255.

        What was seen now for a short time only gives way to what was seen for longer: a thing that stands for a moment
        is no scene.
        """
        import cv2

        at = cut(part)
        brief = cv2.compare(self.now_seen[at], _LASTING, cv2.CMP_LT)
        return self._chosen(part, brief) if brief.any() else self._chosen(part, None)

    def mostly(self) -> tuple[U8, U8]:
        """Give what was seen most, and where anything was, 0 or 255."""
        return self._chosen((0, 0, self.shape[1], self.shape[0]), np.full(self.shape, 255, np.uint8))

    def _chosen(self, part: Part, among: U8 | None) -> tuple[U8, U8]:
        """Give the states of now, but among these pixels those seen more often, and where any was seen."""
        import cv2

        at = cut(part)
        now, other = [plane[at] for plane in self.now], [plane[at] for plane in self.other]
        known = _above(self.now_seen[at], 0)
        if among is not None:
            more = cv2.bitwise_and(_above(self.other_seen[at], self.now_seen[at]), among)
            # States that are alike differ in their light: that of now has no seams.
            more = cv2.bitwise_and(more, _above(apart(now, other), _LIGHT_LEVELS))
            if more.any():
                # Not pixel by pixel.
                more = cv2.morphologyEx(more, cv2.MORPH_CLOSE, _AROUND)
                more = cv2.bitwise_and(more, _above(self.other_seen[at], 0))
            now = [cv2.copyTo(old, more, new.copy()) for old, new in zip(other, now, strict=True)]
        return cv2.merge(now), known


def apart(one: list[U8], other: list[U8]) -> U8:
    """Give the largest difference of three channels."""
    import cv2

    far = cv2.absdiff(one[0], other[0])
    for here, there in zip(one[1:], other[1:], strict=True):
        far = cv2.max(far, cv2.absdiff(here, there))
    return np.asarray(far, np.uint8)


def light_table(before: U8, now: U8) -> U8 | None:
    """Give the new level of each, by the line that most pixels follow; None where light is as it was."""
    was, levels = before.astype(np.float64), now.astype(np.float64)
    off = levels - was
    if abs(float(np.median(off))) <= _SAME_LIGHT:
        return None
    line = np.array([1.0, float(np.median(off))])
    for _ in range(5):
        rest = np.abs(levels - line[0] * was - line[1])
        near = rest <= max(2.5 * 1.4826 * float(np.median(rest)), 2.0)
        spread = float(was[near].std())
        if spread < 5:
            # One level does not tell contrast from brightness.
            line = np.array([1.0, float(np.median(off))])
            break
        line = np.polyfit(was[near], levels[near], 1)
    every = np.arange(256)
    table: U8 = np.clip(np.rint(line[0] * every + line[1]), 0, 255).astype(np.uint8)
    return table


def _above(plane: NDArray[Any], limit: Any) -> U8:
    """Where a plane is above a limit, 255: OpenCV takes an array of one element for a number."""
    out: U8 = (plane > limit).view(np.uint8) * np.uint8(255)
    return out
