"""OpenCV's background subtractors as users compose them: stabilised where the camera moves, a median after them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MEDIANS", "Stabiliser", "filtered", "subtractors", "variants"]

F64 = NDArray[np.float64]
Levels = NDArray[np.uint8]

MEDIANS = (0, 3, 5, 7, 9)
# What MOG2 and KNN write where they take a change for a shadow.
SHADOW = 127

# Corners of the first frame, and how many have to agree with its homography and with that of two frames in a row.
_CORNERS, _LEAST, _LEAST_CHAINED = 400, 40, 8
_RANSAC_PX = 1.5


def subtractors() -> Mapping[str, Callable[[], Any]]:
    """Give what this OpenCV has, with the values that OpenCV gives them."""
    import cv2

    found: dict[str, Callable[[], Any]] = {
        "OpenCV MOG2": cv2.createBackgroundSubtractorMOG2,
        "OpenCV KNN": cv2.createBackgroundSubtractorKNN,
    }
    contrib: Any = getattr(cv2, "bgsegm", None)
    if contrib is not None:
        found["OpenCV GSOC"] = contrib.createBackgroundSubtractorGSOC
        found["OpenCV CNT"] = contrib.createBackgroundSubtractorCNT
    return found


def variants(name: str) -> tuple[tuple[int, bool], ...]:
    """Give what the best is taken of: sizes of the median, and whether shadows count as moving."""
    shadows = (False, True) if name in ("OpenCV MOG2", "OpenCV KNN") else (False,)
    return tuple((size, shadow) for size in MEDIANS for shadow in shadows)


def filtered(levels: Sequence[Levels], variant: tuple[int, bool]) -> list[NDArray[np.bool_]]:
    """Masks of what a subtractor wrote."""
    import cv2

    size, shadows = variant
    masks = [np.where(picture >= (SHADOW if shadows else SHADOW + 1), np.uint8(255), np.uint8(0)) for picture in levels]
    return [(cv2.medianBlur(mask, size) if size else mask) > 0 for mask in masks]


class Stabiliser:
    """Frames laid over the first one: its corners followed (Lucas-Kanade), a homography by RANSAC.

    Where too few corners of the first frame are left, the homography is chained to that of the frame before. When the
    picture leaves the canvas, larger by `pad` of a frame on each side, another first frame is taken.
    """

    def __init__(self, make: Callable[[], Any], pad: float) -> None:
        self._make, self._pad = make, pad
        self._key: Levels | None = None
        self._canvas: Levels = np.zeros((0, 0), np.uint8)
        self._to_canvas: F64 = np.eye(3)
        self._homography: F64 = np.eye(3)

    def apply(self, image: Levels) -> Levels:
        """Give what the subtractor says of a frame, in the frame's pixels."""
        import cv2

        homography = None if self._key is None else self._found(image)
        if homography is None:
            self._start(image)
            return np.asarray(self._warped_back(np.eye(3), image.shape), np.uint8)
        self._homography, self._before = homography, image
        # What this frame does not see keeps what was there.
        self._canvas = cv2.warpPerspective(
            image, self._to_canvas @ homography, self._canvas.shape[::-1], dst=self._canvas.copy(),
            borderMode=cv2.BORDER_TRANSPARENT,
        )  # fmt: skip
        return np.asarray(self._warped_back(homography, image.shape), np.uint8)

    def _start(self, image: Levels) -> None:
        import cv2

        height, width = image.shape
        down, right = int(self._pad * height), int(self._pad * width)
        self._model, self._key, self._before, self._homography = self._make(), image, image, np.eye(3)
        self._points = cv2.goodFeaturesToTrack(image, _CORNERS, 0.01, 7)
        self._canvas = cv2.copyMakeBorder(image, down, down, right, right, cv2.BORDER_REPLICATE)
        self._to_canvas = np.array([[1.0, 0.0, right], [0.0, 1.0, down], [0.0, 0.0, 1.0]])

    def _warped_back(self, homography: F64, shape: tuple[int, ...]) -> Any:
        import cv2

        said = self._model.apply(self._canvas)
        how = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        return cv2.warpPerspective(said, self._to_canvas @ homography, shape[::-1], flags=how)

    def _found(self, image: Levels) -> F64 | None:
        """Homography of a frame to the first one; None where there is none, or it leads out of the canvas."""
        import cv2

        found = self._direct(image)
        if found is None:
            points = cv2.goodFeaturesToTrack(self._before, _CORNERS, 0.01, 7)
            step = None if points is None else self._fitted(self._before, image, points, None, _LEAST_CHAINED)
            found = None if step is None else self._homography @ step
        if found is None:
            return None
        height, width = image.shape
        corners = np.array([[[0, 0]], [[width, 0]], [[width, height]], [[0, height]]], np.float32)
        seen = cv2.perspectiveTransform(corners, found)[:, 0]
        beyond = self._pad * np.array([width, height])
        inside = (seen > -beyond) & (seen - beyond < (width, height))
        return found if inside.all() else None

    def _direct(self, image: Levels) -> F64 | None:
        import cv2

        if self._points is None or self._key is None:
            return None
        guess = cv2.perspectiveTransform(self._points, np.linalg.inv(self._homography)).astype(np.float32)
        return self._fitted(self._key, image, self._points, guess, _LEAST)

    def _fitted(self, before: Levels, after: Levels, points: Any, guess: Any, least: int) -> F64 | None:
        """Fit the homography from `after` to `before` to corners of `before`."""
        import cv2

        flags = 0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW
        there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, points, guess, flags=flags)
        height, width = after.shape
        kept = (found[:, 0] > 0) & ((there[:, 0] >= 0) & (there[:, 0] < (width, height))).all(axis=1)
        if kept.sum() < least:
            return None
        homography, inliers = cv2.findHomography(there[kept], points[kept], cv2.RANSAC, _RANSAC_PX)
        if homography is None or inliers.sum() < least:
            return None
        return np.asarray(homography, np.float64)
