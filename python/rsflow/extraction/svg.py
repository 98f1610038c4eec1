"""Plots as inline SVG text: curves over time with gaps and bands, and a path in the plane. No dependency but numpy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["COLOURS", "Curve", "map_plot", "path_plot", "thinned", "ticks", "time_plot"]

# Okabe and Ito (2008): told apart with every kind of colour vision.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
_INVALID = "#f3d9d0"
_INK = "#333"

# Size of the drawing in SVG units, and the margins left for labels.
_WIDTH, _HEIGHT = 860, 250
_LEFT, _RIGHT, _TOP, _BOTTOM = 70, 16, 28, 44


@dataclass(frozen=True)
class Curve:
    """One curve: its name in the key, its values, and the standard deviation of each, drawn as a band."""

    name: str
    values: ArrayLike
    std: ArrayLike | None = None


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Give round numbers (1, 2 or 5 times a power of ten apart) from `low` to `high`, about `count` of them."""
    if not high > low:
        return [low]
    raw = (high - low) / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(index * step, 12) for index in range(first, last + 1)]


def _label(value: float) -> str:
    return f"{value + 0.0:.6g}".replace("-", "\u2212")


def thinned(x: NDArray[np.float64], y: NDArray[np.float64], limit: int = 1600) -> tuple[NDArray[np.float64], ...]:
    """Thin a curve to about `limit` points; the least and the greatest of each bin stay, so that no peak is lost."""
    if len(x) <= limit:
        return x, y
    keep: list[int] = []
    for part in np.array_split(np.arange(len(x)), limit // 2):
        finite = part[np.isfinite(y[part])]
        if len(finite) == 0:
            keep.append(int(part[0]))
            continue
        keep.extend(sorted({int(finite[np.argmin(y[finite])]), int(finite[np.argmax(y[finite])])}))
    index = np.array(keep)
    return x[index], y[index]


def _pieces(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[NDArray[np.intp]]:
    """Give the runs of finite neighbours: what was not measured is a gap in the curve."""
    finite = np.isfinite(x) & np.isfinite(y)
    index = np.flatnonzero(finite)
    return np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(index) else []


class _Axes:
    """The mapping from data to the drawing, and the frame with its ticks and labels."""

    def __init__(self, x_range: tuple[float, float], y_range: tuple[float, float], width: int, height: int) -> None:
        self.width, self.height = width, height
        (self.x0, self.x1), (self.y0, self.y1) = _widened(*x_range), _widened(*y_range)
        self._kx = (width - _LEFT - _RIGHT) / (self.x1 - self.x0)
        self._ky = (height - _TOP - _BOTTOM) / (self.y1 - self.y0)

    def x(self, value: float) -> float:
        return _LEFT + (value - self.x0) * self._kx

    def y(self, value: float) -> float:
        return self.height - _BOTTOM - (value - self.y0) * self._ky

    def points(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
        return " ".join(f"{self.x(float(a)):.1f},{self.y(float(b)):.1f}" for a, b in zip(x, y, strict=True))

    def frame(self, x_label: str, y_label: str, *, y_sign: float = 1.0) -> list[str]:
        right, bottom = self.width - _RIGHT, self.height - _BOTTOM
        parts = [f'<g font-family="sans-serif" font-size="12" fill="{_INK}">']
        for value in ticks(self.x0, self.x1, 8):
            at = self.x(value)
            parts.append(f'<path d="M{at:.1f} {_TOP}V{bottom}" stroke="#e6e6e6"/>')
            parts.append(f'<text x="{at:.1f}" y="{bottom + 16}" text-anchor="middle">{_label(value)}</text>')
        for value in ticks(self.y0, self.y1, 5):
            at = self.y(value)
            parts.append(f'<path d="M{_LEFT} {at:.1f}H{right}" stroke="{"#bbb" if value == 0 else "#e6e6e6"}"/>')
            parts.append(f'<text x="{_LEFT - 7}" y="{at + 4:.1f}" text-anchor="end">{_label(y_sign * value)}</text>')
        parts.append(
            f'<rect x="{_LEFT}" y="{_TOP}" width="{right - _LEFT}" height="{bottom - _TOP}" fill="none" stroke="#999"/>'
        )
        middle_x, middle_y = (_LEFT + right) / 2, (_TOP + bottom) / 2
        parts.append(f'<text x="{middle_x}" y="{self.height - 8}" text-anchor="middle">{escape(x_label)}</text>')
        parts.append(
            f'<text x="14" y="{middle_y}" text-anchor="middle" transform="rotate(-90 14 {middle_y})">'
            f"{escape(y_label)}</text></g>"
        )
        return parts


def _widened(low: float, high: float) -> tuple[float, float]:
    if high > low:
        return low, high
    half = max(abs(low) * 0.1, 0.5)
    return low - half, high + half


def _document(parts: Sequence[str], width: int, height: int, title: str) -> str:
    body = "".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{escape(title, quote=True)}"><title>{escape(title)}</title>'
        f'<rect width="{width}" height="{height}" fill="#fff"/>{body}</svg>'
    )


def _y_range(curves: Sequence[Curve], floor: float | None, at_least: float) -> tuple[float, float]:
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
    return (low - margin if floor is None else floor), high + margin


def time_plot(
    t_s: ArrayLike,
    curves: Sequence[Curve],
    *,
    title: str,
    y_label: str,
    x_label: str = "time in s",
    valid: ArrayLike | None = None,
    floor: float | None = None,
    y_least: float = 1e-6,
) -> str:
    """Draw curves over time.

    Parameters
    ----------
    t_s : (N,) array
        Times in seconds, ascending.
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

    Returns
    -------
    str
        An ``<svg>`` element.
    """
    t = np.asarray(t_s, np.float64)
    seen = t[np.isfinite(t)]
    axes = _Axes(
        (float(seen.min()), float(seen.max())) if len(seen) else (0.0, 1.0),
        _y_range(curves, floor, y_least),
        _WIDTH,
        _HEIGHT,
    )
    parts = _shading(axes, t, np.asarray(valid, bool)) if valid is not None and len(seen) else []
    parts += axes.frame(x_label, y_label)
    inner_w, inner_h = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    # A nested drawing clips what lies outside of it.
    parts.append(
        f'<svg x="{_LEFT}" y="{_TOP}" width="{inner_w}" height="{inner_h}" '
        f'viewBox="{_LEFT} {_TOP} {inner_w} {inner_h}">'
    )
    for curve, colour in zip(curves, COLOURS, strict=False):
        parts += _curve(axes, t, curve, colour)
    parts.append("</svg>")
    parts += _key(curves, has_shading=valid is not None and not bool(np.all(np.asarray(valid, bool))))
    return _document(parts, _WIDTH, _HEIGHT, title)


def _curve(axes: _Axes, t: NDArray[np.float64], curve: Curve, colour: str) -> list[str]:
    parts: list[str] = []
    y = np.asarray(curve.values, np.float64)
    if curve.std is not None:
        std = np.asarray(curve.std, np.float64)
        low_t, low = thinned(t, y - std)
        high_t, high = thinned(t, y + std)
        if len(low) == len(high):
            for run in _pieces(low_t, low + high):
                outline = axes.points(high_t[run], high[run]) + " " + axes.points(low_t[run][::-1], low[run][::-1])
                parts.append(f'<polygon points="{outline}" fill="{colour}" fill-opacity="0.2"/>')
    x, y = thinned(t, y)
    for run in _pieces(x, y):
        if len(run) == 1:
            at = f'cx="{axes.x(float(x[run[0]])):.1f}" cy="{axes.y(float(y[run[0]])):.1f}"'
            parts.append(f'<circle {at} r="2" fill="{colour}"/>')
        else:
            line = axes.points(x[run], y[run])
            parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
    return parts


def _shading(axes: _Axes, t: NDArray[np.float64], valid: NDArray[np.bool_]) -> list[str]:
    """Shade from half a step before the first invalid time of a run to half a step after its last."""
    parts: list[str] = []
    bad = np.flatnonzero(~valid & np.isfinite(t))
    runs = np.split(bad, np.flatnonzero(np.diff(bad) > 1) + 1) if len(bad) else []
    half = float(np.median(np.diff(t))) / 2 if len(t) > 1 else 0.5
    for run in runs:
        left, right = axes.x(max(t[run[0]] - half, axes.x0)), axes.x(min(t[run[-1]] + half, axes.x1))
        parts.append(
            f'<rect x="{left:.1f}" y="{_TOP}" width="{max(right - left, 2.0):.1f}" '
            f'height="{_HEIGHT - _TOP - _BOTTOM}" fill="{_INVALID}"/>'
        )
    return parts


def _key(curves: Sequence[Curve], *, has_shading: bool) -> list[str]:
    """Names of the curves, above the frame at its left, where they hide nothing."""
    names = [(curve.name, colour) for curve, colour in zip(curves, COLOURS, strict=False)]
    if has_shading:
        names.append(("not measured", _INVALID))
    x = float(_LEFT)
    parts = [f'<g font-family="sans-serif" font-size="12" fill="{_INK}">']
    for name, colour in names:
        parts.append(f'<rect x="{x:.0f}" y="{_TOP - 17}" width="16" height="8" fill="{colour}"/>')
        parts.append(f'<text x="{x + 21:.0f}" y="{_TOP - 9}">{escape(name)}</text>')
        # 6.6 units a letter is the mean width of a 12-unit sans-serif.
        x += 40 + 6.6 * len(name)
    parts.append("</g>")
    return parts


def map_plot(
    ways: Sequence[tuple[str, str, NDArray[np.float64], NDArray[np.float64]]],
    size: tuple[int, int],
    *,
    title: str,
    picture: str | None = None,
    dashed: Sequence[tuple[str, tuple[float, ...]]] = (),
) -> str:
    """Draw ways over a picture: from a ring to an arrow's tip, with the name beside it.

    Parameters
    ----------
    ways : sequence of (name, colour, x, y)
        In pixels of the picture, y down; NaN is a gap.
    size : (width, height)
        Of the picture.
    title : str
        As for `time_plot`.
    picture : str, optional
        Its data URL; without one the ground is grey.
    dashed : sequence of (name, (x0, y0, x1, y1)), optional
        Straight lines.

    Returns an ``<svg>`` element.
    """
    width, height = size
    # Widths and letters are a share of the picture, as that is shown in the page's width.
    unit = max(width, height) / 860
    parts = ["" if picture is None else f'<image width="{width}" height="{height}" href="{picture}"/>']
    parts.append(f'<g fill="none" stroke-linejoin="round" stroke-linecap="round" stroke-width="{2.2 * unit:.2f}">')
    names = []
    for name, colour, x, y in ways:
        runs = _pieces(x, y)
        if not runs:
            continue
        lines = []
        for run in runs:
            thin_x, thin_y = _simplified(x[run], y[run], 0.7 * unit)
            lines.append("M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(thin_x, thin_y, strict=True)))
        lines.append(_tip(x[runs[-1]], y[runs[-1]], 9 * unit))
        path = "".join(lines)
        first, last = runs[0][0], runs[-1][-1]
        parts.append(
            f'<g><title>{escape(name)}</title><path d="{path}" stroke="#000" stroke-opacity="0.55" '
            f'stroke-width="{4.4 * unit:.2f}"/><path d="{path}" stroke="{colour}"/>'
            f'<circle cx="{x[first]:.1f}" cy="{y[first]:.1f}" r="{3.5 * unit:.1f}" fill="#fff" stroke="{colour}"/></g>'
        )
        at_x, at_y = min(max(x[last], 8 * unit), width - 24 * unit), min(max(y[last], 14 * unit), height - 4 * unit)
        names.append(f'<text x="{at_x + 5 * unit:.1f}" y="{at_y - 5 * unit:.1f}" fill="{colour}">{escape(name)}</text>')
    for name, (x0, y0, x1, y1) in dashed:
        parts.append(
            f'<path d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}" stroke="#fff" stroke-dasharray="{7 * unit:.1f}"/>'
        )
        names.append(f'<text x="{(x0 + x1) / 2:.1f}" y="{(y0 + y1) / 2:.1f}" fill="#fff">{escape(name)}</text>')
    parts.append("</g>")
    parts.append(
        f'<g font-family="sans-serif" font-weight="600" font-size="{13 * unit:.1f}" stroke="#000" '
        f'stroke-width="{2.5 * unit:.2f}" stroke-linejoin="round" paint-order="stroke">{"".join(names)}</g>'
    )
    body = "".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{escape(title, quote=True)}"><title>{escape(title)}</title>'
        f'<rect width="{width}" height="{height}" fill="#888"/>{body}</svg>'
    )


def _simplified(
    x: NDArray[np.float64], y: NDArray[np.float64], least: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Leave out points of a way that are nearer than `least` to the one before that stays; both ends stay."""
    keep, last = [0], (x[0], y[0])
    for number in range(1, len(x)):
        if math.hypot(x[number] - last[0], y[number] - last[1]) >= least or number == len(x) - 1:
            keep.append(number)
            last = (x[number], y[number])
    return x[keep], y[keep]


def _tip(x: NDArray[np.float64], y: NDArray[np.float64], length: float) -> str:
    """Head of an arrow at the end of a way, along its last part that is as long as the head."""
    back = np.flatnonzero(np.hypot(x - x[-1], y - y[-1]) >= length)
    if len(back) == 0:
        return ""
    dx, dy = x[-1] - x[back[-1]], y[-1] - y[back[-1]]
    dx, dy = dx * length / math.hypot(dx, dy), dy * length / math.hypot(dx, dy)
    sides = [(x[-1] - dx + sign * 0.5 * dy, y[-1] - dy - sign * 0.5 * dx) for sign in (1, -1)]
    (ax, ay), (bx, by) = sides
    return f"M{ax:.1f} {ay:.1f}L{x[-1]:.1f} {y[-1]:.1f}L{bx:.1f} {by:.1f}"


def path_plot(x: ArrayLike, y: ArrayLike, *, title: str, x_label: str, y_label: str, y_down: bool = True) -> str:
    """Draw a path in the plane, both axes at one scale, with its start (ring) and end (disc).

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
    str
        An ``<svg>`` element.
    """
    px, py = np.asarray(x, np.float64), np.asarray(y, np.float64)
    finite = np.isfinite(px) & np.isfinite(py)
    sign = -1.0 if y_down else 1.0
    if not finite.any():
        px, py, finite = np.zeros(1), np.zeros(1), np.ones(1, bool)
    fx, fy = px[finite], sign * py[finite]
    height = 420
    inner_w, inner_h = _WIDTH - _LEFT - _RIGHT, height - _TOP - _BOTTOM
    scale = max(float(np.ptp(fx)) / inner_w, float(np.ptp(fy)) / inner_h, 1e-9) * 1.12
    cx, cy = (fx.max() + fx.min()) / 2, (fy.max() + fy.min()) / 2
    axes = _Axes(
        (float(cx - scale * inner_w / 2), float(cx + scale * inner_w / 2)),
        (float(cy - scale * inner_h / 2), float(cy + scale * inner_h / 2)),
        _WIDTH,
        height,
    )
    parts = axes.frame(x_label, y_label, y_sign=sign)
    for run in _pieces(px, py):
        line = axes.points(px[run], sign * py[run])
        parts.append(f'<polyline points="{line}" fill="none" stroke="{COLOURS[0]}" stroke-width="1.8"/>')
    for value_x, value_y, fill in ((fx[0], fy[0], "#fff"), (fx[-1], fy[-1], COLOURS[0])):
        at = f'cx="{axes.x(float(value_x)):.1f}" cy="{axes.y(float(value_y)):.1f}"'
        parts.append(f'<circle {at} r="5" fill="{fill}" stroke="{COLOURS[0]}" stroke-width="2"/>')
    parts.append(
        f'<text x="{_LEFT}" y="{_TOP - 9}" font-family="sans-serif" font-size="12" fill="{_INK}">'
        "ring: start, disc: end</text>"
    )
    return _document(parts, _WIDTH, height, title)
