"""Arrows in axes of matplotlib, which the caller makes, labels and saves."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks
from .._display import displayed
from ..errors import DTypeError, OptionError, ShapeError
from . import arrows, drawing
from .flow_color import vectors_of
from .quiver_plot import chosen_style, expect_knobs

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ..io.flow_files import FlowLike
    from .style import QuiverStyle

__all__ = ["quiver_into"]

# Length of the key's arrow, in distances between arrows.
_KEY_STEPS = 1.5


def quiver_into(
    ax: Any,
    field: FlowLike,
    *,
    picture: NDArray[Any] | None = None,
    valid: ArrayLike | None = None,
    style: QuiverStyle | None = None,
    path: object = None,
    **knobs: Any,
) -> Any:
    """Draw a flow (height, width, 2) as arrows into `ax`, over a picture where there is one; give `ax`."""
    # Who has axes has matplotlib loaded.
    module = sys.modules.get("matplotlib.axes")
    if module is None or not isinstance(ax, module.Axes):
        raise _checks.refused("ax", ax, "axes of matplotlib, or None for a picture", DTypeError)
    if path is not None:
        raise _checks.refused("path", path, "None with ax: its figure is saved by savefig", OptionError)
    expect_knobs(style, knobs)
    uv = vectors_of(field)
    known: NDArray[np.bool_] = np.isfinite(uv[..., 0]) & np.isfinite(uv[..., 1])
    if valid is not None:
        known &= _checks.bools("valid", valid, known.shape, "the motion")
    style = chosen_style(style, knobs, uv[known], uv.shape[1])
    height, width = known.shape
    if picture is not None:
        shown = displayed(picture)
        if shown.shape[:2] != known.shape:
            raise ShapeError(f"picture: got shape {shown.shape[:2]}, expected that of the flow, {known.shape}")
        ax.imshow(shown[..., ::-1])
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="x (px)", ylabel="y (px)")
    where = arrows.known_grid(known, style.step)
    columns, rows = where.astype(int).T
    vectors = uv[rows, columns].astype(np.float64) * style.scale
    if style.max_length is not None:
        length = np.maximum(np.hypot(*vectors.T), 1e-12)
        vectors *= np.minimum(style.max_length / length, 1.0)[:, None]
    blue, green, red = (level / 255 for level in style.color)
    drawn = ax.quiver(
        *where.T,
        *vectors.T,
        color=(red, green, blue),
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.003,
        edgecolor="0.1",
        linewidth=0.4,
    )
    if style.key and len(vectors):
        # About as long as the longest arrows of a fitted style, and a round number of the unit.
        value = drawing.round_number(_KEY_STEPS * style.step * style.unit_per_px / style.scale)
        length = value / style.unit_per_px * style.scale
        ax.quiverkey(drawn, 0.9, 1.04, length, f"{value:g} {style.unit}", labelpos="W")
    return ax
