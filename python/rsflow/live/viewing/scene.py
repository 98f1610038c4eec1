"""The picture with what is drawn on it: the mask of what moves, arrows, things with their speeds, and their paths."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._display import displayed
from ...plotting.drawing import distinct_color
from .arrows import Arrows, ArrowScale, arrows_of
from .mask_png import mask_png

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..frame import LiveFrame

    F64 = NDArray[np.float64]

__all__ = ["Scene", "speed_of"]

_QUALITY = 80
_MOVING = (255, 70, 40, 95)
_THING_ARROW, _SCENE_ARROW = (255, 225, 60, 255), (160, 200, 215, 190)
# The viewer's pixels begin at their edge, ours at their centre.
_CENTRE = 0.5
# Line widths in pixels of the screen: negative for Rerun.
_LINE, _THIN = -1.5, -1.0


def speed_of(row: dict[str, Any]) -> tuple[float, float, str]:
    """Give speed, deviation and unit of a row of ``objects.csv``: in metres where these are known."""
    for unit, name in (("m/s", "speed_m_s"), ("px/s", "speed_px_s")):
        value = row.get(name)
        if value is not None and math.isfinite(value):
            return float(value), float(row.get(name.replace("speed_", "speed_std_")) or math.nan), unit
    vx, vy = row.get("vx_px_per_frame", math.nan), row.get("vy_px_per_frame", math.nan)
    return math.hypot(vx, vy), math.nan, "px a frame"


class Scene:
    """Make the entities below ``camera`` for a frame."""

    def __init__(self) -> None:
        self._scale = ArrowScale()
        # How many times as long as the motion the arrows of the last frame are.
        self.zoom = 1

    def entities(self, rr: Any, frame: LiveFrame, paths: dict[int, F64]) -> list[tuple[str, Any]]:
        """Give (entity, archetype) of a frame; `paths` are those of `Paths.shown`."""
        measured = frame.measured
        seen, flow = measured.segmentation, measured.flow
        return [
            ("camera/picture", rr.EncodedImage(contents=_jpeg(measured.frame), media_type="image/jpeg")),
            ("camera/moving", rr.EncodedImage(contents=mask_png(seen.moving, _MOVING), media_type="image/png")),
            ("camera/arrows", self._arrows(rr, None if flow is None else arrows_of(flow, seen))),
            ("camera/things", _boxes(rr, [row for row in measured.objects if row["area_px"] > 0])),
            ("camera/paths", _strips(rr, paths)),
        ]

    def styles(self, rr: Any) -> list[tuple[str, Any]]:
        """Give what holds for all frames: what lies over what."""
        order = {"picture": 0.0, "moving": 1.0, "arrows": 2.0, "paths": 3.0, "things": 4.0}
        kinds = {"picture": rr.EncodedImage, "moving": rr.EncodedImage, "arrows": rr.Arrows2D}
        kinds |= {"paths": rr.LineStrips2D, "things": rr.Boxes2D}
        return [(f"camera/{name}", kinds[name].from_fields(draw_order=order[name])) for name in order]

    def _arrows(self, rr: Any, found: Arrows | None) -> Any:
        if found is None or not len(found.origins):
            return rr.Arrows2D(vectors=np.zeros((0, 2)), origins=np.zeros((0, 2)))
        of = found.vectors[found.things] if found.things.any() else found.vectors
        self.zoom = self._scale.fitted(of, found.step)
        colors = np.where(found.things[:, None], _THING_ARROW, _SCENE_ARROW).astype(np.uint8)
        return rr.Arrows2D(
            vectors=found.vectors * self.zoom, origins=found.origins + _CENTRE, colors=colors, radii=_LINE
        )


def _jpeg(frame: Any) -> bytes:
    import cv2

    picture = frame.image if frame.color is None else frame.color
    done, data = cv2.imencode(
        ".jpg", picture if picture.dtype == np.uint8 else displayed(picture), (cv2.IMWRITE_JPEG_QUALITY, _QUALITY)
    )
    return data.tobytes() if done else b""


def _rgb(number: int) -> tuple[int, int, int]:
    blue, green, red = distinct_color(number)
    return red, green, blue


def _boxes(rr: Any, rows: list[dict[str, Any]]) -> Any:
    boxes = np.array(
        [[row[name] for name in ("left_px", "top_px", "width_px", "height_px")] for row in rows], np.float64
    ).reshape(-1, 4)
    labels = []
    for row in rows:
        speed, _, unit = speed_of(row)
        labels.append(f"{row['id']}" + (f": {speed:.3g} {unit}" if math.isfinite(speed) else ""))
    return rr.Boxes2D(
        array=boxes,
        array_format=rr.Box2DFormat.XYWH,
        labels=labels,
        colors=[_rgb(row["id"]) for row in rows],
        radii=_LINE,
    )


def _strips(rr: Any, paths: dict[int, F64]) -> Any:
    return rr.LineStrips2D(
        [path + _CENTRE for path in paths.values()], colors=[_rgb(number) for number in paths], radii=_THIN
    )
