"""Pictures of motion: arrows over a picture, and flow as colours."""

from __future__ import annotations

from .flow_color import color_wheel, fitted_max_flow, flow_over_picture, flow_to_color
from .quiver_plot import quiver
from .style import QuiverStyle

__all__ = ["QuiverStyle", "color_wheel", "fitted_max_flow", "flow_over_picture", "flow_to_color", "quiver"]
