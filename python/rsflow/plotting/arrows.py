"""Arrows of a quiver plot: where they stand, their shape, and their two renderings, raster and SVG."""

from __future__ import annotations

import base64
import functools
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

import numpy as np

from . import drawing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .style import QuiverStyle

# On the screen, in pixels of the enlarged picture.
_SHORTEST = 2.5
_HEAD_SHARE = 0.35
_HEAD_RANGE = (2.5, 8.0)
_HEAD_HALF_WIDTH = 0.5
_KEY_LENGTH = 56.0
_MARGIN = 8
_RIM: drawing.Color = (20, 20, 20)


@functools.lru_cache(maxsize=16)
def grid(height: int, width: int, step: int) -> NDArray[np.float64]:
    """Whole-pixel points of a grid of this step that is centred on the picture, (n, 2)."""
    axes = []
    for length in (width, height):
        count = max(1, length // step)
        axes.append((length - 1 - (count - 1) * step) // 2 + step * np.arange(count))
    x, y = np.meshgrid(*axes)
    points = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    points.setflags(write=False)
    return points


def known_grid(known: NDArray[np.bool_], step: int) -> NDArray[np.float64]:
    """Return the points of a grid that are known, or the known pixel nearest to each within 0.4 steps, (n, 2)."""
    import cv2

    points = grid(known.shape[0], known.shape[1], step)
    if not known.any():
        return points[:0]
    distance, labels = cv2.distanceTransformWithLabels(
        (~known).view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    pixel_of = np.zeros(int(labels.max()) + 1, np.intp)
    pixel_of[labels[known]] = np.flatnonzero(known)
    columns, rows = points.astype(int).T
    near = distance[rows, columns] <= 0.4 * step
    nearest = pixel_of[labels[rows[near], columns[near]]]
    return np.column_stack([nearest % known.shape[1], nearest // known.shape[1]]).astype(np.float64)


def shapes(
    points: NDArray[np.float64], vectors: NDArray[np.float64], style: QuiverStyle
) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Arrows as open lines, and the points whose arrow is too short to see, both on the screen.

    An arrow starts where its pixel was. One that is longer than `max_length` is cut there and has no head.
    """
    start = (points + 0.5) * style.zoom - 0.5
    length = np.hypot(vectors[:, 0], vectors[:, 1]) * style.scale * style.zoom
    drawn = length >= _SHORTEST
    limit = None if style.max_length is None else style.max_length * style.zoom
    return lines(start[drawn], vectors[drawn] * (style.scale * style.zoom), limit), start[~drawn]


def lines(
    start: NDArray[np.float64], along: NDArray[np.float64], longest: float | None = None
) -> list[NDArray[np.float64]]:
    """Arrows from points along vectors that are not zero, both on the screen, (n, 2), as open lines.

    One that is longer than `longest` is cut there and has no head.
    """
    length = np.hypot(along[:, 0], along[:, 1])
    along = along / length[:, None]
    cut = length > (np.inf if longest is None else longest)
    if longest is not None:
        length = np.minimum(length, longest)
    tip = start + along * length[:, None]
    head = np.minimum(np.maximum(_HEAD_SHARE * length, _HEAD_RANGE[0]), _HEAD_RANGE[1])[:, None]
    back = tip - along * head
    side = np.column_stack([-along[:, 1], along[:, 0]]) * head * _HEAD_HALF_WIDTH
    whole = np.stack([start, tip, back + side, tip, back - side], axis=1)
    out = list(whole)
    for number in np.flatnonzero(cut):
        out[number] = whole[number, :2]
    return out


def _key(style: QuiverStyle) -> tuple[float, str]:
    """Length of the key arrow on the screen, and its label: a round number of the unit."""
    per_unit = style.scale * style.zoom / style.unit_per_px
    value = drawing.round_number(_KEY_LENGTH / per_unit)
    return value * per_unit, f"{value:g} {style.unit}"


@functools.lru_cache(maxsize=16)
def _key_layout(style: QuiverStyle, height: int) -> tuple[tuple[int, int, int, int], NDArray[np.float64], str]:
    """Box (left, top, right, bottom), arrow and label of the key in the lower left corner."""
    length, label = _key(style)
    text = drawing.text_size(label)
    inside = max(round(length), text[0])
    box = (_MARGIN, height - _MARGIN - text[1] - 26, _MARGIN + inside + 16, height - _MARGIN)
    (arrow,) = lines(np.array([[box[0] + 8.0, box[1] + 10.0]]), np.array([[length, 0.0]]))
    return box, arrow, label


def raster(
    picture: NDArray[np.uint8], points: NDArray[np.float64], vectors: NDArray[np.float64], style: QuiverStyle
) -> NDArray[np.uint8]:
    """Draw the arrows on an enlarged copy of the picture."""
    out = drawing.magnified(picture, style.zoom)
    lines, still = shapes(points, vectors, style)
    rows, columns = np.rint(still[:, 1]).astype(int), np.rint(still[:, 0]).astype(int)
    inside = (rows >= 0) & (rows < out.shape[0]) & (columns >= 0) & (columns < out.shape[1])
    out[rows[inside], columns[inside]] = style.color
    _stroke(out, lines, style)
    if style.key:
        draw_key(out, style)
    return out


def draw_key(out: NDArray[np.uint8], style: QuiverStyle) -> None:
    """Draw an arrow of a round length with its unit in place, where there is room for it."""
    box, arrow, label = _key_layout(style, out.shape[0])
    if box[1] >= 0 and box[2] <= out.shape[1]:
        drawing.panel(out, *box)
        # By itself: what is laid over the picture at once is as large as what is around all of it.
        _stroke(out, [arrow], style)
        drawing.put_text(out, label, (box[0] + 8, box[3] - 8), rim=False)


def _stroke(out: NDArray[np.uint8], lines: list[NDArray[np.float64]], style: QuiverStyle) -> None:
    drawing.rimmed(out, drawing.Strokes(lines, style.color, style.line_width))


def svg(
    picture: NDArray[np.uint8], points: NDArray[np.float64], vectors: NDArray[np.float64], style: QuiverStyle
) -> str:
    """Write the same picture as SVG: the frame embedded as PNG, each arrow a path of its own."""
    import cv2

    height, width = picture.shape[0] * style.zoom, picture.shape[1] * style.zoom
    _, png = cv2.imencode(".png", picture)
    lines, still = shapes(points, vectors, style)
    # In SVG pixel (0, 0) covers 0 to 1: its centre is at 0.5.
    arrows = "\n".join(f'<path d="{_path(line + 0.5)}"/>' for line in lines)
    dots = "".join(f"M{x + 0.5:.2f} {y + 0.5:.2f}h0" for x, y in still)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">',
        f'<image width="{width}" height="{height}" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{base64.b64encode(png.tobytes()).decode()}"/>',
        f'<defs><g id="arrows">\n{arrows}\n</g></defs>',
        '<g fill="none" stroke-linecap="round" stroke-linejoin="round">',
        f'<path d="{dots}" stroke="{_hex(style.color)}" stroke-width="1"/>' if dots else "",
        *_twice('<use href="#arrows"/>', style),
        "</g>",
    ]
    if style.key:
        (left, top, right, bottom), arrow, label = _key_layout(style, height)
        parts += [
            f'<rect x="{left}" y="{top}" width="{right - left}" height="{bottom - top}" fill="#181818" opacity="0.7"/>',
            '<g fill="none" stroke-linecap="round" stroke-linejoin="round">',
            *_twice(f'<path class="key" d="{_path(arrow + 0.5)}"/>', style),
            "</g>",
            f'<text x="{left + 8}" y="{bottom - 8}" font-family="sans-serif" font-size="13" fill="#fff">'
            f"{escape(label)}</text>",
        ]
    return "\n".join([*(part for part in parts if part), "</svg>\n"])


def _twice(element: str, style: QuiverStyle) -> list[str]:
    """Draw an element in the rim's colour and width, then in its own."""
    return [
        f'<g stroke="{_hex(color)}" stroke-width="{width}">{element}</g>'
        for color, width in ((_RIM, style.line_width + 2), (style.color, style.line_width))
    ]


def _path(line: NDArray[Any]) -> str:
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in line)


def _hex(color: drawing.Color) -> str:
    blue, green, red = color
    return f"#{red:02x}{green:02x}{blue:02x}"
