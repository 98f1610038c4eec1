"""What the report page shows of the things that moved: their ways, their number, their speeds."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..plotting import drawing
from .report_page import Plot, Table
from .svg import Curve, map_plot, time_plot
from .things import Thing, heading, lasting, speeds, value_text
from .velocity_plot import abscissa

if TYPE_CHECKING:
    from .outputs import Outputs
    from .series import Series

__all__ = ["thing_plots", "thing_table"]

# Ways and rows that are shown: more would hide each other.
_MOST_WAYS, _MOST_ROWS = 60, 40
# The map of ways: its longer side in pixels at most, and the quality of the JPEG below them.
_MAP_WIDTH, _MAP_QUALITY = 1000, 80


def thing_plots(outputs: Outputs, summary: Mapping[str, Any]) -> list[Plot]:
    """Draw the ways of the things, how many there were, and how fast they went."""
    objects, motion = outputs.series["objects"], outputs.series["motion"]
    if len(motion) < 2 or not len(objects):
        return []
    still = bool(summary["camera_still"])
    unit, things = lasting(objects, ground=not still)
    plots = [_ways(outputs, things, tuple(summary["size"]), summary["lines"])] if things else []
    x, x_label = abscissa(motion)
    plots.append(
        Plot(
            "How many things move",
            time_plot(
                x,
                [Curve("things at once", motion["objects"])],
                title="number of things that move over time",
                y_label="things",
                x_label=x_label,
                floor=0.0,
                y_least=2.0,
            ),
        )
    )
    if things:
        plots.append(_speeds(objects, motion, {thing.id for thing in things}, unit))
    return plots


def _ways(outputs: Outputs, things: list[Thing], size: tuple[int, ...], lines: Sequence[Mapping[str, float]]) -> Plot:
    """Draw ways over the scene, in the picture of the first frame and what lies around it."""
    shown = things[:_MOST_WAYS]
    caption = (
        "Each from where it was seen first (ring) to where it was seen last (arrow), with its number, over the scene "
        "without what moves, as the first frame shows it."
    )
    if len(things) > len(shown):
        caption += f" The {len(shown)} of {len(things)} that were seen longest."
    x, y = np.concatenate([thing.x for thing in shown]), np.concatenate([thing.y for thing in shown])
    known = np.isfinite(x + y)
    # A thing that is seen in part has its middle at the edge.
    beyond = 0.03 * max(size)
    left, right = _range(x[known], size[0], beyond)
    top, bottom = _range(y[known], size[1], beyond)
    scale = min(1.0, _MAP_WIDTH / max(right - left, bottom - top))
    around = (max(1, round((right - left) * scale)), max(1, round((bottom - top) * scale)))
    ways = [
        (str(thing.id), _hex(drawing.distinct_color(thing.id)), (thing.x - left) * scale, (thing.y - top) * scale)
        for thing in shown
    ]
    picture = None if outputs.views is None else outputs.views.ground((left, top), around, scale)
    if lines:
        caption += (
            " Dashed: how many crossed a line to its right > < and to its left, from its first end to its second."
        )
    x0, y0 = (0, 0) if outputs.settings.roi is None else outputs.settings.roi[:2]
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
    return Plot("Where things went", drawn, caption)


def _range(places: np.ndarray, length: int, beyond: float) -> tuple[float, float]:
    """Give from where to where a map reaches: over the frame, and over what lies well beyond it."""
    least, most = (float(places.min()), float(places.max())) if len(places) else (0.0, 0.0)
    return (least - beyond if least < -beyond else 0.0), (most + beyond if most > length + beyond else float(length))


def _speeds(objects: Series, motion: Series, ids: set[int], unit: str) -> Plot:
    """Draw the median and the greatest speed of the lasting things in each frame."""
    _, speed, std = speeds(objects)
    frames, index = objects["frame"], {frame: number for number, frame in enumerate(motion["frame"].tolist())}
    wanted = np.isin(objects["id"], list(ids)) & np.isfinite(speed)
    rows: dict[int, list[int]] = {}
    for row in np.flatnonzero(wanted).tolist():
        rows.setdefault(index[frames[row]], []).append(row)
    middle, spread, most = (np.full(len(motion), math.nan) for _ in range(3))
    for at, those in rows.items():
        ordered = sorted(those, key=lambda row: float(speed[row]))
        row = ordered[len(ordered) // 2]
        middle[at], spread[at], most[at] = speed[row], std[row], speed[ordered[-1]]
    x, x_label = abscissa(motion)
    return Plot(
        "How fast things are",
        time_plot(
            x,
            [Curve("median", middle, spread), Curve("the fastest", most)],
            title="speed of things over time",
            y_label=unit,
            x_label=x_label,
            floor=0.0,
        ),
        "Against the still surroundings. The band is one standard deviation of the thing in the middle.",
    )


def thing_table(outputs: Outputs) -> list[Table]:
    """List the things that were seen longest."""
    objects, motion = outputs.series["objects"], outputs.series["motion"]
    if not len(objects):
        return []
    unit, things = lasting(objects, least=1)
    times = dict(zip(motion["frame"].tolist(), motion["t_s"].tolist(), strict=True))
    rows = []
    for thing in things[:_MOST_ROWS]:
        begin, end = times.get(thing.first, math.nan), times.get(thing.last, math.nan)
        when = f"{thing.first} to {thing.last}"
        if math.isfinite(begin) and math.isfinite(end):
            when = f"{begin:.2f} to {end:.2f} s"
        speed = value_text(thing.speed, thing.speed_std, unit)
        rows.append((str(thing.id), str(thing.frames), when, speed, heading(thing), f"{thing.area:.0f}"))
    caption = f"{len(things)} in all" + (
        f"; the {_MOST_ROWS} that were seen longest:" if len(things) > _MOST_ROWS else ":"
    )
    header = ("number", "frames", "seen", "speed, median", "went", "mean area in px")
    return [Table("Moving things", header, rows, caption, frozenset({0, 1, 5}))]


def _hex(color: drawing.Color) -> str:
    blue, green, red = color
    return f"#{red:02x}{green:02x}{blue:02x}"


def _url(picture: Any) -> str | None:
    """Give a picture as the data of a JPEG in the page."""
    import cv2

    if picture is None:
        return None
    done, data = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, _MAP_QUALITY))
    return f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode('ascii')}" if done else None
