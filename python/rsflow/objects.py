"""Things that move, followed over a sequence, and their table; `rsflow.segmentation` holds the code."""

from __future__ import annotations

from .segmentation.object_table import OBJECT_COLUMNS, ObjectTable, TrackedObject
from .segmentation.objects import ObjectTracker
from .segmentation.tracks.lines import CountingLine
from .segmentation.tracks.statistics import ObjectStatistics

__all__ = ["OBJECT_COLUMNS", "CountingLine", "ObjectStatistics", "ObjectTable", "ObjectTracker", "TrackedObject"]
