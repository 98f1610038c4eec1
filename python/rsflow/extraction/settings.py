"""What an extraction is asked to do, checked once before anything is opened or written."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from ..errors import OptionError

if TYPE_CHECKING:
    from ..camera.model import Camera

__all__ = ["CameraMotion", "ExtractSettings", "Illumination", "Preset"]

CameraMotion = Literal["auto", "moving", "static"]
Illumination = Literal["none", "offset", "gain_offset"]
Preset = Literal["fast", "balanced", "accurate"]


@dataclass(frozen=True, kw_only=True)
class ExtractSettings:
    """The options of `rsflow.extract`; see there for each.

    Examples
    --------
    >>> ExtractSettings(stride=2, preset="fast").validate()
    >>> ExtractSettings(height_m=0.2).validate()
    Traceback (most recent call last):
    rsflow.errors.OptionError: height_m: a height needs a camera too, since a velocity follows from both: pass camera=
    """

    camera: Camera | str | os.PathLike[str] | None = None
    height_m: float | str | os.PathLike[str] | None = None
    height_std_m: float | None = None
    start: int | None = None
    stop: int | None = None
    stride: int = 1
    roi: tuple[int, int, int, int] | None = None
    frame_rate: float | None = None
    preset: Preset = "fast"
    illumination: Illumination = "gain_offset"
    max_displacement: float | None = None
    camera_motion: CameraMotion = "auto"
    videos: bool = True

    def validate(self) -> None:
        """Raise OptionError for what no source could satisfy."""
        for name, value, allowed in (
            ("preset", self.preset, get_args(Preset)),
            ("illumination", self.illumination, get_args(Illumination)),
            ("camera_motion", self.camera_motion, get_args(CameraMotion)),
        ):
            if value not in allowed:
                raise OptionError(f"{name}: got {value!r}, expected one of {', '.join(allowed)}")
        if self.height_m is not None and self.camera is None:
            raise OptionError("height_m: a height needs a camera too, since a velocity follows from both: pass camera=")
        if self.camera is not None and self.height_m is None:
            raise OptionError("camera: a camera needs a height too, since a velocity follows from both: pass height_m=")
        if isinstance(self.height_m, (int, float)) and not (math.isfinite(self.height_m) and self.height_m > 0):
            raise OptionError(f"height_m: got {self.height_m}, expected metres above 0")
        if self.height_std_m is not None and not (math.isfinite(self.height_std_m) and self.height_std_m >= 0):
            raise OptionError(f"height_std_m: got {self.height_std_m}, expected metres, 0 or above")
        if self.stop is not None and self.stop <= (self.start or 0):
            raise OptionError(f"stop: got {self.stop}, expected a frame number above start ({self.start or 0})")

    def as_text(self) -> dict[str, str]:
        """Every option with its value, for the report and the summary."""
        return {item.name: _text(getattr(self, item.name)) for item in fields(self)}


def _text(value: Any) -> str:
    if value is None:
        return "not given"
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    if isinstance(value, (str, int, float, bool)):
        return str(value)
    if isinstance(value, Path):
        return str(value)
    return repr(value)
