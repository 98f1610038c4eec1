"""The plots: one entity for each, a value or a value with its band, for every frame that was measured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...capture.masks import share

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from ..frame import LiveFrame

__all__ = ["CLOCK", "FRAME", "SERIES", "TIME", "Series", "log_styles", "series_of", "values_of"]

# The timelines: the frame's number, its time in seconds as the tables have it, and of a live source the time of day.
FRAME, TIME, CLOCK = "frame", "t_s", "clock"

_RED, _GREEN, _BLUE = (226, 74, 51), (46, 139, 87), (52, 110, 190)
_GREY, _AMBER = (110, 110, 110), (214, 137, 16)
# Opacity of the lines of a band.
_BAND = 110
_SAMPLED = 8


@dataclass(frozen=True)
class Series:
    """One entity: a value, or with `band` a value and it less and plus its standard deviation."""

    entity: str
    name: str
    color: tuple[int, int, int]
    value: Callable[[LiveFrame], Any]
    band: bool = False

    def of(self, frame: LiveFrame) -> tuple[float, ...]:
        """Give the values of a frame; NaN, a gap in the line, for what is not known."""
        value = self.value(frame)
        if not self.band:
            return (_known(value),)
        middle, std = map(_known, value)
        return (middle, middle - std, middle + std)


def _known(value: Any) -> float:
    return float(value) if value is not None and math.isfinite(value) else math.nan


def _velocity(axis: str) -> Callable[[LiveFrame], Any]:
    def value(frame: LiveFrame) -> tuple[Any, Any]:
        told = frame.reading
        if told is None or told.velocity_status != "ok":
            return math.nan, math.nan
        return getattr(told, f"v{axis}_m_s"), getattr(told, f"v{axis}_std_m_s")

    return value


def _displacement(axis: str) -> Callable[[LiveFrame], Any]:
    return lambda frame: (frame.measured.motion[f"d{axis}_px"], frame.measured.motion[f"d{axis}_std_px"])


def _brightness(frame: LiveFrame) -> float:
    image, mask = frame.measured.frame.image, frame.measured.segmentation.mask
    image = image[::_SAMPLED, ::_SAMPLED]
    if mask is not None:
        image = image[mask[::_SAMPLED, ::_SAMPLED]]
    return float(image.mean(dtype=np.float64)) if image.size else math.nan


def _moving_share(frame: LiveFrame) -> float:
    seen = frame.measured.segmentation
    return share(seen.moving, seen.mask) if seen.valid else math.nan


SERIES = (
    Series("velocity/vx_m_s", "vx", _RED, _velocity("x"), band=True),
    Series("velocity/vy_m_s", "vy", _GREEN, _velocity("y"), band=True),
    Series("velocity/vz_m_s", "vz", _BLUE, _velocity("z"), band=True),
    Series("displacement/dx_px", "dx", _RED, _displacement("x"), band=True),
    Series("displacement/dy_px", "dy", _GREEN, _displacement("y"), band=True),
    Series("light/brightness", "mean grey level", _AMBER, _brightness),
    Series("light/gain", "gain", _AMBER, lambda frame: frame.measured.motion["gain"]),
    Series("things/count", "things that move", _BLUE, lambda frame: frame.measured.motion.get("objects")),
    Series("things/moving_share", "share of the picture that moves", _RED, _moving_share),
    Series("timing/delay_ms", "delay", _GREY, lambda frame: 1e3 * frame.delay_s),
    Series("timing/frame_rate_hz", "frames per second", _GREY, lambda frame: frame.frame_rate_hz),
    Series("timing/not_measured", "frames not measured", _RED, lambda frame: frame.not_measured),
)


def series_of(*, velocity: bool) -> tuple[Series, ...]:
    """Give what is plotted; `velocity` with a camera and a height."""
    return tuple(series for series in SERIES if velocity or not series.entity.startswith("velocity/"))


def values_of(frame: LiveFrame, series: Sequence[Series]) -> tuple[tuple[float, ...], ...]:
    """Give the values of a frame for each entity."""
    return tuple(one.of(frame) for one in series)


def log_styles(rr: Any, series: Sequence[Series]) -> list[tuple[str, Any]]:
    """Give the static styles of the lines: (entity, archetype)."""
    styles = []
    for one in series:
        pale = (*one.color, _BAND)
        names = [one.name] + (["one deviation"] * 2 if one.band else [])
        colors = [(*one.color, 255)] + ([pale, pale] if one.band else [])
        widths = [1.8] + ([0.8, 0.8] if one.band else [])
        styles.append((one.entity, rr.SeriesLines(names=names, colors=colors, widths=widths)))
    return styles


def columns(rr: Any, series: Series, values: Sequence[tuple[float, ...]]) -> Any:
    """Give the values of many frames as columns."""
    numbers: NDArray[np.float64] = np.array(values, np.float64)
    listed = rr.Scalars.columns(scalars=numbers.ravel())
    return listed.partition([numbers.shape[1]] * len(numbers)) if series.band else listed
