"""Things that move, followed over a sequence, and their table; `rsflow.segmentation` holds the code."""

from __future__ import annotations

from .segmentation.objects import OBJECT_COLUMNS, ObjectTable, ObjectTracker, TrackedObject

__all__ = ["OBJECT_COLUMNS", "ObjectTable", "ObjectTracker", "TrackedObject"]
