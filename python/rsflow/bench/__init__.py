"""Accuracy and time of rsflow beside OpenCV, on scenes whose motion, and what moves, is known exactly."""

from __future__ import annotations

from .extract_tables import EXTRACT_MARKS, ExtractBench, ExtractRow, PartRow
from .run import measure
from .segmentation_run import measure_segmentation
from .segmentation_tables import SEGMENTATION_MARKS, SegmentationBench, SegmentationRow
from .tables import BEGIN, END, Bench, Row, with_tables
from .velocity_run import measure_velocity
from .velocity_tables import VELOCITY_MARKS, ConditionRow, LatencyRow, VelocityBench

__all__ = [
    "BEGIN",
    "END",
    "EXTRACT_MARKS",
    "SEGMENTATION_MARKS",
    "VELOCITY_MARKS",
    "Bench",
    "ConditionRow",
    "ExtractBench",
    "ExtractRow",
    "LatencyRow",
    "PartRow",
    "Row",
    "SegmentationBench",
    "SegmentationRow",
    "VelocityBench",
    "measure",
    "measure_segmentation",
    "measure_velocity",
    "with_tables",
]
