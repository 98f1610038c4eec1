"""Frames reduced by a whole number, a power of two, as `_core.Segmenter` judges flow on them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]
    Shape = tuple[int, ...]


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


def _whole(image: NDArray[Any], small: Shape) -> NDArray[Any]:
    """Add to blocks at the right and at the bottom the pixels that they lack, like their neighbours."""
    import cv2

    by = factor(image.shape, small)
    lacks = (small[0] * by - image.shape[0], small[1] * by - image.shape[1])
    if lacks == (0, 0):
        return image
    return np.asarray(cv2.copyMakeBorder(image, 0, lacks[0], 0, lacks[1], cv2.BORDER_REPLICATE))
