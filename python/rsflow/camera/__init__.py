"""The model of a camera, and the files that it is kept in."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .model import Camera, CameraFormat, CameraModel

if TYPE_CHECKING:
    from .formats import CAMERA_SUFFIXES, format_of, load_camera, save_camera

__all__ = ["CAMERA_SUFFIXES", "Camera", "CameraFormat", "CameraModel", "format_of", "load_camera", "save_camera"]

# Modules that are reached as attributes, loaded when they are.
_MODULES = ("board", "calibration", "capture", "formats")


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f".{name}", __name__)
    # What reads and writes files loads when it is used.
    if name in __all__:
        from . import formats

        return getattr(formats, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
