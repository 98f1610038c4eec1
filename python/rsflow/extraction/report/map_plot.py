"""Ways over a picture, each from a ring to an arrow's tip, with its number where there is room for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from .axes import pieces, simplified
from .drawing import Drawing, attributes, percent, stretched

__all__ = ["map_plot", "small_way"]

F64 = NDArray[np.float64]
Way = tuple[str, str, F64, F64]

# Widths that names have to keep clear of each other at, in pixels: of a phone, and of a page on a desk.
_NARROW, _WIDE = 330, 860
# Height of a name, and width of a letter.
_LINE, _LETTER = 15, 8.5
# Where a name may stand beside the end of its way: dx, dy, and whether it ends there.
_BESIDE = ((6, -5, False), (-6, -5, True), (6, 14, False), (-6, 14, True))


def map_plot(
    ways: Sequence[Way],
    size: tuple[int, int],
    *,
    title: str,
    picture: str | None = None,
    dashed: Sequence[tuple[str, tuple[float, ...]]] = (),
) -> Drawing:
    """Draw ways over a picture.

    Parameters
    ----------
    ways : sequence of (name, colour, x, y)
        In pixels of the picture, y down; NaN is a gap. Names of the first are written before those of the others.
    size : (width, height)
        Of the picture.
    title : str
        As for `time_plot`.
    picture : str, optional
        Its data URL; without one the ground is grey.
    dashed : sequence of (name, (x0, y0, x1, y1)), optional
        Straight lines.

    Returns
    -------
    Drawing
    """
    width, height = size
    image = (
        f'<rect width="{width}" height="{height}" fill="#888"/>'
        if picture is None
        else f'<image width="{width}" height="{height}" preserveAspectRatio="none" href="{picture}"/>'
    )
    names = _Names(size)
    for name, (x0, y0, x1, y1) in dashed:
        names.add(name, (x0 + x1) / 2, (y0 + y1) / 2, "#fff")
    parts = [_way(name, colour, x, y, size, names) for name, colour, x, y in ways]
    for _, (x0, y0, x1, y1) in dashed:
        ends = {
            f"{axis}{end}": percent(at) for axis, end, at in _ends(x0 / width, y0 / height, x1 / width, y1 / height)
        }
        for colour, wide in (("#000", "3"), ("#fff", "1.6")):
            parts.append(f'<line{attributes(ends)} stroke="{colour}" stroke-width="{wide}" stroke-dasharray="7 5"/>')
    return Drawing(title, stretched(image, size) + "".join(parts) + names.text(), aspect=width / height)


def _ends(x0: float, y0: float, x1: float, y1: float) -> tuple[tuple[str, int, float], ...]:
    return ("x", 1, x0), ("y", 1, y0), ("x", 2, x1), ("y", 2, y1)


def _way(name: str, colour: str, x: F64, y: F64, size: tuple[int, int], names: _Names) -> str:
    runs = pieces(x, y)
    if not runs:
        return ""
    width, height = size
    least = max(size) / 1200
    lines = []
    for run in runs:
        thin_x, thin_y = simplified(x[run], y[run], least)
        lines.append("M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(thin_x.tolist(), thin_y.tolist(), strict=True)))
    path = stretched(
        "".join(
            f'<path d="{"".join(lines)}" fill="none" stroke="{ink}" stroke-width="{wide}" stroke-linejoin="round" '
            f'stroke-linecap="round" vector-effect="non-scaling-stroke"{more}/>'
            for ink, wide, more in (("#000", "4", ' stroke-opacity="0.55"'), (colour, "2", ""))
        ),
        size,
    )
    first, last = runs[0][0], runs[-1][-1]
    ring = {"cx": percent(x[first] / width), "cy": percent(y[first] / height), "r": "3.5"}
    ring |= {"fill": "#fff", "stroke": colour, "stroke-width": "2"}
    names.add(name, float(x[last]), float(y[last]), _paler(colour), ahead=_direction(x[runs[-1]], y[runs[-1]], size))
    return (
        f'<g class="way"{attributes({"data-thing": name})}><title>{escape(name)}</title>{path}'
        f"<circle{attributes(ring)}/>{_tip(x[runs[-1]], y[runs[-1]], size, colour)}</g>"
    )


def _paler(colour: str) -> str:
    """Give a colour whose letters are read on any ground."""
    return "#" + "".join(f"{(int(colour[at : at + 2], 16) + 255) // 2:02x}" for at in (1, 3, 5))


def _direction(x: F64, y: F64, size: tuple[int, int]) -> tuple[float, float]:
    """Where a way goes at its end, over its last part that is as long as the head of an arrow; (0, 0) if it is none."""
    back = np.flatnonzero(np.hypot(x - x[-1], y - y[-1]) >= max(size) / 100)
    return (float(x[-1] - x[back[-1]]), float(y[-1] - y[back[-1]])) if len(back) else (0.0, 0.0)


def _tip(x: F64, y: F64, size: tuple[int, int], colour: str) -> str:
    """Head of an arrow at the end of a way, of one size always."""
    right, down = _direction(x, y, size)
    if not right and not down:
        return ""
    angle = math.degrees(math.atan2(down, right))
    at = {"x": percent(x[-1] / size[0]), "y": percent(y[-1] / size[1]), "overflow": "visible"}
    return (
        f'<svg{attributes(at)}><path d="M-8 -4.5L1 0L-8 4.5Z" transform="rotate({angle:.0f})" fill="{colour}" '
        'stroke="#000" stroke-opacity="0.55"/></svg>'
    )


def small_way(x: F64, y: F64, colour: str, size: tuple[float, float]) -> str:
    """Draw one way alone, as small as a line of a table, where it is in the picture of this `size`."""
    width, height = size
    scale = min(56 / width, 36 / height)
    runs = pieces(x, y)
    if not runs:
        return ""
    lines = []
    for run in runs:
        thin_x, thin_y = simplified(x[run] * scale, y[run] * scale, 0.7)
        lines.append("M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(thin_x.tolist(), thin_y.tolist(), strict=True)))
    end_x, end_y = float(x[runs[-1][-1]]) * scale, float(y[runs[-1][-1]]) * scale
    wide, high = width * scale, height * scale
    return (
        f'<svg class="small" width="{wide:.0f}" height="{high:.0f}" viewBox="0 0 {wide:.1f} {high:.1f}" '
        f'aria-hidden="true"><path d="{"".join(lines)}" fill="none" stroke="{colour}" stroke-width="1.6"/>'
        f'<circle cx="{end_x:.1f}" cy="{end_y:.1f}" r="2" fill="{colour}"/></svg>'
    )


class _Names:
    """Names at places of a picture, none over another, neither on a narrow page nor on a wide one."""

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._taken: dict[int, list[tuple[float, float, float, float]]] = {_NARROW: [], _WIDE: []}
        self._parts: list[str] = []

    def add(self, name: str, x: float, y: float, colour: str, *, ahead: tuple[float, float] = (1.0, -1.0)) -> None:
        """Write a name beside a place, on wide pages alone where it needs their room, or not at all.

        It stands where the way goes on rather than over what is drawn of it.
        """
        places = sorted(_BESIDE, key=lambda one: -(one[0] * ahead[0] + (one[1] - 4.5) * ahead[1]))
        for widths, kind in (((_NARROW, _WIDE), ""), ((_WIDE,), "w")):
            for beside in places:
                boxes = {wide: self._box(name, x, y, beside, wide) for wide in widths}
                if all(self._free(box, wide) for wide, box in boxes.items()):
                    for wide, box in boxes.items():
                        self._taken[wide].append(box)
                    dx, dy, ends = beside
                    at = {"x": percent(x / self._size[0]), "y": percent(y / self._size[1]), "dx": f"{dx}"}
                    at |= {"dy": f"{dy}", "fill": colour, "text-anchor": "end" if ends else "start"}
                    at |= {"class": kind} if kind else {}
                    self._parts.append(f"<text{attributes(at)}>{escape(name)}</text>")
                    return

    def _box(
        self, name: str, x: float, y: float, beside: tuple[int, int, bool], wide: int
    ) -> tuple[float, float, float, float]:
        scale = wide / self._size[0]
        dx, dy, ends = beside
        length = _LETTER * len(name) + 2
        left, bottom = x * scale + dx - (length if ends else 0), y * scale + dy + 3
        return left, bottom - _LINE, left + length, bottom

    def _free(self, box: tuple[float, float, float, float], wide: int) -> bool:
        left, top, right, bottom = box
        if left < 0 or top < 0 or right > wide or bottom > wide * self._size[1] / self._size[0]:
            return False
        return not any(
            left < other[2] and other[0] < right and top < other[3] and other[1] < bottom for other in self._taken[wide]
        )

    def text(self) -> str:
        """Give all names."""
        look = {"font-weight": "600", "stroke": "#000", "stroke-width": "3", "stroke-linejoin": "round"}
        return f'<g class="names"{attributes(look | {"paint-order": "stroke"})}>{"".join(self._parts)}</g>'
