"""How many things crossed lines, from the table of the things."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..segmentation.object_table import TrackedObject
from ..segmentation.tracks.lines import CountingLine

if TYPE_CHECKING:
    from .series import Series
    from .settings import ExtractSettings

__all__ = ["crossings"]

_NAMES = ("id", "x_px", "y_px", "left_px", "top_px", "width_px", "height_px", "x_ground_px", "y_ground_px")


def crossings(objects: Series, settings: ExtractSettings) -> list[CountingLine]:
    """Count over all frames the things that crossed the lines of the settings.

    Lines lie in the whole picture, the places of the table in the part of it that was looked at.
    """
    lines = [CountingLine(*ends) for ends in settings.lines]
    if not lines or not len(objects):
        return lines
    left, top = (0, 0) if settings.roi is None else settings.roi[:2]
    for number, x, y, box_x, box_y, width, height, x_ground, y_ground in zip(
        *(objects[name].tolist() for name in _NAMES), strict=True
    ):
        box = int(box_x), int(box_y), int(width), int(height)
        ground = {"x_ground_px": x_ground + left, "y_ground_px": y_ground + top}
        thing = TrackedObject(int(number), x + left, y + top, box, 0, 0.0, 0.0, 1, **ground)
        for line in lines:
            line.update([thing])
    return lines
