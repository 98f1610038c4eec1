"""The things that moved, over the whole film: how many, how fast, along which ways."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..segmentation.object_table import OBJECT_COLUMNS
from .rows import object_rows
from .series import Series

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..capture.stream import Frame
    from ..segmentation.result import MotionSegmentation

    F64 = NDArray[np.float64]

__all__ = [
    "LASTING_FRAMES",
    "Seen",
    "Thing",
    "brief_text",
    "count_text",
    "heading",
    "lasting",
    "speed_text",
    "thing_figures",
    "thing_text",
    "value_text",
]

# What is seen for less is mostly noise, or a fragment of something else.
LASTING_FRAMES = 10

# Units of a speed, the best known first: its column and that of its deviation.
_SPEEDS = (("m/s", "speed_m_s", "speed_std_m_s"), ("px/s", "speed_px_s", "speed_std_px_s"))
# Names of eight directions, from the right clockwise as the picture shows them.
_HEADINGS = ("right", "down right", "down", "down left", "left", "up left", "up", "up right")
# A way counts from so many of its deviations; the reach of many places from more, since the furthest of them is taken.
_SURE_DEVIATIONS, _SURE_REACH_DEVIATIONS = 3.0, 6.0
# What ends nearer to its start than this share of how far it got went to and fro.
_LEAST_WAY_SHARE = 2 / 3


@dataclass(frozen=True)
class Thing:
    """One thing over the film.

    Attributes
    ----------
    id : int
    frames : int
        In how many it was seen.
    first, last : int
        The first and the last frame.
    x, y : arrays
        Its centre in each of its frames, in pixels.
    x_std, y_std : arrays
        Their standard deviations, as stated; NaN where none was.
    speed, speed_std : float
        Median speed, and the median deviation that one frame's has; NaN where they are not known.
    area : float
        Mean, in pixels.
    """

    id: int
    frames: int
    first: int
    last: int
    x: F64
    y: F64
    x_std: F64
    y_std: F64
    speed: float
    speed_std: float
    area: float

    @property
    def way(self) -> tuple[float, float]:
        """From where it was seen first to where it was seen last, in pixels."""
        return float(self.x[-1] - self.x[0]), float(self.y[-1] - self.y[0])

    @property
    def way_std(self) -> float:
        """Deviation of `way` in pixels: as stated of its ends, or by the jitter of all places if that is more."""
        stated = sum(std[end] ** 2 for std in (self.x_std, self.y_std) for end in (0, -1) if math.isfinite(std[end]))
        # Of places that are each off by themselves the second difference has six times the variance.
        bends = sum(float(np.mean(second**2)) for second in map(_second_differences, (self.x, self.y)) if len(second))
        return math.sqrt(max(stated / 2, bends / 6))

    @property
    def reach(self) -> float:
        """How far it got from where it was seen first or last, in pixels."""
        return max(float(np.nanmax(np.hypot(self.x - self.x[at], self.y - self.y[at]))) for at in (0, -1))


def _second_differences(places: F64) -> F64:
    second = np.diff(places, 2)
    return second[np.isfinite(second)]


def _median(values: F64) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else math.nan


def speeds(objects: Series) -> tuple[str, F64, F64]:
    """Give the unit, the speed and its deviation of each row: in metres where these are known, else in pixels."""
    for unit, name, std_name in _SPEEDS:
        if name in objects and np.isfinite(objects[name]).any():
            return unit, objects[name], objects[std_name]
    speed = np.hypot(objects["vx_px_per_frame"], objects["vy_px_per_frame"])
    return "px/frame", np.asarray(speed), np.full(len(speed), math.nan)


def lasting(objects: Series, *, least: int = LASTING_FRAMES, ground: bool = False) -> tuple[str, list[Thing]]:
    """Give the unit of the speeds and the things that were seen for at least so many frames, the longest first.

    With `ground` their places are in the picture of the first frame, where that is known.
    """
    unit, speed, std = speeds(objects)
    ids, frames = objects["id"], objects["frame"]
    names = ("x_ground_px", "y_ground_px") if ground and "x_ground_px" in objects else ("x_px", "y_px")
    x, y = (objects[name] for name in names)
    stated = "x_std_px" in objects and "y_std_px" in objects
    x_std, y_std = (objects["x_std_px"], objects["y_std_px"]) if stated else (np.full(len(ids), math.nan),) * 2
    area = objects["area_px"]
    order = np.argsort(ids, kind="stable")
    ends = np.flatnonzero(np.diff(ids[order])) + 1
    found = []
    for at in np.split(order, ends) if len(order) else []:
        # Where a thing is hidden it has a place that is believed, and no pixels.
        shown = at[area[at] > 0]
        if len(shown) >= least:
            number, first, last = int(ids[at[0]]), int(frames[shown[0]]), int(frames[shown[-1]])
            typical = (_median(speed[shown]), _median(std[shown]), float(area[shown].mean()))
            places = (x[shown], y[shown], x_std[shown], y_std[shown])
            found.append(Thing(number, len(shown), first, last, *places, *typical))
    return unit, sorted(found, key=lambda thing: (-thing.frames, thing.id))


def thing_figures(objects: Series, motion: Series, *, still: bool = True) -> dict[str, Any]:
    """Sum up the things that lasted; where the camera did not stand still they go over the ground.

    Returns
    -------
    dict
        ``objects`` (numbers given in all), ``lasting_objects``, ``at_once_median`` and ``at_once_max`` over the frames,
        ``thing_speed_unit``, ``thing_speed_median`` with its deviation and quantiles, the fastest thing, and
        ``headings``: how many went in which direction.
    """
    unit, found = lasting(objects, ground=not still)
    counted = motion["objects"][motion["objects"] >= 0]
    speed = np.array([thing.speed for thing in found])
    known = np.isfinite(speed)
    figures: dict[str, Any] = {
        "objects": len(np.unique(objects["id"])),
        "lasting_objects": len(found),
        "at_once_median": _median(counted),
        "at_once_max": int(counted.max()) if len(counted) else 0,
        "thing_speed_unit": unit,
        "thing_speed_median": _median(speed),
        "thing_speed_std_median": _median(np.array([thing.speed_std for thing in found])),
        "thing_speed_p10": float(np.quantile(speed[known], 0.1)) if known.any() else math.nan,
        "thing_speed_p90": float(np.quantile(speed[known], 0.9)) if known.any() else math.nan,
        "headings": dict(Counter(map(heading, found)).most_common()),
    }
    fastest = found[int(np.nanargmax(speed))] if known.any() else None
    return figures | {
        "fastest_thing": None if fastest is None else fastest.id,
        "fastest_thing_speed": math.nan if fastest is None else fastest.speed,
        "fastest_thing_speed_std": math.nan if fastest is None else fastest.speed_std,
    }


class Seen:
    """Gather the things of frame after frame, to say at the end how many and how fast they were."""

    def __init__(self, scale_m_per_px: float | None = None) -> None:
        self._scale = scale_m_per_px
        self._frames, self._blind = 0, 0
        names = tuple(dict.fromkeys(("frame", *OBJECT_COLUMNS)))
        self._objects, self._motion = Series(names), Series(("frame", "objects"))

    def add(self, frame: Frame, result: MotionSegmentation) -> None:
        """Take what moved in a frame."""
        self._frames += 1
        self._blind += result.status == "no_camera_motion"
        scale = self._scale
        for row in object_rows(frame, result, None if scale is None else lambda places: np.full(len(places), scale)):
            self._objects.append(row)
        self._motion.append({"frame": frame.index, "objects": len(result.objects)})

    def text(self) -> str:
        """Say how many things moved, and how fast; and in how many frames that could not be told."""
        said = thing_text(thing_figures(self._objects, self._motion))
        if self._blind:
            said += f" In {self._blind} of {self._frames} frames what moves could not be told: "
            said += "the flow does not tell the camera's motion."
        return said


def value_text(value: float | None, std: float | None, unit: str) -> str:
    """Write a value with its deviation, as many places as that allows: ``31 ± 3 px/s``."""
    if value is None or not math.isfinite(value):
        return "not known"
    if std is None or not math.isfinite(std) or std <= 0:
        return f"{value:.3g} {unit}"
    digits = max(0, -math.floor(math.log10(std * 1.05)))
    if std >= 10:
        # Whole tens and hundreds of a deviation would be zeros that nothing tells.
        return f"{value:.0f} ± {std:.0f} {unit}"
    return f"{value:.{digits}f} ± {std:.{digits}f} {unit}"


def thing_text(figures: dict[str, Any]) -> str:
    """Say how many things moved, and how fast."""
    said = [count_text(figures)]
    if figures["lasting_objects"]:
        said.append(speed_text(figures))
    return " ".join(said)


def count_text(figures: dict[str, Any]) -> str:
    """Say how many things moved."""
    count = figures["lasting_objects"]
    if not count:
        brief = brief_text(figures)
        return (
            f"Nothing moved on its own for {LASTING_FRAMES} frames; {brief}" if brief else "Nothing moved on its own."
        )
    text = f"{count} thing{'' if count == 1 else 's'} moved on {'its' if count == 1 else 'their'} own"
    if count > 1 and math.isfinite(figures["at_once_median"]):
        text += f", {figures['at_once_median']:.0f} at once (median; at most {figures['at_once_max']})"
    return f"{text}."


def brief_text(figures: dict[str, Any]) -> str:
    """Say how much was seen for less than `LASTING_FRAMES` frames; "" where that is nothing."""
    brief = figures["objects"] - figures["lasting_objects"]
    return f"{brief} brief {'sight' if brief == 1 else 'sights'} of something that moves." if brief else ""


def speed_text(figures: dict[str, Any]) -> str:
    """Say how fast the things were that moved, of which there is one or more."""
    count = figures["lasting_objects"]
    speed, std, unit = (figures[f"thing_speed_{name}"] for name in ("median", "std_median", "unit"))
    if not math.isfinite(speed):
        return "How fast things were is not known."
    if count == 1:
        return f"The thing that moved went at {value_text(speed, std, unit)}."
    text = f"Things that moved went at {value_text(speed, std, unit)} (median; four in five between "
    text += f"{figures['thing_speed_p10']:.3g} and {figures['thing_speed_p90']:.3g})"
    fastest = value_text(figures["fastest_thing_speed"], figures["fastest_thing_speed_std"], unit)
    return f"{text}; the fastest, number {figures['fastest_thing']}, at {fastest}."


def heading(thing: Thing) -> str:
    """Say in which of eight directions a thing went; that it went to and fro, or stayed about where it was, if it did.

    It went where its way is more than its places are off, however small that is beside its size.
    """
    dx, dy = thing.way
    if not math.isfinite(dx + dy):
        return "not known where"
    way, reach, std = math.hypot(dx, dy), thing.reach, thing.way_std
    if way > _SURE_DEVIATIONS * std and way >= _LEAST_WAY_SHARE * reach:
        return _HEADINGS[round(math.atan2(dy, dx) / (math.pi / 4)) % 8]
    return "to and fro" if reach > _SURE_REACH_DEVIATIONS * std else "about its place"
