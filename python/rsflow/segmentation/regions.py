"""Regions of a mask: labelled, grown from seeds, filled, cleaned."""

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


def grown(weak: Mask, seeds: Mask) -> Mask:
    """Keep the connected regions of `weak` that have a seed in them."""
    import cv2

    count, labels = cv2.connectedComponents((weak | seeds).view(np.uint8), connectivity=8)
    hit = np.zeros(count, bool)
    hit[np.unique(labels[seeds])] = True
    hit[0] = False
    out: Mask = hit[labels]
    return out


def filled_hulls(certain: Mask, possible: Mask, seeds: Mask) -> Mask:
    """Grow seeds over certain and possible pixels, the latter only within the convex hull of the certain ones."""
    import cv2

    both = certain | seeds | possible
    count, labels, stats, _ = labelled(both)
    hit = np.zeros(count, bool)
    hit[np.unique(labels[seeds])] = True
    hit[0] = False
    out: Mask = (certain | seeds) & hit[labels]
    for label in np.nonzero(hit)[0]:
        left, top, width, height, _ = stats[label]
        box = np.s_[top : top + height, left : left + width]
        here = labels[box] == label
        rows, columns = np.nonzero(here & out[box])
        hull = cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32))
        inside = cv2.fillConvexPoly(np.zeros((height, width), np.uint8), hull, 1).astype(bool)
        out[box] |= here & inside
    return out


def cleaned(mask: Mask, size: int, min_area: int) -> Mask:
    """Close gaps of up to `size` pixels, fill holes, and take away regions of fewer than `min_area` pixels."""
    import cv2

    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    padded = cv2.copyMakeBorder(mask.view(np.uint8), size, size, size, size, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, kernel)
    closed = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros_like(closed)
    kept = [contour for contour in contours if cv2.contourArea(contour) + len(contour) / 2 >= min_area]
    if kept:
        cv2.drawContours(filled, kept, -1, 1, cv2.FILLED)
    inside: Mask = filled[size:-size, size:-size].astype(bool)
    return inside


def dilated(mask: Mask, size: int) -> Mask:
    """Add what lies within a square of this many pixels around a pixel of the mask."""
    import cv2

    out: Mask = cv2.dilate(mask.view(np.uint8), np.ones((size, size), np.uint8)).astype(bool)
    return out
