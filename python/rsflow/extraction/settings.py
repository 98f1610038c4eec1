"""What an extraction is asked to do, checked once before anything is opened or written."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from .. import _checks
from .._checks import knobs
from .._checks.knobs import Illumination, Preset
from .._display import fields as display_fields
from ..errors import OptionError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ..camera.model import Camera
    from ..velocity import Sensors

__all__ = ["CameraMotion", "ExtractSettings", "Illumination", "Preset"]

CameraMotion = Literal["auto", "moving", "static"]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExtractSettings:
    """The options of `rsflow.extract`; see there for each.

    Examples
    --------
    >>> ExtractSettings(stride=2, preset="fast").validate()
    >>> ExtractSettings(height_m=0.2).validate()
    Traceback (most recent call last):
    rsflow.errors.OptionError: height_m: got one, expected camera= with it: a height needs a camera too, for a velocity
    """

    camera: Camera | str | os.PathLike[str] | None = None
    height_m: float | str | os.PathLike[str] | None = None
    height_std_m: float | None = None
    sensors: Sensors | None = None
    start: int | None = None
    stop: int | None = None
    stride: int = 1
    roi: tuple[int, int, int, int] | None = None
    mask: NDArray[np.bool_] | str | os.PathLike[str] | None = None
    lines: Sequence[Sequence[float]] = ()
    scale_m_per_px: float | None = None
    frame_rate: float | None = None
    times: str | os.PathLike[str] | None = None
    preset: Preset = "fast"
    illumination: Illumination = "gain_offset"
    max_displacement: float | None = None
    camera_motion: CameraMotion = "auto"
    videos: bool = True

    __repr__ = display_fields

    def validate(self) -> None:
        """Raise OptionError for what no source could satisfy."""
        from ..camera.model import Camera

        knobs.preset(self.preset)
        knobs.illumination(self.illumination)
        knobs.max_displacement(self.max_displacement)
        _checks.choice("camera_motion", self.camera_motion, get_args(CameraMotion))
        _checks.flag("videos", self.videos)
        for name, least in (("start", 0), ("stop", 0), ("stride", 1)):
            if getattr(self, name) is not None or name == "stride":
                _checks.integer(name, getattr(self, name), least=least)
        if self.roi is not None:
            _checks.region("roi", self.roi)
        if isinstance(self.mask, (str, os.PathLike)):
            _checks.path("mask", self.mask, "a bool array or a path")
        else:
            _checks.mask_or_none("mask", self.mask)
        _expect_lines(self.lines)
        if _checks.number_or_none("scale_m_per_px", self.scale_m_per_px, above=0, of="metres") and self.height_m:
            raise OptionError("scale_m_per_px: got one, expected none with camera= and height_m=, which say it too")
        _checks.number_or_none("frame_rate", self.frame_rate, above=0, of="frames per second")
        if self.times is not None:
            _checks.path("times", self.times)
        if self.camera is not None and not isinstance(self.camera, Camera):
            _checks.path("camera", self.camera, "an rsflow.Camera or a path")
        if isinstance(self.height_m, (str, os.PathLike)):
            _checks.path("height_m", self.height_m, "metres or a path")
        if self.height_m is not None and self.camera is None:
            raise OptionError(
                "height_m: got one, expected camera= with it: a height needs a camera too, for a velocity"
            )
        if self.camera is not None and self.height_m is None:
            raise OptionError(
                "camera: got one, expected height_m= with it: a camera needs a height too, for a velocity"
            )
        if self.height_m is not None and not isinstance(self.height_m, (str, os.PathLike)):
            _checks.number("height_m", self.height_m, above=0, of="metres")
        _checks.number_or_none("height_std_m", self.height_std_m, least=0, of="metres")
        if self.sensors is not None:
            from ..velocity import Sensors

            _checks.instance("sensors", self.sensors, Sensors, "an rsflow.velocity.Sensors").validate()
            if self.height_m is None:
                raise OptionError("sensors: got some, expected camera= and height_m= with them, for a velocity")

    def flat(self) -> dict[str, Any]:
        """Every option by name, those of `sensors` beside the others."""
        options = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "sensors"}
        if self.sensors is None:
            return options
        return options | {item.name: getattr(self.sensors, item.name) for item in fields(self.sensors)}

    def as_text(self) -> dict[str, str]:
        """Every option with its value, for the report and the summary."""
        return {name: _text(value) for name, value in self.flat().items()}


def _expect_lines(lines: Any) -> None:
    expected = "lines (x0, y0, x1, y1) in pixels, of two ends that are not the same"
    for line in _checks.iterable("lines", lines, expected):
        ends = [_checks.number("lines", end, of="pixels") for end in _checks.iterable("lines", line, expected)]
        if len(ends) != 4 or ends[:2] == ends[2:]:
            raise _checks.refused("lines", line, expected)


def _text(value: Any) -> str:
    if value is None:
        return "not given"
    if isinstance(value, (tuple, list)):
        return ", ".join(map(str, value)) or "not given"
    if isinstance(value, (str, int, float, bool)):
        return str(value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray):
        return f"{value.shape[1]} x {value.shape[0]} pixels, {np.count_nonzero(value)} of which count"
    return repr(value)
