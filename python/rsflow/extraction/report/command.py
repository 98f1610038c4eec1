"""The commands that make the results again."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..settings import ExtractSettings
from .material import Material

__all__ = ["commands"]

# The option of each setting, where it is written as it is.
_PLAIN = {
    "camera": "--camera",
    "height_std_m": "--height-std",
    "start": "--start",
    "stop": "--stop",
    "stride": "--stride",
    "mask": "--mask",
    "scale_m_per_px": "--scale",
    "frame_rate": "--rate",
    "times": "--times",
    "preset": "--preset",
    "illumination": "--illumination",
    "max_displacement": "--max-displacement",
    "camera_motion": "--camera-motion",
    "rates": "--rates",
    "rate_std_rad_s": "--rate-std",
    "rate_delay_s": "--rate-delay",
    "rate_delay_std_s": "--rate-delay-std",
    "attitude": "--attitude",
    "earth": "--earth",
    "down_std_rad": "--down-std",
    "dt_std_s": "--dt-std",
    "readout_s": "--readout",
    "max_height_gap_s": "--max-height-gap",
    "max_speed_m_s": "--max-speed",
    "log_start_s": "--log-start",
}


def commands(material: Material) -> tuple[str, str]:
    """Give what to say of the commands, and the commands: of a terminal, else of Python."""
    summary, settings = material.summary, material.settings
    install = f"pip install rsflow-motion=={summary['version']}"
    source = str(summary["source"])
    given = _given(settings)
    named = Path(source).exists() or "://" in source or any(letter in source for letter in "*?")
    arguments = _arguments(given) if named else None
    if arguments is not None:
        call = shlex.join(["rsflow", "extract", *_safe(source), "-o", "out", *arguments])
        return "In a terminal, in the folder that the run was started in:", f"{install}\n{call}"
    said = "In Python; what is in angle brackets was given as an object, which a page cannot hold:"
    options = "".join(f", {name}={_python(value)}" for name, value in given.items())
    what = repr(source) if named else "<the frames>"
    return said, f"{install}\n\nimport rsflow\nrsflow.extract({what}, 'out'{options})"


def _safe(source: str) -> list[str]:
    """Give a source so that it is not taken for an option."""
    return [f"./{source}" if source.startswith("-") else source]


def _given(settings: ExtractSettings) -> dict[str, Any]:
    """Give the settings that are not the usual ones."""
    from ...velocity import Sensors

    usual = ExtractSettings(sensors=Sensors()).flat()
    found = {}
    for name, value in settings.flat().items():
        same = value is usual[name] or (isinstance(value, (str, int, float, bool)) and value == usual[name])
        empty = isinstance(value, (tuple, list)) and not value
        if not same and not empty and value is not None:
            found[name] = value
    return found


def _arguments(given: Mapping[str, Any]) -> list[str] | None:
    """Write settings as options of the command; None where one cannot be."""
    out: list[str] = []
    for name, value in given.items():
        if name == "roi":
            out += ["--roi", ",".join(str(int(part)) for part in value)]
        elif name == "lines":
            for line in value:
                out += ["--line", ",".join(f"{float(end):g}" for end in line)]
        elif name == "videos":
            out.append("--no-videos")
        elif name == "mount":
            out += ["--mount", value if isinstance(value, str) else ",".join(f"{v:.10g}" for v in np.ravel(value))]
        elif name == "height_m" and isinstance(value, (str, os.PathLike)):
            kind = _kind_of_heights(value)
            if kind is None:
                return None
            out += [f"--{kind}-csv", os.fspath(value)]
        elif name == "height_m":
            out += ["--height", f"{float(value)!r}"]
        elif isinstance(value, (str, int, float, os.PathLike)):
            out += [_PLAIN[name], str(value)]
        else:
            return None
    return out


def _kind_of_heights(path: str | os.PathLike[str]) -> str | None:
    from ...errors import RsflowError
    from ...velocity import Heights

    try:
        return str(Heights.read(path).kind)
    except (RsflowError, OSError):
        return None


def _python(value: Any) -> str:
    if isinstance(value, os.PathLike):
        return repr(os.fspath(value))
    if isinstance(value, (str, int, float, bool, tuple, list)):
        return repr(value)
    return f"<{type(value).__name__}>"
