"""A path in the plane, both axes at one scale."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .axes import COLOURS, Range, pieces, simplified
from .drawing import UNIT, Drawing, attributes, axes_frame, percent, stretched

__all__ = ["path_plot"]

# Proportions of the plot: those of the path, between these.
_SLIMMEST, _WIDEST = 1.25, 2.2


def path_plot(x: ArrayLike, y: ArrayLike, *, title: str, x_label: str, y_label: str, y_down: bool = True) -> Drawing:
    """Draw a path in the plane, with its start (ring) and end (disc).

    Parameters
    ----------
    x, y : (N,) arrays
        The path; NaN is a gap.
    title, x_label, y_label : str
        As for `time_plot`.
    y_down : bool
        Draw y downwards, as the camera frame has it.

    Returns
    -------
    Drawing
    """
    px, py = np.asarray(x, np.float64), np.asarray(y, np.float64)
    sign = -1.0 if y_down else 1.0
    known = np.isfinite(px) & np.isfinite(py)
    if not known.any():
        px, py, known = np.zeros(1), np.zeros(1), np.ones(1, bool)
    fx, fy = px[known], sign * py[known]
    wide, high = float(np.ptp(fx)), float(np.ptp(fy))
    aspect = min(max(wide / high if high > 0 else _WIDEST, _SLIMMEST), _WIDEST)
    # Half of what is seen upwards; across it is `aspect` times that.
    half = max(wide / aspect, high, 1e-9) * 0.56
    middle_x, middle_y = float(fx.max() + fx.min()) / 2, float(fy.max() + fy.min()) / 2
    across = Range(middle_x - half * aspect, middle_x + half * aspect)
    up = Range(middle_y - half, middle_y + half)
    lines = []
    for run in pieces(px, py):
        thin_x, thin_y = simplified(px[run], sign * py[run], half / 1500)
        at_x, at_y = across.shares(thin_x) * UNIT, (1 - up.shares(thin_y)) * UNIT
        points = " ".join(f"{a:.0f},{b:.0f}" for a, b in zip(at_x.tolist(), at_y.tolist(), strict=True))
        lines.append(
            f'<polyline class="c0" points="{points}" fill="none" stroke="{COLOURS[0]}" stroke-width="1.8" '
            'vector-effect="non-scaling-stroke"/>'
        )
    ends = []
    for value_x, value_y, name in ((fx[0], fy[0], "start"), (fx[-1], fy[-1], "end")):
        at = {"cx": percent(across.share(float(value_x))), "cy": percent(1 - up.share(float(value_y))), "r": "5"}
        at |= {"fill": "#fff" if name == "start" else COLOURS[0], "stroke": COLOURS[0], "stroke-width": "2"}
        ends.append(f"<circle{attributes(at | {'class': f'c0 {name}'})}/>")
    return Drawing(
        title,
        axes_frame(across, up, y_sign=sign, y_count=5) + stretched("".join(lines)) + "".join(ends),
        [("ring: start, disc: end", "b0", COLOURS[0])],
        y_label,
        x_label,
        aspect=aspect,
        data={
            "data-x": f"{across.low!r} {across.high!r}",
            "data-y": f"{sign * up.low!r} {sign * up.high!r}",
            "data-plane": "1",
        },
    )
