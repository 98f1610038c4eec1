"""A plot as HTML with SVG inside, whose letters keep their size at every width, or as an SVG file of its own.

All places are shares of the plot's area, of any size; lines and letters do not stretch with it. Colours
stand as attributes, which a file shows, and as classes, by which the page changes them in the dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from .axes import COLOURS, Range, label, ticks

__all__ = ["GROUND", "INVALID", "UNIT", "Drawing", "attributes", "axes_frame", "percent", "stretched"]

INVALID, GROUND = "#f3d9d0", "#fff"
_INK, _GRID, _ZERO, _FRAME = "#333", "#e6e6e6", "#bbb", "#999"
# Curves are in so many units each way.
UNIT = 10_000

# Of a file: its size, and the margins for labels, in its units.
_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 860, 70, 16, 28, 44
# On the page a plot is at most so high, in pixels.
_HIGHEST = 600
# A letter of 12 units is as wide on average.
_LETTER = 6.6


def percent(share: float) -> str:
    """Write a share of an axis."""
    return f"{100 * share:.2f}%"


def attributes(values: dict[str, str]) -> str:
    """Write attributes of an element, escaped."""
    return "".join(f' {name}="{escape(value, quote=True)}"' for name, value in values.items())


def stretched(content: str, size: tuple[int, int] = (UNIT, UNIT)) -> str:
    """Stretch over the whole area what is drawn in units of its own; what lies outside is cut off."""
    return (
        f'<svg width="100%" height="100%" viewBox="0 0 {size[0]} {size[1]}" preserveAspectRatio="none">{content}</svg>'
    )


@dataclass(frozen=True)
class Drawing:
    """A plot: what is in its area, and what stands around it.

    Attributes
    ----------
    title : str
        For readers that do not see it.
    body : str
        SVG in shares of the area.
    keys : sequence of (name, colour or class, colour)
        Name of each curve, the class of its colour on the page, and the colour itself.
    y_label, x_label : str
        With units; empty without axes.
    height : int
        In pixels; 0 for what has the proportions `aspect`.
    aspect : float
        Width over height.
    data : dict of str to str
        What the page's script reads.
    """

    title: str
    body: str
    keys: Sequence[tuple[str, str, str]] = ()
    y_label: str = ""
    x_label: str = ""
    height: int = 0
    aspect: float = 1.0
    data: dict[str, str] = field(default_factory=dict)

    def inline(self) -> str:
        """Give it as a part of the page: as wide as there is room, letters in the page's size."""
        keys = "".join(
            f'<span class="key"><i class="{kind}" style="background:{colour}"></i>{escape(name)}</span>'
            for name, kind, colour in self.keys
        )
        unit = f'<span class="unit">{escape(self.y_label)}</span>' if self.y_label else ""
        above = f'<div class="keys">{unit}{keys}</div>' if unit or keys else ""
        shape = f"height:{self.height}px"
        if not self.height:
            # Not higher than a screen.
            shape = f"aspect-ratio:{self.aspect:.4f};max-width:{_HIGHEST * self.aspect:.0f}px"
        axes = " axes" if self.y_label else ""
        below = f'<div class="x-label">{escape(self.x_label)}</div>' if self.x_label else ""
        kind = "box" if self.y_label else "box map"
        return (
            f'{above}<div class="area{axes}"><div class="{kind}" style="{shape}"{attributes(self.data)}>'
            f'<svg xmlns="http://www.w3.org/2000/svg" width="100%" height="100%" role="img"'
            f"{attributes({'aria-label': self.title})}>{self.body}</svg></div></div>{below}"
        )

    def file(self) -> str:
        """Give it as the text of an SVG file."""
        inner_w = _WIDTH - _LEFT - _RIGHT
        inner_h = self.height or round(inner_w / self.aspect)
        height = inner_h + _TOP + _BOTTOM
        middle_x, middle_y = _LEFT + inner_w / 2, _TOP + inner_h / 2
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" role="img"'
            f"{attributes({'aria-label': self.title})}><title>{escape(self.title)}</title>",
            "<style>.s{display:none}</style>",
            f'<rect width="{_WIDTH}" height="{height}" fill="{GROUND}"/>',
            f'<g font-family="sans-serif" font-size="12" fill="{_INK}">',
            f'<svg x="{_LEFT}" y="{_TOP}" width="{inner_w}" height="{inner_h}" overflow="visible">{self.body}</svg>',
            f'<text x="{middle_x}" y="{height - 8}" text-anchor="middle">{escape(self.x_label)}</text>',
            f'<text x="14" y="{middle_y}" text-anchor="middle" transform="rotate(-90 14 {middle_y})">'
            f"{escape(self.y_label)}</text>",
        ]
        x = float(_LEFT)
        for name, _, colour in self.keys:
            parts.append(f'<rect x="{x:.0f}" y="{_TOP - 17}" width="16" height="8" fill="{colour}"/>')
            parts.append(f'<text x="{x + 21:.0f}" y="{_TOP - 9}">{escape(name)}</text>')
            x += 40 + _LETTER * len(name)
        return "".join([*parts, "</g></svg>"])


def axes_frame(x: Range, y: Range, *, y_sign: float = 1.0, y_count: int = 4) -> str:
    """Draw the grid, its numbers and the frame; on a narrow page (class s) there are fewer numbers below."""
    parts = []
    for kind, count in (("w", 8), ("s", 4)):
        # The page shows them by their class; a file has those of a wide plot alone.
        parts.append(f'<g class="{kind}">')
        for value in ticks(x.low, x.high, count):
            at = percent(x.share(value))
            anchor = "end" if x.share(value) > 0.985 else "middle"
            parts.append(f'<line class="grid" x1="{at}" x2="{at}" y1="0" y2="100%" stroke="{_GRID}"/>')
            parts.append(f'<text x="{at}" y="100%" dy="16" text-anchor="{anchor}">{label(value)}</text>')
        parts.append("</g>")
    for value in ticks(y.low, y.high, y_count):
        at = percent(1 - y.share(value))
        kind, colour = ("zero", _ZERO) if value == 0 else ("grid", _GRID)
        parts.append(f'<line class="{kind}" x1="0" x2="100%" y1="{at}" y2="{at}" stroke="{colour}"/>')
        parts.append(f'<text x="0" y="{at}" dx="-7" dy="4" text-anchor="end">{label(y_sign * value)}</text>')
    parts.append(f'<rect class="frame" width="100%" height="100%" fill="none" stroke="{_FRAME}"/>')
    return "".join(parts)


def colour_of(number: int) -> str:
    """Give the colour of a curve by its number."""
    return COLOURS[number % len(COLOURS)]
