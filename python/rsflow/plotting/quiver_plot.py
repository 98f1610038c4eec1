"""Arrows over the picture.

Every picture is blue, green, red uint8, as OpenCV reads and writes them. A scale is fixed over a clip by fitting it
once (`QuiverStyle.fitted`, `fitted_max_flow`) and handing it to every call.
"""

from __future__ import annotations

import dataclasses
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks
from .._display import displayed
from ..errors import OptionError, ShapeError
from ..io.atomic import writing
from . import arrows, drawing
from .flow_color import vectors_of
from .style import QuiverStyle

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ..io.flow_files import FlowLike

    Field = FlowLike | ArrayLike
    Picture = NDArray[np.uint8]

__all__ = ["quiver"]


_KNOBS = tuple(knob.name for knob in dataclasses.fields(QuiverStyle))


def quiver(
    field: Field,
    *,
    picture: NDArray[Any] | None = None,
    points: ArrayLike | None = None,
    valid: ArrayLike | None = None,
    style: QuiverStyle | None = None,
    path: str | os.PathLike[str] | None = None,
    **knobs: Any,
) -> Picture:
    """Draw motion as arrows over a picture.

    Arrows start at the pixel of the first picture. They stand only where the motion is known: on a grid, or beside
    it at the nearest pixel that is known. A pixel that stands still has a dot, an unknown one has nothing.

    Parameters
    ----------
    field : FlowField or array_like, (height, width, 2) or with `points` (n, 2)
        Motion in pixels, x to the right, y down; NaN is unknown.
    picture : ndarray, (height, width) or (height, width, 3), optional
        What to draw on: the first of the two frames; uint8 is shown as it is, other types are stretched. By default
        dark grey.
    points : array_like, (n, 2), optional
        Where tracked points were; then `field` is their motion, and `picture` is needed.
    valid : array_like of bool, (height, width) or (n,), optional
        Where to draw; a field's own `valid` holds as well.
    style : QuiverStyle, optional
        How to draw; by default fitted to this field alone. Hand in the same one for every frame of a clip.
    path : path, optional
        Where to save it: ``.png``, ``.jpg``, or ``.svg``, in which the arrows are vectors over the embedded picture.
    **knobs
        Attributes of `QuiverStyle` to use instead of the style's: ``step``, ``scale``, ``zoom``, ``key``, ``unit``...

    Returns
    -------
    ndarray of uint8, (height, width, 3)
        The picture, enlarged by the style's zoom, blue, green, red.

    Raises
    ------
    ShapeError
        If the sizes do not fit together.
    DTypeError
        If the style is no `QuiverStyle`, or the field or the picture of another type.
    OptionError
        If a knob is unknown or out of range, or the suffix is another one.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> flow = np.zeros((96, 128, 2), np.float32)
    >>> flow[20:60, 30:90] = 4, -2
    >>> rsflow.quiver(flow, step=8, scale=2, zoom=4).shape
    (384, 512, 3)
    """
    expect_knobs(style, knobs)
    if path is not None:
        path = drawing.expect_picture_name(path, vectors=True)
    uv = vectors_of(field)
    starts = None if points is None else _checks.coordinates("points", points)
    size = _size(uv, starts, picture)
    canvas = np.full((*size, 3), 48, np.uint8) if picture is None else displayed(picture)
    if canvas.shape[:2] != size:
        raise ShapeError(f"picture: got shape {canvas.shape[:2]}, expected that of the flow, {size}")
    shown: NDArray[np.bool_] = np.isfinite(uv[..., 0]) & np.isfinite(uv[..., 1])
    if valid is not None:
        shown &= _checks.bools("valid", valid, shown.shape, "the motion")
    style = chosen_style(style, knobs, uv[shown], size[1])
    if starts is None:
        where = arrows.known_grid(shown, style.step)
        columns, rows = where.astype(int).T
        uv, shown = uv[rows, columns], shown[rows, columns]
    else:
        where = starts.astype(np.float64)
        shown &= np.isfinite(where).all(axis=1)
    where, vectors = where[shown], uv[shown].astype(np.float64)
    drawn = arrows.raster(canvas, where, vectors, style)
    if path is not None and path.suffix.lower() == ".svg":
        with writing(path) as partial:
            partial.write_text(arrows.svg(canvas, where, vectors, style), encoding="utf-8")
    elif path is not None:
        drawing.save_picture(path, drawn)
    return drawn


def expect_knobs(style: object, knobs: dict[str, Any]) -> None:
    """Refuse knobs that a style does not have, and a style that is none."""
    unknown = set(knobs) - set(_KNOBS)
    if unknown:
        raise OptionError(f"quiver: got the knob {sorted(unknown)[0]!r}, expected one of {', '.join(_KNOBS)}")
    if style is not None:
        _checks.instance("style", style, QuiverStyle, "a QuiverStyle")


def chosen_style(
    style: QuiverStyle | None, knobs: dict[str, Any], vectors: NDArray[np.float32], width: int
) -> QuiverStyle:
    """Give the style with these knobs; without one, what fits these vectors."""
    if style is None:
        return QuiverStyle.fitted([vectors], width=width, **knobs)
    return dataclasses.replace(style, **knobs)


def _size(uv: NDArray[np.float32], points: NDArray[Any] | None, picture: NDArray[Any] | None) -> tuple[int, int]:
    """Height and width of the picture that the motion belongs to."""
    if points is None:
        if uv.ndim != 3:
            raise ShapeError(
                f"field: got the motion of points, shape {uv.shape}, expected points=, which says where they were"
            )
        return uv.shape[0], uv.shape[1]
    if points.shape != uv.shape:
        raise ShapeError(f"points: got shape {points.shape}, expected that of their motion, (n, 2), {uv.shape}")
    if picture is None:
        raise OptionError("picture: got None, expected the picture that the points were found in")
    height, width = _checks.picture("picture", picture).shape[:2]
    return height, width
