"""Grey, colour and region of interest of one picture, for `rsflow.frames`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError

__all__ = ["check_roi", "to_color", "to_grey"]


def to_grey(image: NDArray[Any]) -> NDArray[Any]:
    """Turn a BGR or BGRA picture into grey, in its own type; a grey one is returned as it is."""
    if image.ndim == 2:
        return image
    if image.shape[2] == 1:
        return image[:, :, 0]
    import cv2

    grey: NDArray[Any] = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY)
    return grey


def to_color(image: NDArray[Any]) -> NDArray[Any]:
    """Turn a grey or BGRA picture into BGR, in its own type."""
    if image.ndim == 3 and image.shape[2] == 3:
        return image
    import cv2

    code = cv2.COLOR_BGRA2BGR if image.ndim == 3 and image.shape[2] == 4 else cv2.COLOR_GRAY2BGR
    color: NDArray[Any] = cv2.cvtColor(np.ascontiguousarray(image), code)
    return color


def check_roi(roi: tuple[int, int, int, int] | None, size: tuple[int, int], where: str) -> None:
    """Raise OptionError unless `roi` lies inside a picture of `size`."""
    if roi is None:
        return
    x, y, w, h = roi
    if x < 0 or y < 0 or w < 1 or h < 1 or x + w > size[0] or y + h > size[1]:
        raise OptionError(
            f"roi: got (x, y, width, height) = {roi}, "
            f"expected a region inside the {size[0]} x {size[1]} pixels of {where}"
        )
