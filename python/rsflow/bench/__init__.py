"""Accuracy and time of rsflow beside OpenCV, on scenes whose motion is known exactly."""

from __future__ import annotations

from .run import measure
from .tables import BEGIN, END, Bench, Row, with_tables

__all__ = ["BEGIN", "END", "Bench", "Row", "measure", "with_tables"]
