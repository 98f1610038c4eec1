"""Pictures of motion: arrows over a picture, and flow as colours."""

from __future__ import annotations

from .flow_color import color_wheel, fitted_max_flow, flow_over_picture, flow_to_color
from .quiver_plot import QuiverStyle, quiver

__all__ = ["QuiverStyle", "color_wheel", "fitted_max_flow", "flow_over_picture", "flow_to_color", "quiver"]
