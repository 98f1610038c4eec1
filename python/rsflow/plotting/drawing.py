"""Raster drawing on pictures with OpenCV: grey to colour, text, panels, lines, and saving."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import _checks, _core
from ..errors import OptionError
from ..io.atomic import writing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Color = tuple[int, int, int]
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")

# Coordinates are given to OpenCV in 1/16 px.
_SHIFT = 4
_INK: Color = (255, 255, 255)
_PANEL: Color = (24, 24, 24)
# Letters and lines of one size are read on pictures up to this side, in pixels.
_PLAIN_SIDE = 1000
# So many lines are drawn one by one.
_FEW_LINES = 200
_SQUARE = np.ones((3, 3), np.uint8)
# What a panel leaves of each level.
_DARKER = (np.arange(256) * 0.3 + _PANEL[0] * 0.7).astype(np.uint8)


def distinct_color(number: int) -> Color:
    """Return a bright colour that differs from those of the numbers nearby: hues a golden angle apart."""
    hue = (number * 0.61803) % 1.0 * 6
    wave = [255 * min(max(abs((hue + shift) % 6 - 3) - 1, 0.25), 1) for shift in (4.0, 2.0, 0.0)]
    return int(wave[0]), int(wave[1]), int(wave[2])


def size_for(shape: tuple[int, ...]) -> float:
    """Say how many times as large letters and lines are on a picture of (height, width), to be read alike."""
    return max(1.0, max(shape[:2]) / _PLAIN_SIDE)


def magnified(picture: NDArray[np.uint8], zoom: int) -> NDArray[np.uint8]:
    """Enlarge by a whole number; the centre of pixel x comes to (x + 0.5) zoom - 0.5."""
    if zoom == 1:
        return picture.copy()
    import cv2

    size = (picture.shape[1] * zoom, picture.shape[0] * zoom)
    enlarged: NDArray[np.uint8] = cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)
    return enlarged


def polylines(picture: NDArray[np.uint8], lines: Sequence[NDArray[np.float64]], color: Color, width: int) -> None:
    """Draw open lines of (n, 2) points, anti-aliased, in place; far outside the picture they are cut off."""
    import cv2

    if not lines:
        return
    cv2.polylines(picture, _fixed(lines), False, color, width, cv2.LINE_AA, _SHIFT)


def _fixed(lines: Sequence[NDArray[np.float64]], origin: tuple[int, int] = (0, 0)) -> list[NDArray[np.int32]]:
    """Points as OpenCV takes them, from an origin on; those far outside of any picture come nearer."""
    limit = 1 << 14
    points = np.clip(np.concatenate(lines), -limit, limit) - origin
    fixed = np.rint(points * (1 << _SHIFT)).astype(np.int32)
    ends = np.cumsum([len(line) for line in lines]).tolist()
    return [fixed[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]


@dataclasses.dataclass(frozen=True)
class Strokes:
    """Open lines of (n, 2) points each, in one colour or one for each, of one width."""

    lines: Sequence[NDArray[np.float64]]
    color: Color | list[Color]
    width: int = 1

    def by_color(self) -> dict[Color, list[int]]:
        """Give the numbers of the lines of each colour."""
        if not isinstance(self.color, list):
            return {self.color: list(range(len(self.lines)))}
        found: dict[Color, list[int]] = {}
        for number, color in enumerate(self.color):
            found.setdefault(color, []).append(number)
        return found


def rimmed(picture: NDArray[np.uint8], *groups: Strokes) -> None:
    """Draw lines with a dark rim of a pixel, anti-aliased, in place.

    Many go into one plane of shares first, which is laid over the picture once: OpenCV takes five times as long to draw
    wide lines smoothly.
    """
    groups = tuple(group for group in groups if group.lines)
    if sum(len(group.lines) for group in groups) > _FEW_LINES:
        _laid_over(picture, groups)
        return
    for group in groups:
        polylines(picture, group.lines, _PANEL, group.width + 2)
    for group in groups:
        for color, numbers in group.by_color().items():
            polylines(picture, [group.lines[number] for number in numbers], color, group.width)


def _laid_over(picture: NDArray[np.uint8], groups: tuple[Strokes, ...]) -> None:
    """Draw lines with their rims over a picture at once, in place."""
    import cv2

    height, wide = picture.shape[:2]
    reach = max(group.width for group in groups) + 2
    points = np.concatenate([line for group in groups for line in group.lines])
    left, top = (max(int(least) - reach, 0) for least in np.clip(points.min(axis=0), 0, (wide, height)))
    right, bottom = np.clip(np.ceil(points.max(axis=0)) + reach + 1, 0, (wide, height)).astype(int)
    if left >= right or top >= bottom:
        return
    part = picture[top:bottom, left:right]
    ink = np.zeros(part.shape[:2], np.uint8)
    colored: list[tuple[Color, list[NDArray[np.int32]], int]] = []
    for group in groups:
        fixed = _fixed(group.lines, (left, top))
        own = ink if group.width == 1 else np.zeros_like(ink)
        cv2.polylines(own, fixed, False, 255, 1, cv2.LINE_AA, _SHIFT)
        if group.width > 1:
            shape = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (group.width, group.width))
            cv2.max(ink, cv2.dilate(own, shape), ink)
        for color, numbers in group.by_color().items():
            colored.append((color, [fixed[number] for number in numbers], group.width))
    rim = np.asarray(cv2.GaussianBlur(cv2.dilate(ink, _SQUARE), (3, 3), 0), np.uint8)
    # Most lines have one colour: only the others have to be found in the picture, as many as a byte tells apart.
    usual = max(colored, key=lambda each: len(each[1]))[0]
    others = [each for each in colored if each[0] != usual][:255]
    which = None
    if others:
        which = np.zeros_like(ink)
        for number, (_, fixed, width) in enumerate(others, 1):
            cv2.polylines(which, fixed, False, number, width + 2, cv2.LINE_8, _SHIFT)
    _core.lay_ink(part, ink, rim, which, [usual, *(color for color, _, _ in others)])


def disc(picture: NDArray[np.uint8], centre: NDArray[np.floating], radius: int, color: Color) -> None:
    """Draw a disc, anti-aliased, in place; one far outside the picture is left out."""
    import cv2

    if np.abs(centre).max() < 1 << 14:
        x, y = (round(float(value) * (1 << _SHIFT)) for value in centre)
        cv2.circle(picture, (x, y), radius << _SHIFT, color, cv2.FILLED, cv2.LINE_AA, _SHIFT)


def text_size(text: str, *, size: float = 1.0) -> tuple[int, int]:
    """Width and height in pixels of a text drawn by `put_text`."""
    import cv2

    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * size, 1)
    return int(width), int(height)


def put_text(
    picture: NDArray[np.uint8],
    text: str,
    corner: tuple[int, int],
    *,
    size: float = 1.0,
    color: Color = _INK,
    rim: bool = True,
) -> None:
    """Draw a text in place, its lower left at (x, y); a dark rim keeps it legible on any picture."""
    import cv2

    for ink, width in ((_PANEL, 3), (color, 1)) if rim else ((color, 1),):
        cv2.putText(picture, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * size, ink, width, cv2.LINE_AA)


def panel(picture: NDArray[np.uint8], left: int, top: int, right: int, bottom: int) -> None:
    """Darken a box in place, as the ground of a legend."""
    box = picture[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)]
    if box.size:
        import cv2

        box[...] = cv2.LUT(box, _DARKER)


def round_number(value: float, steps: Sequence[float] = (1.0, 2.0, 5.0)) -> float:
    """Return the largest of the steps times a power of ten that is not above a positive value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step for step in steps if step * power <= value * (1 + 1e-9)) * power)


