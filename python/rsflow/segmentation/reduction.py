"""Frames reduced by a whole number, a power of two, as `_core.Segmenter` judges flow on them: to it and back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from .regions import pixels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]
    Mask = NDArray[np.bool_]
    Shape = tuple[int, ...]

_Scalar = TypeVar("_Scalar", bound="np.generic")


def factor(shape: Shape, small: Shape) -> int:
    """How many times smaller a reduced frame is; blocks at its right and its bottom may lack pixels."""
    return max(-(-shape[0] // small[0]), -(-shape[1] // small[1]))


def reduced(image: NDArray[Any], small: Shape) -> NDArray[Any]:
    """Reduce a frame by the means of its blocks."""
    import cv2

    by = factor(image.shape, small)
    if by == 1:
        return image
    return np.asarray(cv2.resize(_whole(image, small), (small[1], small[0]), interpolation=cv2.INTER_AREA))


def all_of(mask: Mask, small: Shape) -> Mask:
    """Reduce a mask: where it holds for every pixel of a block."""
    by = factor(mask.shape, small)
    blocks = _whole(mask.view(np.uint8), small).reshape(small[0], by, small[1], by)
    return np.asarray(blocks.all(axis=(1, 3)), np.bool_)


def enlarged(plane: NDArray[_Scalar], shape: Shape) -> NDArray[_Scalar]:
    """Give each pixel of a frame the value of its block; a plane of the frame's size is given as it is."""
    import cv2

    by = factor(shape, plane.shape)
    if by == 1:
        return plane
    size = (plane.shape[1] * by, plane.shape[0] * by)
    whole = cv2.resize(plane, size, interpolation=cv2.INTER_NEAREST)
    return np.ascontiguousarray(whole[: shape[0], : shape[1]], plane.dtype)


def enlarged_at(where: Mask, motion: F32) -> F32:
    """Give the pixels of a mask the vectors of their blocks; NaN elsewhere."""
    by = factor(where.shape, motion.shape)
    out = np.full((*where.shape, 2), np.nan, np.float32)
    rows, columns = pixels(where)
    out[rows, columns] = motion[rows // by, columns // by]
    return out


def _whole(image: NDArray[Any], small: Shape) -> NDArray[Any]:
    """Add to blocks at the right and at the bottom the pixels that they lack, like their neighbours."""
    import cv2

    by = factor(image.shape, small)
    lacks = (small[0] * by - image.shape[0], small[1] * by - image.shape[1])
    if lacks == (0, 0):
        return image
    return np.asarray(cv2.copyMakeBorder(image, 0, lacks[0], 0, lacks[1], cv2.BORDER_REPLICATE))
