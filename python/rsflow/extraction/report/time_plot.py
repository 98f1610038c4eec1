"""Curves over time, with gaps where nothing was measured, bands of a standard deviation, and peaks that stay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .axes import COLOURS, MOST_COLUMNS, Range, columns, envelope, pieces, thinned
from .drawing import INVALID, UNIT, Drawing, axes_frame, percent, stretched

__all__ = ["Curve", "time_plot"]

_HEIGHT = 178


@dataclass(frozen=True)
class Curve:
    """One curve: its name in the key, its values, and the standard deviation of each, drawn as a band."""

    name: str
    values: ArrayLike
    std: ArrayLike | None = None


def _y_range(curves: Sequence[Curve], floor: float | None, at_least: float) -> Range:
    """Range that shows every value; a band counts only as far as three times the spread of its curve's values."""
    low, high = math.inf, -math.inf
    for curve in curves:
        y = np.asarray(curve.values, np.float64)
        finite = y[np.isfinite(y)]
        if len(finite) == 0:
            continue
        low, high = min(low, float(finite.min())), max(high, float(finite.max()))
        if curve.std is not None:
            std = np.asarray(curve.std, np.float64)
            spread = max(float(np.ptp(finite)), at_least)
            both = np.isfinite(y) & np.isfinite(std)
            if both.any():
                low = min(low, float(max((y - std)[both].min(), finite.min() - spread)))
                high = max(high, float(min((y + std)[both].max(), finite.max() + spread)))
    if not math.isfinite(low):
        low, high = 0.0, 1.0
    if high - low < at_least:
        middle = (low + high) / 2
        low, high = middle - at_least / 2, middle + at_least / 2
    margin = 0.06 * (high - low)
    return Range.of(low - margin if floor is None else floor, high + margin)


def time_plot(
    t: ArrayLike,
    curves: Sequence[Curve],
    *,
    title: str,
    y_label: str,
    x_label: str = "time in s",
    valid: ArrayLike | None = None,
    floor: float | None = None,
    y_least: float = 1e-6,
    whole: bool = False,
) -> Drawing:
    """Draw curves over time.

    Parameters
    ----------
    t : (N,) array
        Times, ascending.
    curves : sequence of Curve
        Each with N values; NaN is a gap.
    title : str
        For readers that do not see the drawing.
    y_label, x_label : str
        With units.
    valid : (N,) array of bool, optional
        Where it is False the background is shaded.
    floor : float, optional
        Lower end of the y axis.
    y_least : float
        Least extent of the y axis, so that noise is not blown up to fill the plot.
    whole : bool
        Whether values are whole numbers.

    Returns
    -------
    Drawing
    """
    x = np.asarray(t, np.float64)
    seen = x[np.isfinite(x)]
    across = Range.of(float(seen.min()), float(seen.max())) if len(seen) else Range(0.0, 1.0)
    up = _y_range(curves, floor, y_least)
    shaded = "" if valid is None or not len(seen) else _shading(across, x, np.asarray(valid, bool))
    drawn = "".join(_curve(across, up, x, curve, number) for number, curve in enumerate(curves))
    keys = [
        (curve.name, f"b{number}", colour) for number, (curve, colour) in enumerate(zip(curves, COLOURS, strict=False))
    ]
    if shaded:
        keys.append(("not measured", "bad", INVALID))
    return Drawing(
        title,
        shaded + axes_frame(across, up) + stretched(drawn),
        keys,
        y_label,
        x_label,
        _HEIGHT,
        data={
            "data-x": f"{across.low!r} {across.high!r}",
            "data-y": f"{up.low!r} {up.high!r}",
            "data-names": "|".join(curve.name.replace("|", " ") for curve in curves),
        }
        | ({"data-whole": "1"} if whole else {}),
    )


def _points(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    # Far outside of the area nothing is seen of a curve, and browsers take no huge numbers.
    places = np.rint(np.clip(np.stack([x, 1 - y], axis=1), -5, 6) * UNIT).astype(np.int64)
    return " ".join(f"{a},{b}" for a, b in places.tolist())


def _curve(across: Range, up: Range, t: NDArray[np.float64], curve: Curve, number: int) -> str:
    colour, parts = COLOURS[number % len(COLOURS)], []
    y = np.asarray(curve.values, np.float64)
    if curve.std is not None:
        std = np.asarray(curve.std, np.float64)
        band_t, low, high = envelope(t, y - std, y + std)
        band_t, low, high = across.shares(band_t), up.shares(low), up.shares(high)
        for run in pieces(band_t, low + high):
            outline = _points(band_t[run], high[run]) + " " + _points(band_t[run][::-1], low[run][::-1])
            parts.append(f'<polygon class="f{number}" points="{outline}" fill="{colour}" fill-opacity="0.2"/>')
    x, y = thinned(t, y)
    x, y = across.shares(x), up.shares(y)
    for run in pieces(x, y):
        points = _points(x[run], y[run])
        if len(run) == 1:
            # A point of its own: a line without a length, with round ends.
            points, look = f"{points} {points}", 'stroke-width="4" stroke-linecap="round"'
        else:
            look = 'stroke-width="1.5" stroke-linejoin="round"'
        parts.append(
            f'<polyline class="c{number}" points="{points}" fill="none" stroke="{colour}" {look} '
            'vector-effect="non-scaling-stroke"/>'
        )
    return "".join(parts)


def _shading(across: Range, t: NDArray[np.float64], valid: NDArray[np.bool_]) -> str:
    """Shade from half a step before the first invalid time of a run to half a step after its last."""
    bad = ~valid & np.isfinite(t)
    if not bad.any():
        return ""
    half = float(np.nanmedian(np.diff(t))) / 2 if len(t) > 1 else 0.5
    begin, end = t - half, t + half
    if len(t) > 2 * MOST_COLUMNS:
        # A column is shaded where anything in it is bad.
        begins = columns(len(t))
        ends = [*(begins[1:] - 1), len(t) - 1]
        bad, begin, end = np.logical_or.reduceat(bad, begins), begin[begins], end[ends]
    index = np.flatnonzero(bad)
    parts = []
    for run in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1):
        left = min(max(across.share(float(begin[run[0]])), 0.0), 1.0)
        right = min(max(across.share(float(end[run[-1]])), 0.0), 1.0)
        width = max(right - left, 0.003)
        parts.append(
            f'<rect class="bad" x="{percent(min(left, 1 - width))}" y="0" width="{percent(width)}" height="100%" '
            f'fill="{INVALID}"/>'
        )
    return "".join(parts)
