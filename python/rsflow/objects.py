"""Things that move, followed over a sequence, and their table; `rsflow.segmentation` holds the code."""

from __future__ import annotations

from .segmentation.object_table import OBJECT_COLUMNS, ObjectTable, TrackedObject
from .segmentation.objects import ObjectTracker

__all__ = ["OBJECT_COLUMNS", "ObjectTable", "ObjectTracker", "TrackedObject"]
