"""Tracked points over the picture that they were tracked in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .._display import displayed
from . import drawing

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["draw_points"]

# A point is a disc of about this share of the picture's width, and at least of so many pixels.
_RADIUS_SHARE, _LEAST_RADIUS = 1 / 400, 2


def draw_points(
    picture: NDArray[Any], points: NDArray[np.float32], origins: NDArray[np.float32], ids: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """Draw each point that has a position as a disc in the colour of its number, with a line from where it was."""
    out = displayed(picture)
    radius = max(_LEAST_RADIUS, round(out.shape[1] * _RADIUS_SHARE))
    for point, origin, number in zip(points, origins, ids.tolist(), strict=True):
        if not np.isfinite(point).all():
            continue
        color = drawing.distinct_color(number)
        if np.isfinite(origin).all():
            drawing.polylines(out, [np.stack([origin, point]).astype(np.float64)], color, 1)
        drawing.disc(out, point, radius, color)
    return out
