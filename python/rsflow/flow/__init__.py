"""Dense flow: where every pixel went."""

from __future__ import annotations

from .._checks.knobs import Preset
from .dense import DenseFlow, dense_flow
from .field import FlowField

__all__ = ["DenseFlow", "FlowField", "Preset", "dense_flow"]
