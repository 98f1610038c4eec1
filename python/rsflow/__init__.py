"""Motion from picture sequences on a CPU.

How far a window moved, where every point and pixel went, what moves and what stands still, and how fast a camera
travels over the ground, in changing light and over large displacements.

Motion is from `prev` to `next`: what was at (x, y) in `prev` is at (x + u, y + v) in `next`, with x to the right,
y down, pixel centres at integers. Heavy modules load when they are first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from . import _core
from ._core import __version__, build_info, get_num_threads
from .errors import (
    CalibrationError,
    CaptureError,
    DTypeError,
    FormatError,
    InternalError,
    MissingExtraError,
    OptionError,
    OutOfMemoryError,
    RsflowError,
    ShapeError,
)

if TYPE_CHECKING:
    from .batch import extract_many
    from .calibration import Calibration, calibrate
    from .camera import Camera
    from .capture import Frame, Frames, frames
    from .extraction import Extraction, ExtractionInterrupted, PartialExtractionError, extract
    from .flow import DenseFlow, FlowField, dense_flow
    from .grid import Grid, GridSequence, GridStatus, displacement_grid
    from .io import read_flow, write_flow
    from .plotting import QuiverStyle, flow_to_color, quiver
    from .scale import (
        Contact,
        ContactStatus,
        HeightFromSpeed,
        HeightStatus,
        ScaleCheck,
        ScaleStatus,
        TimeToContact,
        check_scale,
        height_from_speed,
        time_to_contact,
    )
    from .segmentation import MotionSegmentation, MotionSegmenter, SegmentationStatus
    from .shift import Shift, ShiftStatus, estimate_shift
    from .tracking import PointStatus, PointTracker, Tracks, detect_corners, track_points
    from .velocity import FilteredVelocity, FilterStatus, Velocity, VelocityEstimator, VelocityFilter, VelocityStatus
    from .video import VideoWriter

# Where each public name lives; the module is imported when the name is first used.
_LAZY: dict[str, str] = {
    "Calibration": ".calibration",
    "Camera": ".camera",
    "Contact": ".scale",
    "ContactStatus": ".scale",
    "DenseFlow": ".flow",
    "Extraction": ".extraction",
    "ExtractionInterrupted": ".extraction",
    "FilterStatus": ".velocity",
    "FilteredVelocity": ".velocity",
    "FlowField": ".flow",
    "Frame": ".capture",
    "Frames": ".capture",
    "Grid": ".grid",
    "GridSequence": ".grid",
    "GridStatus": ".grid",
    "HeightFromSpeed": ".scale",
    "HeightStatus": ".scale",
    "MotionSegmentation": ".segmentation",
    "MotionSegmenter": ".segmentation",
    "PartialExtractionError": ".extraction",
    "PointStatus": ".tracking",
    "PointTracker": ".tracking",
    "QuiverStyle": ".plotting",
    "ScaleCheck": ".scale",
    "ScaleStatus": ".scale",
    "SegmentationStatus": ".segmentation",
    "Shift": ".shift",
    "ShiftStatus": ".shift",
    "TimeToContact": ".scale",
    "Tracks": ".tracking",
    "Velocity": ".velocity",
    "VelocityEstimator": ".velocity",
    "VelocityFilter": ".velocity",
    "VelocityStatus": ".velocity",
    "VideoWriter": ".video",
    "calibrate": ".calibration",
    "check_scale": ".scale",
    "dense_flow": ".flow",
    "detect_corners": ".tracking",
    "displacement_grid": ".grid",
    "estimate_shift": ".shift",
    "extract": ".extraction",
    "extract_many": ".batch",
    "flow_to_color": ".plotting",
    "frames": ".capture",
    "height_from_speed": ".scale",
    "quiver": ".plotting",
    "read_flow": ".io",
    "time_to_contact": ".scale",
    "track_points": ".tracking",
    "write_flow": ".io",
}

# Submodules that are reached as attributes of the package.
_SUBMODULES = (
    "batch",
    "bench",
    "calibration",
    "camera",
    "capture",
    "errors",
    "extraction",
    "grid",
    "interop",
    "io",
    "live",
    "objects",
    "plotting",
    "reproduce",
    "scale",
    "segmentation",
    "synthetic",
    "tracking",
    "velocity",
    "video",
)

__all__ = [
    "Calibration",
    "CalibrationError",
    "Camera",
    "CaptureError",
    "Contact",
    "ContactStatus",
    "DTypeError",
    "DenseFlow",
    "Extraction",
    "ExtractionInterrupted",
    "FilterStatus",
    "FilteredVelocity",
    "FlowField",
    "FormatError",
    "Frame",
    "Frames",
    "Grid",
    "GridSequence",
    "GridStatus",
    "HeightFromSpeed",
    "HeightStatus",
    "InternalError",
    "MissingExtraError",
    "MotionSegmentation",
    "MotionSegmenter",
    "OptionError",
    "OutOfMemoryError",
    "PartialExtractionError",
    "PointStatus",
    "PointTracker",
    "QuiverStyle",
    "RsflowError",
    "ScaleCheck",
    "ScaleStatus",
    "SegmentationStatus",
    "ShapeError",
    "Shift",
    "ShiftStatus",
    "TimeToContact",
    "Tracks",
    "Velocity",
    "VelocityEstimator",
    "VelocityFilter",
    "VelocityStatus",
    "VideoWriter",
    "__version__",
    "build_info",
    "calibrate",
    "check_scale",
    "dense_flow",
    "detect_corners",
    "displacement_grid",
    "estimate_shift",
    "extract",
    "extract_many",
    "flow_to_color",
    "frames",
    "get_num_threads",
    "height_from_speed",
    "quiver",
    "read_flow",
    "set_num_threads",
    "time_to_contact",
    "track_points",
    "write_flow",
]


def set_num_threads(threads: int) -> None:
    """Set the number of threads of all calls.

    Parameters
    ----------
    threads : int
        0 means one for each CPU. Results do not depend on it.

    Raises
    ------
    OptionError
        If it is no integer of at least 0.

    Examples
    --------
    >>> import rsflow
    >>> before = rsflow.get_num_threads()
    >>> rsflow.set_num_threads(2)
    >>> rsflow.get_num_threads()
    2
    >>> rsflow.set_num_threads(before)
    """
    from ._checks import integer

    _core.set_num_threads(integer("threads", threads))


def __getattr__(name: str) -> Any:
    module = _LAZY.get(name)
    if module is not None:
        value = getattr(importlib.import_module(module, __name__), name)
        globals()[name] = value
        return value
    if name in _SUBMODULES:
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*__all__, *_SUBMODULES})
