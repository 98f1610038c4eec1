"""Going to a frame of a video without decoding all before it, exactly: by the times of its packets."""

from __future__ import annotations

import bisect
from typing import TYPE_CHECKING, Any

from ..io.opencv_files import quiet

if TYPE_CHECKING:
    from .packets import Packets

__all__ = ["LEAST_FRAMES", "gone_to"]

# Fewer frames are decoded sooner than the packets before them are read.
LEAST_FRAMES = 100

# Times of one packet and of its picture are the same number, rounded alike.
_SAME_S = 1e-6

# So many pictures before the one that is wanted must come in the order of the packets: this tells a wrong place, and
# pictures that a decoder cannot make from a key frame on come before it.
_CHECKED = 8

# Key frames that are tried, each earlier than the one before.
_TRIES = 3


def gone_to(capture: Any, packets: Packets, index: int) -> list[float] | None:
    """Set a capture so that the next picture that it decodes is frame `index`.

    Parameters
    ----------
    capture : cv2.VideoCapture
        As it was opened; where this fails it stands anywhere.
    packets : Packets
        Of the same file, at its beginning.
    index : int
        At least 1.

    Returns
    -------
    list of float or None
        Times of the frames before; None where the place cannot be known to be exact.
    """
    import cv2

    found = packets.times_to(index)
    if found is None:
        return None
    times_s, keys_s = found
    keys = {bisect.bisect_left(times_s, key_s - _SAME_S) for key_s in keys_s}
    for key in sorted((key for key in keys if key + _CHECKED <= index), reverse=True)[:_TRIES]:
        if key == 0:
            return None
        with quiet():
            if capture.set(cv2.CAP_PROP_POS_MSEC, 1e3 * times_s[key]) and _decoded_to(capture, times_s, key, index):
                return times_s[:index]
    return None


def _decoded_to(capture: Any, times_s: list[float], key: int, index: int) -> bool:
    """Decode until frame `index` is the next; False where a picture is not the one that follows."""
    import cv2

    at: int | None = None
    # A decoder may give pictures of before the key frame first.
    for _ in range(index - key + 64):
        if not capture.grab():
            return False
        t_s = round(float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3, 9)
        place = bisect.bisect_left(times_s, t_s - _SAME_S)
        known = place < len(times_s) and abs(times_s[place] - t_s) <= _SAME_S
        if not known or (at is not None and place != at + 1):
            return False
        at = place
        if at >= index - 1:
            return at == index - 1
    return False
