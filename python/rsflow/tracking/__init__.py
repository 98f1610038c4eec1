"""Points: where to start them, where they went, and all of them over a sequence."""

from __future__ import annotations

from .points import Illumination, PointStatus, PointTracker, Tracks, detect_corners, track_points
from .table import TrackTable

__all__ = ["Illumination", "PointStatus", "PointTracker", "TrackTable", "Tracks", "detect_corners", "track_points"]
