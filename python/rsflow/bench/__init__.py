"""Accuracy and time of rsflow beside its rivals, on scenes whose motion, and what moves, is known exactly."""

from __future__ import annotations

from .extract_tables import EXTRACT_MARKS, ExtractBench, ExtractRow, PartRow
from .kinds_run import measure_kinds
from .kinds_tables import KINDS_MARKS, KindRow, KindsBench, SizeRow
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
    "KINDS_MARKS",
    "SEGMENTATION_MARKS",
    "VELOCITY_MARKS",
    "Bench",
    "ConditionRow",
    "ExtractBench",
    "ExtractRow",
    "KindRow",
    "KindsBench",
    "LatencyRow",
    "PartRow",
    "Row",
    "SegmentationBench",
    "SegmentationRow",
    "SizeRow",
    "VelocityBench",
    "measure",
    "measure_kinds",
    "measure_segmentation",
    "measure_velocity",
    "with_tables",
]
