"""The still surroundings: a motion-compensated temporal median over a bounded number of frames.

Each kept frame carries the map from its pixels to the current frame's. At intervals the frames are warped into the
current one, brought to its light, and their median is taken without the pixels that were moving. Between these times
the median itself is warped.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from .photometric import fit_light

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]
    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

# Frames in the median, and after how many frames one is replaced: at first every frame, to have a median soon, then
# seldom, so that it spans a time in which things move on.
_FRAMES = 9
_LONGEST_STRIDE = 6
_FEWEST_SAMPLES = 2

# What one core's cache holds.
_BAND_BYTES = 512 * 1024

# Sorting network for nine values (Knuth, The Art of Computer Programming 3, 5.3.4): 25 comparators.
_NETWORK = (
    (0, 1), (3, 4), (6, 7), (1, 2), (4, 5), (7, 8), (0, 1), (3, 4), (6, 7), (0, 3), (3, 6), (0, 3), (1, 4), (4, 7),
    (1, 4), (2, 5), (5, 8), (2, 5), (1, 3), (5, 7), (2, 6), (4, 6), (2, 4), (2, 3), (5, 6),
)  # fmt: skip


@dataclasses.dataclass
class _Kept:
    """A frame, what moved in it, and the homography from its pixels to the current frame's."""

    image: NDArray[Any]
    moving: Mask
    to_current: F64


def warped(image: NDArray[Any], to_current: F64, *, missing: float, nearest: bool = False) -> NDArray[Any]:
    """Warp an image into the current frame; `missing` where it has no pixel."""
    import cv2

    if np.array_equal(to_current, np.eye(3)):
        return image
    height, width = image.shape
    flags = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    out: NDArray[Any] = cv2.warpPerspective(
        image, to_current, (width, height), flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=missing
    )
    return out


def median(stack: list[F32]) -> tuple[F32, NDArray[np.uint8]]:
    """Lower median of up to nine images of float32 without their infinite values, and how many were finite.

    Where there is none, the median is NaN.
    """
    height, width = stack[0].shape
    out = np.full((height, width), np.nan, np.float32)
    count = np.zeros((height, width), np.uint8)
    # Bands of rows that stay in the cache through the sorting network.
    rows = max(1, _BAND_BYTES // (4 * width * _FRAMES))
    scratch = np.empty((_FRAMES + 1, rows, width), np.float32)
    for top in range(0, height, rows):
        band = slice(top, min(top + rows, height))
        n = band.stop - top
        planes = [scratch[i, :n] for i in range(_FRAMES)]
        spare = scratch[_FRAMES, :n]
        for i, plane in enumerate(planes):
            plane[...] = stack[i][band] if i < len(stack) else np.inf
            if i < len(stack):
                count[band] += np.isfinite(plane)
        for i, j in _NETWORK:
            np.minimum(planes[i], planes[j], out=spare)
            np.maximum(planes[i], planes[j], out=planes[j])
            planes[i], spare = spare, planes[i]
        for number in range(1, len(stack) + 1):
            np.copyto(out[band], planes[(number - 1) // 2], where=count[band] == number)
    return out, count


class Background:
    """Keep frames, and give what the current picture would be without what moves."""

    def __init__(self) -> None:
        self._kept: list[_Kept] = []
        self._picture: F32 | None = None
        self._to_current: F64 = np.eye(3)
        self._since = 0
        self._stride = 1

    def reset(self) -> None:
        """Forget everything, as at a cut."""
        self.__init__()  # type: ignore[misc]

    def follow(self, camera_motion: F64) -> None:
        """Carry all maps on to the next frame."""
        for kept in self._kept:
            kept.to_current = _normalised(camera_motion @ kept.to_current)
        self._to_current = _normalised(camera_motion @ self._to_current)

    def picture(self, shape: tuple[int, ...]) -> F32:
        """Background at the current frame's pixels, in the light of its own last frame; NaN where it is not known."""
        if self._picture is None:
            return np.full(shape, np.nan, np.float32)
        picture: F32 = warped(self._picture, self._to_current, missing=np.nan)
        return picture

    @property
    def kept(self) -> int:
        """Number of frames kept."""
        return len(self._kept)

    def amend_first(self, moving: Mask) -> None:
        """Say what moved in the only frame kept so far, which nothing was known of when it was added."""
        self._kept[0].moving |= moving

    def add(self, image: F32, moving: Mask) -> None:
        """Offer the current frame with what moves in it; it is kept when it is time for one."""
        self._since += 1
        if self._since < self._stride:
            return
        self._since = 0
        if len(self._kept) == _FRAMES:
            self._kept.pop(0)
            self._stride = min(self._stride + 1, _LONGEST_STRIDE)
        self._kept.append(_Kept(image.copy(), moving.copy(), np.eye(3)))
        self._rebuild(image, moving)

    def _rebuild(self, image: F32, moving: Mask) -> None:
        stack = []
        for kept in self._kept:
            frame: F32 = warped(kept.image, kept.to_current, missing=np.inf)
            away = warped(kept.moving.view(np.uint8), kept.to_current, missing=0, nearest=True).astype(bool)
            gain, offset = fit_light(frame, image, ~(away | moving))
            frame = frame * np.float32(gain) + np.float32(offset)
            frame[away] = np.inf
            stack.append(frame)
        picture, samples = median(stack)
        # One still sample may be of a thing that had not moved yet, as in the first frame.
        picture[samples < min(_FEWEST_SAMPLES, len(stack))] = np.nan
        self._picture, self._to_current = picture, np.eye(3)


def _normalised(homography: F64) -> F64:
    out: F64 = homography / homography[2, 2]
    return out
