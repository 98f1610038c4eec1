"""Motion from a running camera: figures frame by frame, shown in a viewer, recorded, and kept in tables."""

from __future__ import annotations

from .frame import LiveFrame
from .plain import readings
from .reading import LiveReading
from .summary import LiveSummary
from .watching import watch

__all__ = ["LiveFrame", "LiveReading", "LiveSummary", "readings", "watch"]
