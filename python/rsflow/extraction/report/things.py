"""What the page shows of the things that moved: their ways, their number, their speeds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...plotting import drawing
from ..series import Series
from ..things import Thing, heading, lasting, speeds, value_text
from .map_plot import map_plot, small_way
from .material import Material
from .parts import Part, Plot, Table, Text, data_url
from .time_plot import Curve, time_plot
from .velocity_plot import abscissa

__all__ = ["count_plot", "speed_plot", "thing_map", "thing_table"]

# Ways and rows that are shown: more would hide each other.
_MOST_WAYS, _MOST_ROWS = 60, 40
# The map of ways: its longer side in pixels at most, and the quality of the JPEG below them.
_MAP_WIDTH, _MAP_QUALITY = 1000, 80


def _has_things(material: Material) -> bool:
    return len(material.series["motion"]) > 1 and len(material.series["objects"]) > 0


def count_plot(material: Material) -> list[Plot]:
    """Draw how many things there were at once."""
    if not _has_things(material):
        return []
    motion = material.series["motion"]
    x, x_label = abscissa(motion)
    drawn = time_plot(
        x,
        [Curve("things at once", motion["objects"])],
        title="number of things that move over time",
        y_label="things",
        x_label=x_label,
        floor=0.0,
        y_least=5.0,
        whole=True,
    )
    return [Plot("How many things move", drawn)]


def thing_map(material: Material) -> list[Plot]:
    """Draw ways over the scene, in the picture of the first frame and what lies around it."""
    _, things = lasting(material.series["objects"], ground=not material.still)
    shown = [thing for thing in things if np.isfinite(thing.x + thing.y).any()][:_MOST_WAYS]
    lines, size = material.summary["lines"], material.summary["size"]
    if not shown and not lines:
        return []
    caption = (
        "Each from where it was seen first (ring) to where it was seen last (arrow), with its number, over the scene "
        "without what moves, as the first frame shows it."
    )
    if len(things) > len(shown):
        caption += f" The {len(shown)} of {len(things)} that were seen longest."
    places = [np.concatenate([np.zeros(0), *(getattr(thing, axis) for thing in shown)]) for axis in "xy"]
    known = np.isfinite(places[0] + places[1])
    # A thing that is seen in part has its middle at the edge.
    beyond = 0.03 * max(size)
    left, right = _range(places[0][known], size[0], beyond)
    top, bottom = _range(places[1][known], size[1], beyond)
    scale = min(1.0, _MAP_WIDTH / max(right - left, bottom - top))
    around = (max(1, round((right - left) * scale)), max(1, round((bottom - top) * scale)))
    ways = [(str(thing.id), _hex(thing.id), (thing.x - left) * scale, (thing.y - top) * scale) for thing in shown]
    picture = None if material.ground is None else material.ground((left, top), around, scale)
    if lines:
        caption += (
            " Dashed: how many crossed a line to its right > < and to its left, from its first end to its second."
        )
    x0, y0 = (0, 0) if material.settings.roi is None else material.settings.roi[:2]
    marks = [
        (
            f"{line['to_right']} > < {line['to_left']}",
            tuple(
                (line[f"{axis}{end}_px"] - start) * scale
                for end in (0, 1)
                for axis, start in zip("xy", (left + x0, top + y0), strict=True)
            ),
        )
        for line in lines
    ]
    drawn = map_plot(ways, around, title="ways of things", picture=_url(picture), dashed=marks)
    return [Plot("Where things went", drawn, caption)]


def _range(places: np.ndarray, length: int, beyond: float) -> tuple[float, float]:
    """Give from where to where a map reaches: over the frame, and over what lies well beyond it."""
    least, most = (float(places.min()), float(places.max())) if len(places) else (0.0, 0.0)
    return (least - beyond if least < -beyond else 0.0), (most + beyond if most > length + beyond else float(length))


def speed_plot(material: Material) -> list[Plot]:
    """Draw the median and the greatest speed of the lasting things in each frame."""
    if not _has_things(material):
        return []
    objects, motion = material.series["objects"], material.series["motion"]
    unit, things = lasting(objects)
    if not things:
        return []
    middle, spread, most = _each_frame(objects, motion, {thing.id for thing in things})
    x, x_label = abscissa(motion)
    drawn = time_plot(
        x,
        [Curve("median", middle, spread), *([Curve("the fastest", most)] if len(things) > 1 else [])],
        title="speed of things over time",
        y_label=unit,
        x_label=x_label,
        floor=0.0,
    )
    caption = "Against the still surroundings. The band is one standard deviation of the thing in the middle."
    return [Plot("How fast things are", drawn, caption)]


def _each_frame(objects: Series, motion: Series, ids: set[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give for each frame the median speed with its deviation and the greatest one; NaN where there is none."""
    _, speed, std = speeds(objects)
    frames = motion["frame"]
    rows = np.flatnonzero(np.isin(objects["id"], list(ids)) & np.isfinite(speed))
    # Frames come in order, and so do the rows of the table.
    at = np.searchsorted(frames, objects["frame"][rows])
    order = np.lexsort((speed[rows], at))
    rows, at = rows[order], at[order]
    middle, spread, most = (np.full(len(motion), math.nan) for _ in range(3))
    begins = np.flatnonzero(np.concatenate([np.ones(min(len(at), 1), bool), np.diff(at) > 0]))
    counts = np.diff([*begins, len(at)])
    middles = rows[begins + counts // 2] if len(begins) else rows
    where = at[begins]
    middle[where], spread[where] = speed[middles], std[middles]
    most[where] = speed[rows[begins + counts - 1]] if len(begins) else speed[rows]
    return middle, spread, most


def thing_table(material: Material) -> list[Part]:
    """List the things that were seen longest."""
    objects, motion = material.series["objects"], material.series["motion"]
    if not len(objects):
        return [Text("No thing was seen to move on its own.")]
    unit, things = lasting(objects, least=1, ground=not material.still)
    shown = things[:_MOST_ROWS]
    times = dict(zip(motion["frame"].tolist(), motion["t_s"].tolist(), strict=True))
    rows = []
    for thing in shown:
        begin, end = times.get(thing.first, math.nan), times.get(thing.last, math.nan)
        when = f"frames {thing.first} to {thing.last}"
        if math.isfinite(begin) and math.isfinite(end):
            when = f"{begin:.2f} to {end:.2f} s"
        speed = value_text(thing.speed, thing.speed_std, unit)
        rows.append((str(thing.id), speed, heading(thing), when, str(thing.frames), f"{thing.area:.0f} px"))
    caption = f"{len(things)} in all, those that were seen longest first."
    if len(things) > len(shown):
        caption = f"The {len(shown)} of {len(things)} that were seen longest; all of them, frame by frame, are in "
        caption += f"{material.files['objects'].name if 'objects' in material.files else 'objects.csv'}."
    caption += " Speeds are medians with the standard deviation of one frame."
    header = ("number", "speed", "went", "seen", "frames", "mean area")
    size = material.summary["size"]
    marks = [
        (_hex(thing.id), small_way(*_drawn(thing, size), "#fff", (size[0], size[1])), str(thing.id)) for thing in shown
    ]
    return [Table("Things that moved", header, rows, caption, frozenset({0, 1, 4, 5}), marks=marks)]


def _drawn(thing: Thing, size: Any) -> tuple[np.ndarray, np.ndarray]:
    """Give the way of a thing, moved into the picture where it lies beyond."""
    places = []
    for values, length in ((thing.x, size[0]), (thing.y, size[1])):
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
        shrunk = min(1.0, length / max(high - low, 1e-9))
        places.append((values - low) * shrunk + min(max(low, 0.0), max(length - (high - low) * shrunk, 0.0)))
    return places[0], places[1]


def _hex(number: int) -> str:
    blue, green, red = drawing.distinct_color(number)
    return f"#{red:02x}{green:02x}{blue:02x}"


def _url(picture: Any) -> str | None:
    """Give a picture as the data of a JPEG in the page."""
    import cv2

    if picture is None:
        return None
    done, data = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, _MAP_QUALITY))
    return data_url(data.tobytes()) if done else None