def expect_picture_name(path: object, *, vectors: bool = False) -> Path:
    """Take a path whose suffix says PNG, JPEG or, with `vectors`, SVG."""
    return _checks.file_name("path", path, (*PICTURE_SUFFIXES, ".svg") if vectors else PICTURE_SUFFIXES)


def svg_of(picture: NDArray[np.uint8]) -> str:
    """Give a picture, (height, width, 3) in blue, green, red, as the text of an SVG file that holds it."""
    import base64

    import cv2

    data = base64.b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode("ascii")
    height, width = picture.shape[:2]
    size = f'width="{width}" height="{height}"'
    image = f'<image {size} href="data:image/png;base64,{data}"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {width} {height}">{image}</svg>\n'


def save_picture(path: str | os.PathLike[str], picture: NDArray[np.uint8]) -> None:
    """Write a picture as PNG or JPEG, beside its final name first.

    Raises
    ------
    OptionError
        If the suffix is another one.
    OSError
        If it cannot be written.
    """
    import cv2

    path = expect_picture_name(path)
    done, data = cv2.imencode(path.suffix.lower(), picture)
    if not done:
        size = f"{picture.shape[1]} x {picture.shape[0]}"
        raise OptionError(f"{path}: got {size} pixels, expected a size that OpenCV can encode as {path.suffix}")
    with writing(path) as partial:
        partial.write_bytes(data.tobytes())
