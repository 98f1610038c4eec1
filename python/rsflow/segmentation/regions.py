"""Regions of a mask: labelled, widened, their pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]


def pixels(mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Rows and columns of what is true in a mask: `numpy.nonzero` in a fourth of its time."""
    import cv2

    found = cv2.findNonZero(mask.view(np.uint8))
    if found is None:
        return np.zeros(0, np.int32), np.zeros(0, np.int32)
    # (n, 1, 2) in OpenCV 4, (n, 2) in OpenCV 5.
    x, y = found.reshape(-1, 2).T
    return y, x


def labelled(mask: Mask) -> tuple[int, NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
    """Regions of a mask, by eight neighbours: count with the background, labels, statistics and centres."""
    import cv2

    # With statistics this algorithm takes a third of the time of OpenCV's usual one.
    count, labels, stats, centres = cv2.connectedComponentsWithStatsWithAlgorithm(
        mask.view(np.uint8), 8, cv2.CV_32S, cv2.CCL_BBDT
    )
    return count, labels, stats, centres


def dilated(mask: Mask, size: int) -> Mask:
    """Add what lies within a square of this many pixels around a pixel of the mask."""
    import cv2

    out: Mask = cv2.dilate(mask.view(np.uint8), np.ones((size, size), np.uint8)).astype(bool)
    return out
