"""A frame reduced by a whole number for judging pixels: images, masks and motion to it and back."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from .regions import pixels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]
    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

# Larger frames are reduced: outlines are then that much coarser, and the work does not grow with the sensor.
_MOST_PIXELS = 200_000


@dataclasses.dataclass(frozen=True)
class Reduction:
    """How a frame of `full` (height, width) is reduced by `factor`."""

    full: tuple[int, int]
    factor: int

    @classmethod
    def of(cls, shape: tuple[int, ...]) -> Reduction:
        """Choose the factor for a frame of this shape: a power of two."""
        factor = 1
        while shape[0] * shape[1] > _MOST_PIXELS * factor**2:
            factor *= 2
        return cls((shape[0], shape[1]), factor)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the reduced frame, as OpenCV takes them."""
        return max(self.full[1] // self.factor, 1), max(self.full[0] // self.factor, 1)

    def image(self, image: F32) -> F32:
        """Reduce an image by averaging."""
        import cv2

        if self.factor == 1:
            return image
        out: F32 = cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)
        return out

    def all(self, mask: Mask) -> Mask:
        """Reduce a mask: where it holds for every pixel."""
        if mask.all():
            return np.ones((self.size[1], self.size[0]), bool)
        return self.image(mask.astype(np.float32)) > 0.999

    def any(self, mask: Mask) -> Mask:
        """Reduce a mask: where it holds for some pixel."""
        return self.image(mask.astype(np.float32)) > 0.001

    def motion(self, uv: F32, valid: Mask) -> F32:
        """Reduce a motion, in reduced pixels then; zero where it is not valid."""
        known = uv if valid.all() else np.where(valid[..., None], uv, np.float32(0))
        return self.image(known) / np.float32(self.factor)

    def homography(self, full: F64) -> F64:
        """Bring a homography of full frames to reduced pixels."""
        if self.factor == 1:
            return full
        # Pixel centres: X = (x + 0.5) k - 0.5.
        shift = (self.factor - 1) / 2
        up = np.array([[self.factor, 0, shift], [0, self.factor, shift], [0, 0, 1.0]])
        out: F64 = np.linalg.inv(up) @ full @ up
        return out

    def point(self, full: F64) -> F64:
        """Bring a homogeneous point of full frames to reduced pixels."""
        shift = (self.factor - 1) / 2
        x, y, w = full
        return np.array([(x - shift * w) / self.factor, (y - shift * w) / self.factor, w])

    def enlarged(self, mask: Mask) -> Mask:
        """Enlarge a mask, its outline smoothed."""
        import cv2

        if self.factor == 1:
            return mask
        size = (self.full[1], self.full[0])
        out: Mask = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_LINEAR) > 0.5
        return out

    def enlarged_image(self, image: F32) -> F32:
        """Enlarge an image; what lies beside a NaN becomes NaN."""
        import cv2

        if self.factor == 1:
            return image
        out: F32 = cv2.resize(image, (self.full[1], self.full[0]), interpolation=cv2.INTER_LINEAR)
        return out

    def enlarged_motion(self, motion: F32, where: Mask) -> F32:
        """Enlarge a motion, in the full frame's pixels, at the pixels of a mask; NaN elsewhere."""
        out = np.full((*self.full, 2), np.nan, np.float32)
        rows, columns = pixels(where)
        limit = (motion.shape[0] - 1, motion.shape[1] - 1)
        near = (np.minimum(rows // self.factor, limit[0]), np.minimum(columns // self.factor, limit[1]))
        out[rows, columns] = motion[near] * np.float32(self.factor)
        return out
