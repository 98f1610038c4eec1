"""Points: where to start them, where they went, and all of them over a sequence."""

from __future__ import annotations

from .._checks.knobs import Illumination
from .points import detect_corners, track_points
from .result import PointStatus, Tracks
from .table import TrackTable
from .tracker import PointTracker

__all__ = ["Illumination", "PointStatus", "PointTracker", "TrackTable", "Tracks", "detect_corners", "track_points"]
