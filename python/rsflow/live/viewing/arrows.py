"""Arrows for the viewer: on what moves, and sparser on the scene of a camera that moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...plotting import arrows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ...flow.field import FlowField
    from ...segmentation.result import MotionSegmentation

    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

__all__ = ["ArrowScale", "Arrows", "arrows_of"]

# So many arrows stand side by side; of the scene every second one each way.
_ACROSS, _SCENE_STEP = 40, 2
# The scene's motion is drawn from here on, in pixels: below, it may be the flow's own error.
_LEAST_SCENE_PX = 0.25
# Arrows are longer than the motion by one of these, so that most of them reach about as far as they stand apart.
_ZOOMS = (1, 2, 5, 10, 20, 50, 100)
_REACH = 1.2


@dataclass(frozen=True)
class Arrows:
    """Where arrows begin and the motion that they show, (n, 2) each, and which of them are of things."""

    origins: F64
    vectors: F64
    things: Mask
    step: int


def arrows_of(flow: FlowField, seen: MotionSegmentation) -> Arrows:
    """Choose arrows: they begin where a pixel is now, and show how far it came since the frame before."""
    height, width = flow.valid.shape
    step = max(4, round(max(height, width) / _ACROSS))
    points = arrows.grid(height, width, step)
    columns, rows = points.astype(int).T
    vectors = flow.uv[rows, columns].astype(np.float64)
    valid = flow.valid[rows, columns] & np.isfinite(vectors).all(axis=1)
    vectors[~valid] = 0
    now = points + vectors
    x, y = np.rint(now).astype(int).T
    inside = valid & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    on_thing = np.zeros(len(points), bool)
    on_thing[inside] = seen.moving[y[inside], x[inside]]
    chosen = on_thing
    if seen.camera_model not in ("static", "none"):
        sparse = ((columns // step) % _SCENE_STEP == 0) & ((rows // step) % _SCENE_STEP == 0)
        chosen = on_thing | (inside & sparse & (np.hypot(*vectors.T) > _LEAST_SCENE_PX))
    return Arrows(now[chosen], vectors[chosen], on_thing[chosen], step)


class ArrowScale:
    """How many times as long as the motion arrows are: a round number that changes seldom.

    Examples
    --------
    >>> scale = ArrowScale()
    >>> [scale.fitted(np.array([[length, 0.0]]), step=16) for length in (0.5, 0.45, 4.0)]
    [20, 20, 2]
    """

    def __init__(self) -> None:
        self._zoom = _ZOOMS[0]
        self._begun = False

    def fitted(self, vectors: F64, step: int) -> int:
        """Give it for the motion of a frame, (n, 2), and arrows that stand `step` pixels apart."""
        if len(vectors):
            length = float(np.quantile(np.hypot(*vectors.T), 0.9))
            wanted = _REACH * step / max(length, 1e-6)
            # Kept as long as arrows are neither a third nor three times as long as they should be.
            if not self._begun or not self._zoom / 3 < wanted < 3 * self._zoom:
                self._zoom = max((zoom for zoom in _ZOOMS if zoom <= wanted), default=_ZOOMS[0])
                self._begun = True
        return self._zoom
