"""A pattern that is fixed to the sensor, such as dirt on the lens, over ground that hardly shows.

Both pictures then say that nothing moves. What changes between them is the ground's weak texture and noise; from one
change to the next, noise has nothing in common, and texture has moved.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..shift import estimate_shift

F64 = NDArray[np.float64]

# A picture that moves by less than this, in pixels, stands still.
_STILL_PX = 0.2
# It is asked at each of so many frames of a standstill, then at every so many.
_FIRST, _THEN = 4, 8
# Changes have moved if they did by this many pixels.
_MOVED_PX = 0.5
# Blocks of this side whose change has so many times the usual energy show something else that moves.
_BLOCK = 8
_BUSY = 2.5


class FixedPattern:
    """Remembers the last change of the picture."""

    def __init__(self) -> None:
        self._change: NDArray[np.float32] | None = None
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
            self._change, self._stood, self._found = None, 0, False
            return False
        self._stood += 1
        if self._stood > _FIRST and self._stood % _THEN not in (0, _THEN - 1):
            self._change = None
            return self._found
        change, before = _change(prev, image, mask), self._change
        self._change = change
        if before is not None:
            shift = estimate_shift(before, change)
            self._found = shift.valid and float(np.hypot(shift.dx, shift.dy)) > _MOVED_PX
        return self._found

    def state(self) -> dict[str, Any]:
        """Everything that is known, to be kept."""
        return {"change": self._change, "stood": self._stood, "found": self._found}

    def restore(self, kept: dict[str, Any]) -> None:
        """Take over what `state` gave."""
        self._change, self._stood, self._found = kept["change"], kept["stood"], kept["found"]


def _change(prev: NDArray[Any], image: NDArray[Any], mask: NDArray[np.bool_] | None) -> NDArray[np.float32]:
    """Give what changed, without what moves by itself: blocks that change much more than most."""
    change = image.astype(np.float32) - prev.astype(np.float32)
    if mask is not None:
        change[~mask] = 0.0
    rows, columns = (side // _BLOCK for side in change.shape)
    whole = change[: rows * _BLOCK, : columns * _BLOCK]
    blocks = whole.reshape(rows, _BLOCK, columns, _BLOCK)
    energy = np.square(blocks).mean(axis=(1, 3))
    busy = energy > _BUSY * max(float(np.median(energy)), 1e-12)
    blocks[np.broadcast_to(busy[:, None, :, None], blocks.shape)] = 0.0
    return change
