"""Accuracy and time of rsflow beside OpenCV, on scenes whose motion is known exactly."""

from __future__ import annotations

from .run import measure
from .tables import BEGIN, END, Bench, Row, with_tables
from .velocity_run import measure_velocity
from .velocity_tables import VELOCITY_MARKS, ConditionRow, LatencyRow, VelocityBench

__all__ = [
    "BEGIN",
    "END",
    "VELOCITY_MARKS",
    "Bench",
    "ConditionRow",
    "LatencyRow",
    "Row",
    "VelocityBench",
    "measure",
    "measure_velocity",
    "with_tables",
]
