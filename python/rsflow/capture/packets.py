"""The packets of a video, read without decoding beside the decoder: what it passes over in silence.

A decoder gives no picture for a packet that is damaged, and goes on in the old size where the size of the picture
changes. The packets tell both: each has its time, and those that a picture can begin with say its size.
"""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from dataclasses import dataclass
from typing import Any

from ..io.fork_guard import OfProcess, opening
from ..io.opencv_files import open_capture, quiet
from .bitstream import hidden, hides, picture_size

__all__ = ["Packets", "SizeChange"]

# Times of one packet and of its picture are the same number, rounded alike.
_SAME_S = 1e-6

# Packets read ahead of the pictures. Reordering in H.264 and HEVC spans at most 16.
_AHEAD = 32


@dataclass(frozen=True, slots=True)
class SizeChange:
    """Where the pictures of a stream change their size: number of the packet, time, size before and after."""

    index: int
    t_s: float
    before: tuple[int, int]
    after: tuple[int, int]


class Packets(OfProcess):
    """The packets of one file, in the order of the file.

    Parameters
    ----------
    source : str
        The file.
    size : (int, int) or None
        Width and height of the pictures, as the decoder gives them.
    first_s : list of float
        Times of the first pictures, in the order in which the decoder gives them; empty where they are no times of
        the file.
    reliable : bool
        Whether the container has a time for each picture. Others have those of decoding, if any: they tell which
        picture is missing only where those of the first pictures and packets are the same.
    """

    def __init__(self, source: str, size: tuple[int, int] | None, *, first_s: list[float], reliable: bool) -> None:
        import cv2

        self.count = 0
        self.change: SizeChange | None = None
        # Numbers of the first picture that is missing, and how many are.
        self.lost = 0
        self.first_lost: int | None = None
        self._size: tuple[int, int] | None = None
        # Number, time and size of each packet that says another size than that of the pictures.
        self._sizes: deque[tuple[int, float, tuple[int, int]]] = deque()
        self._opening_size = size
        self.timed = self._kept = bool(first_s)
        # Whether the container has a time for each picture.
        self.reliable = reliable
        self._listed = False
        self._waiting_s: list[float] = []
        self._index = 0
        self._keys = 0
        self._keys_s: list[float] = []
        self._capture: Any = open_capture(source)
        self._raw = bool(
            self._capture.isOpened()
            and self._capture.getBackendName() == "FFMPEG"
            and self._capture.set(cv2.CAP_PROP_FORMAT, -1)
        )
        self._codec = int(self._capture.get(cv2.CAP_PROP_FOURCC)) if self._raw else 0
        # Of some codecs any packet may be one that is not shown.
        self._peeks = hides(self._codec)
        self._ended = not self._raw
        if self.timed and not reliable:
            while self.count < len(first_s) + _AHEAD and self._next():
                pass
            pairs = zip(sorted(first_s), sorted(self._waiting_s), strict=False)
            same = len(self._waiting_s) >= len(first_s) and all(abs(a - b) <= _SAME_S for a, b in pairs)
            # Where each picture stands for itself, none is delayed.
            self.timed = same or (self._stands_alone and _are_among(first_s, self._waiting_s))
            # Decoders that look ahead give their last pictures the time 0: those of the packets are better, in order.
            self._listed = (
                not self.timed and self._waiting_s == sorted(set(self._waiting_s)) and self._waiting_s[:1] >= [-_SAME_S]
            )
            self._kept = self.timed or self._listed

    def _next(self) -> bool:
        """Read one packet; False at the end."""
        import cv2

        if self._ended:
            return False
        with quiet():
            if not self._capture.grab():
                self.close()
                return False
            t_s = round(float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3, 9)
            data = None
            key = bool(self._capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME))
            if self._peeks or (self.change is None and key):
                ok, data = self._capture.retrieve()
                data = data if ok else None
        size = None
        if data is not None:
            packet = data.tobytes()
            size = picture_size(self._codec, packet)
            if hidden(self._codec, packet):
                return True
        if size is not None and size != self._size:
            self._sizes.append((self.count, t_s, size))
        # Packets before the zero of time are left out by the file's own edit list.
        if not self.timed or t_s > -_SAME_S:
            self.count += 1
            self._keys += key
            if key:
                self._keys_s.append(t_s)
            if self._kept:
                heapq.heappush(self._waiting_s, t_s)
        return True

    def changed_by(self, index: int, t_s: float) -> bool:
        """Say whether the size has changed at a picture: the one after `index` others, with this time."""
        while self.change is None and self.count < index + self.lost + _AHEAD and self._next():
            pass
        while self.change is None and self._sizes:
            number, at_s, size = self._sizes[0]
            if (at_s > t_s + _SAME_S) if self.timed else (number > index):
                break
            self._sizes.popleft()
            if self.timed and self._stands_alone and at_s < t_s - _SAME_S:
                # Its own picture could not be decoded, and no other is made from it: what it says is damaged too.
                continue
            if self._size is None:
                # Sizes are compared as the stream counts them, before cropping and turning. Where the first comes
                # late, those before had the size in the header of the file.
                opening = self._opening_size
                late = number > 0 and not self._stands_alone and opening is not None
                self._size = opening if late and size[::-1] != opening else size
            if self._size is not None and size != self._size:
                self.change = SizeChange(number, at_s, self._size, size)
        return self.change is not None

    @property
    def _stands_alone(self) -> bool:
        """Whether each packet is a picture by itself, as in Motion JPEG."""
        return self._keys == self.count

    def place(self, t_s: float) -> tuple[int, float]:
        """Give number and time of the next picture, to which the decoder gives the time `t_s`.

        The number is that of its packet, so that lost ones count.
        """
        while self.count < self._index + _AHEAD and self._next():
            pass
        early = 0
        while self.timed and self._waiting_s and self._waiting_s[0] < t_s - _SAME_S:
            heapq.heappop(self._waiting_s)
            early += 1
        if self.timed and self._waiting_s and self._waiting_s[0] <= t_s + _SAME_S:
            heapq.heappop(self._waiting_s)
        self._miss(early)
        if self._listed and self._waiting_s:
            t_s = heapq.heappop(self._waiting_s)
        self._index += 1
        return self._index - 1, t_s

    def times_to(self, index: int) -> tuple[list[float], list[float]] | None:
        """Give the times of the pictures until `index` and some more, in order, and those of key frames.

        None where they do not tell one picture from another, or the size changes before. To be called first of all.
        """
        while self.timed and self.count < index + _AHEAD and self._next():
            pass
        times_s = sorted(self._waiting_s)
        distinct = all(b - a > 2 * _SAME_S for a, b in itertools.pairwise(times_s))
        if not self.timed or len(times_s) <= index or not distinct or self.changed_by(index, times_s[index]):
            return None
        return times_s, self._keys_s

    def skip(self, index: int) -> None:
        """Be as after the pictures before `index`, none of which is missing, after `times_to`."""
        self._waiting_s = sorted(self._waiting_s)[index:]
        self._index = index

    def _miss(self, count: int) -> None:
        if count > 0:
            self.first_lost = self._index if self.first_lost is None else self.first_lost
            self.lost += count
            self._index += count

    def finish(self, given: int) -> None:
        """Read what is left, at the end of the pictures: packets without one are lost."""
        while self._raw and self._next():
            pass
        if self._raw:
            # Counted anew: where a file's times are not its pictures', some may have seemed to be missing.
            self.lost = 0 if given >= self.count else self.lost
            self._miss(self.count - given - self.lost)
        self._waiting_s.clear()

    def remaining(self, given: int) -> int:
        """Give how many packets have no picture yet, after reading all of them."""
        while self._next():
            pass
        return max(0, self.count - given)

    def close(self) -> None:
        """Release the file."""
        self._ended = True
        if not self._elsewhere:
            with opening:
                self._capture.release()


def _are_among(times_s: list[float], all_s: list[float]) -> bool:
    rounded = {round(t_s, 6) for t_s in all_s}
    return all(round(t_s, 6) in rounded for t_s in times_s)
