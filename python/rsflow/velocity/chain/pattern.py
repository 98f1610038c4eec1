"""A pattern that is fixed to the sensor, such as dirt on the lens, over ground that hardly shows.

Both pictures then say that nothing moves. What changes between them is the ground's weak texture and noise; from one
change to the next, noise has nothing in common, and texture has moved.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

# A picture that moves by less than this, in pixels, stands still.
_STILL_PX = 0.2
# It is looked at in pictures of at most this width.
_WIDTH = 160
# For so many frames of a standstill, and then in some of every so many.
_FIRST, _THEN, _SOME = 12, 60, 12
# What was seen counts for this part at the next frame.
_KEPT = 0.95
# A displacement at which changes have in common what chance does not give, in standard deviations, further away than
# this many of these pixels.
_SURE = 6.5
_FROM = 1.5
# Waves shorter than this many of these pixels count for little.
_SMOOTH = 0.7
# Blocks of this side whose change has so many times the usual energy show something else that moves.
_BLOCK = 8
_BUSY = 2.5


class FixedPattern:
    """Remembers the last change of the picture."""

    def __init__(self) -> None:
        self._change: NDArray[np.complex128] | None = None
        self._common: NDArray[np.complex128] | None = None
        self._stood = 0
        self._found = False

    def hides(self, prev: NDArray[Any], image: NDArray[Any], moved: F64, mask: NDArray[np.bool_] | None) -> bool:
        """Say whether a standstill is only that of a pattern fixed to the sensor, over ground that moves.

        Parameters
        ----------
        prev, image : (height, width)
        moved : (2,)
            Displacement of the picture in pixels.
        mask : (height, width) bool, optional
        """
        if not np.hypot(*moved) < _STILL_PX:
            self._change, self._common, self._stood, self._found = None, None, 0, False
            return False
        self._stood += 1
        if self._stood > _FIRST and self._stood % _THEN >= _SOME:
            self._change = self._common = None
            return self._found
        change = _change(prev, image, mask)
        size = change.shape
        spectrum = np.fft.rfft2(change * np.outer(np.hanning(size[0]), np.hanning(size[1])))
        before, self._change = self._change, spectrum
        if before is None:
            return self._found
        common = spectrum * np.conj(before)
        common /= np.maximum(np.abs(common), 1e-12)
        self._common = common if self._common is None else _KEPT * self._common + common
        y, x = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])[None, :]
        smooth = np.exp(-2.0 * (np.pi * _SMOOTH) ** 2 * (x * x + y * y))
        match = np.fft.irfft2(self._common * smooth, size)
        far = np.hypot(np.fft.fftfreq(size[0], 1 / size[0])[:, None], np.fft.fftfreq(size[1], 1 / size[1])) > _FROM
        most = float(match[far].max())
        # What hardly moves has most in common with itself where it is.
        self._found = most > _SURE * float(match[far].std()) and most > float(match[~far].max())
        return self._found

    def state(self) -> dict[str, Any]:
        """Everything that is known, to be kept."""
        return {"change": self._change, "common": self._common, "stood": self._stood, "found": self._found}

    def restore(self, kept: dict[str, Any]) -> None:
        """Take over what `state` gave."""
        self._change, self._common = kept["change"], kept["common"]
        self._stood, self._found = kept["stood"], kept["found"]


def _change(prev: NDArray[Any], image: NDArray[Any], mask: NDArray[np.bool_] | None) -> NDArray[np.float32]:
    """Give what changed, without what moves by itself: blocks that change much more than most."""
    with np.errstate(over="ignore", invalid="ignore"):
        change = image.astype(np.float32) - prev.astype(np.float32)
    # A pixel that is no number says nothing, here and in all frames to come.
    known = np.isfinite(change) if mask is None else mask & np.isfinite(change)
    change[~known] = 0.0
    # Squares of what float32 holds are more than it holds.
    change /= max(float(np.abs(change).max()), 1e-30)
    height, width = change.shape
    if width > _WIDTH:
        import cv2

        size = (_WIDTH, max(round(height * _WIDTH / width), 1))
        change = np.asarray(cv2.resize(change, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    rows, columns = (side // _BLOCK for side in change.shape)
    whole = change[: rows * _BLOCK, : columns * _BLOCK]
    blocks = whole.reshape(rows, _BLOCK, columns, _BLOCK)
    energy = np.square(blocks).mean(axis=(1, 3))
    busy = energy > _BUSY * max(float(np.median(energy)), 1e-12)
    blocks[np.broadcast_to(busy[:, None, :, None], blocks.shape)] = 0.0
    return change
