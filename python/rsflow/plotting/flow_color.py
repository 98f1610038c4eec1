"""Middlebury's colours: the hue is the direction of motion, the saturation its magnitude.

Public through `rsflow.plotting`. Pictures are blue, green, red uint8, as OpenCV reads and writes them.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks
from .._display import displayed
from ..errors import ShapeError
from ..io.flow_files import known_flow
from . import drawing

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ..io.flow_files import FlowLike

    Field = FlowLike | ArrayLike
    Picture = NDArray[np.uint8]

# What counts as the largest motion of a field: beyond it are outliers. Less than half a pixel is noise.
_LARGEST_PERCENTILE = 97.0
_LEAST_MAX_FLOW = 0.5
_LEAST_SHARE = 1e-3

# S. Baker et al., IJCV 92, 2011: hues between red, yellow, green, cyan, blue and magenta, and their steps.
_WHEEL_STEPS = (15, 6, 4, 11, 13, 6)


def vectors_of(field: Field, name: str = "field") -> NDArray[np.float32]:
    """Motion of pixels (height, width, 2) or of points (n, 2), NaN where unknown."""
    given = getattr(field, "uv", field)
    if isinstance(given, np.ndarray) and given.ndim == 2 and given.shape[1] == 2 and given.dtype.kind in "fiu":
        with np.errstate(over="ignore"):
            vectors = np.array(given, np.float32)
        if isinstance(given, np.ma.MaskedArray):
            vectors[np.ma.getmaskarray(given).any(axis=1)] = np.nan
        return vectors
    return known_flow(field, name)


def _flows(fields: Field | list[Field]) -> list[NDArray[np.float32]]:
    return [vectors_of(field, "fields") for field in (fields if isinstance(fields, list | tuple) else [fields])]


def largest_motion(fields: Field | list[Field]) -> float:
    """Largest motion in pixels of one field or several but for outliers, 0 where nothing is known.

    The 97th percentile of what moves, or of everything where too little moves to tell it from outliers: a small thing
    that moves before still ground sets the scale, not the ground's noise.
    """
    flows = _flows(fields)
    if not flows:
        raise _checks.refused("fields", fields, "a field or a list of at least one")
    lengths = np.concatenate([np.hypot(flow[..., 0], flow[..., 1]).ravel() for flow in flows])
    lengths = lengths[np.isfinite(lengths)]
    moving = lengths[lengths > _LEAST_MAX_FLOW]
    if moving.size < _LEAST_SHARE * lengths.size:
        moving = lengths
    return float(np.percentile(moving, _LARGEST_PERCENTILE)) if moving.size else 0.0


def fitted_max_flow(fields: Field | list[Field]) -> float:
    """Choose a `max_flow` for one field or several of one clip.

    Parameters
    ----------
    fields : FlowField, ndarray (height, width, 2), or a list of them
        The first fields of a clip, for one.

    Returns
    -------
    float
        In pixels: the 97th percentile of what moves, and at least 0.5, so that noise does not fill the wheel.

    Examples
    --------
    >>> import numpy as np
    >>> fitted_max_flow(np.full((10, 10, 2), (3.0, 4.0)))
    5.0
    """
    return max(largest_motion(fields), _LEAST_MAX_FLOW)


def flow_to_color(
    field: Field,
    *,
    max_flow: float | None = None,
    valid: ArrayLike | None = None,
    legend: bool = False,
    order: str = "bgr",
    path: str | os.PathLike[str] | None = None,
) -> Picture:
    """Show motion in Middlebury's colours: the hue is the direction, the saturation the magnitude.

    Parameters
    ----------
    field : FlowField or array_like, (height, width, 2)
        Motion in pixels, x to the right, y down.
    max_flow : float, optional
        Motion of full saturation in pixels; what is beyond is darkened. By default the largest in this field, as
        Middlebury's own code does; give one number (`fitted_max_flow`) to compare fields or frames.
    valid : array_like of bool, (height, width), optional
        Where it is known; a field's own `valid` holds as well. What is unknown is black, what stands still is white.
    legend : bool
        Whether the wheel with its scale is drawn in the lower right corner.
    order : {"bgr", "rgb"}
        Order of the channels: OpenCV's, or matplotlib's and Pillow's.
    path : path, optional
        Where to save it as ``.png`` or ``.jpg``.

    Returns
    -------
    ndarray of uint8, (height, width, 3)

    Raises
    ------
    ShapeError
        If the sizes do not fit together.
    OptionError
        If `max_flow` is not positive, or the order or suffix is another one.

    Notes
    -----
    The 55 colours of S. Baker et al., "A Database and Evaluation Methodology for Optical Flow", IJCV 92, 2011.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> flow = np.zeros((2, 2, 2), np.float32)
    >>> flow[0, 0] = 3, 0
    >>> rsflow.flow_to_color(flow, order="rgb")[0].tolist()  # to the right is red, still is white
    [[255, 0, 0], [255, 255, 255]]
    """
    _checks.choice("order", order, ("bgr", "rgb"))
    legend = _checks.flag("legend", legend)
    if path is not None:
        path = drawing.expect_picture_name(path)
    uv, known = _known(field, valid)
    out = _wheel_colors(uv, known, _checked_max_flow(max_flow, uv, known))
    if legend:
        _draw_legend(out, _checked_max_flow(max_flow, uv, known))
    if path is not None:
        drawing.save_picture(path, out)
    return out if order == "bgr" else np.ascontiguousarray(out[..., ::-1])


def flow_over_picture(
    field: Field,
    picture: NDArray[Any],
    *,
    max_flow: float | None = None,
    valid: ArrayLike | None = None,
    opacity: float = 0.75,
    legend: bool = True,
    path: str | os.PathLike[str] | None = None,
) -> Picture:
    """Lay Middlebury's colours over a picture: the more it moves, the more colour; what stands still stays grey.

    Parameters
    ----------
    field : FlowField or array_like, (height, width, 2)
        Motion in pixels, x to the right, y down.
    picture : ndarray, (height, width) or (height, width, 3)
        The first of the two frames.
    max_flow : float, optional
        Motion of full colour in pixels; by default `fitted_max_flow` of this field. Give one number for a clip.
    valid : array_like of bool, (height, width), optional
        Where it is known; a field's own `valid` holds as well. What is unknown is darkened.
    opacity : float
        Share of the colour at full motion, 0 to 1.
    legend : bool
        Whether the wheel with its scale is drawn in the lower right corner.
    path : path, optional
        Where to save it as ``.png`` or ``.jpg``.

    Returns
    -------
    ndarray of uint8, (height, width, 3)
        Blue, green, red.

    Raises
    ------
    ShapeError
        If the sizes do not fit together.
    OptionError
        If `max_flow` is not positive, the opacity not from 0 to 1, or the suffix another one.

    Examples
    --------
    >>> import numpy as np
    >>> flow_over_picture(np.ones((64, 64, 2)), np.zeros((64, 64), np.uint8), legend=False).shape
    (64, 64, 3)
    """
    opacity = _checks.number("opacity", opacity, least=0, most=1)
    legend = _checks.flag("legend", legend)
    if path is not None:
        path = drawing.expect_picture_name(path)
    uv, known = _known(field, valid)
    ground = displayed(picture)
    if ground.shape != (*uv.shape[:2], 3):
        raise ShapeError(f"picture: got shape {ground.shape[:2]}, expected that of field, {uv.shape[:2]}")
    limit = _checked_max_flow(fitted_max_flow(field) if max_flow is None else max_flow, uv, known)
    # At full saturation: how much it moves is told by the share of colour, so that the picture stays visible.
    length = np.hypot(uv[..., 0], uv[..., 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = np.where((length > 0)[..., None], uv / length[..., None], 0)
    hue = _wheel_colors(unit.astype(np.float32), known, 1.0)
    share = np.where(known, np.clip(length / limit, 0, 1), 0.5 / max(opacity, 1e-6))[..., None] * opacity
    grey = np.repeat(ground.mean(axis=2, keepdims=True), 3, axis=2)
    out: Picture = (grey * (1 - share) + hue * share).astype(np.uint8)
    if legend:
        _draw_legend(out, limit)
    if path is not None:
        drawing.save_picture(path, out)
    return out


def color_wheel(size: int = 151) -> Picture:
    """Draw Middlebury's colour wheel: the colour of each direction and magnitude, black outside.

    Parameters
    ----------
    size : int
        Width and height in pixels, from 3.

    Returns
    -------
    ndarray of uint8, (size, size, 3)
        Blue, green, red.

    Raises
    ------
    OptionError
        If the size is below 3.

    Examples
    --------
    >>> color_wheel(51)[25, 25].tolist()
    [255, 255, 255]
    """
    size = _checks.integer("size", size, least=3, most=10_000, of="pixels")
    radius = (size - 1) / 2
    y, x = np.mgrid[:size, :size].astype(np.float32) - np.float32(radius)
    return _wheel_colors(np.dstack([x, y]), np.hypot(x, y) <= radius, radius)


def _known(field: Field, valid: ArrayLike | None) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Motion with zero where it is unknown, and where it is known."""
    uv = known_flow(field)
    known = np.isfinite(uv[..., 0])
    if valid is not None:
        known &= _checks.bools("valid", valid, known.shape, "the flow")
    uv[~known] = 0
    return uv, known


def _checked_max_flow(max_flow: float | None, uv: NDArray[np.float32], known: NDArray[np.bool_]) -> float:
    if max_flow is None:
        largest = float(np.hypot(uv[..., 0], uv[..., 1]).max()) if known.any() else 0.0
        return largest if largest > 0 else 1.0
    return _checks.number("max_flow", max_flow, least=1e-30, most=1e30, of="pixels", or_none=True)


def _wheel() -> NDArray[np.float32]:
    """Return the 55 colours, red first, as red, green, blue from 0 to 1."""
    red_yellow, yellow_green, green_cyan, cyan_blue, blue_magenta, magenta_red = _WHEEL_STEPS
    parts = []
    # Of each pair of primaries one channel is full, one rises or falls, one is zero.
    for count, full, changing, rises in (
        (red_yellow, 0, 1, True),
        (yellow_green, 1, 0, False),
        (green_cyan, 1, 2, True),
        (cyan_blue, 2, 1, False),
        (blue_magenta, 2, 0, True),
        (magenta_red, 0, 2, False),
    ):
        part = np.zeros((count, 3), np.float32)
        ramp = np.floor(255 * np.arange(count) / count)
        part[:, full] = 255
        part[:, changing] = ramp if rises else 255 - ramp
        parts.append(part)
    return np.concatenate(parts) / np.float32(255)


def _wheel_colors(uv: NDArray[np.float32], known: NDArray[np.bool_], max_flow: float) -> Picture:
    wheel = _wheel()
    u, v = uv[..., 0] / np.float32(max_flow), uv[..., 1] / np.float32(max_flow)
    radius = np.hypot(u, v)[..., None]
    place = (np.arctan2(-v, -u) / np.float32(np.pi) + 1) / 2 * (len(wheel) - 1)
    lower = place.astype(np.int32)
    share = (place - lower)[..., None]
    color = (1 - share) * wheel[lower] + share * wheel[(lower + 1) % len(wheel)]
    color = np.where(radius <= 1, 1 - radius * (1 - color), color * np.float32(0.75))
    out = (255 * color).astype(np.uint8)
    out[~known] = 0
    return np.ascontiguousarray(out[..., ::-1])


def _draw_legend(out: Picture, max_flow: float) -> None:
    """Draw the wheel and the motion at its rim in place, where the picture has room for them."""
    height, width = out.shape[:2]
    size = min(91, min(height, width) // 4)
    label = f"rim: {max_flow:.3g} px"
    text = drawing.text_size(label)
    if size < 21 or text[0] + 24 > width:
        return
    wide = max(size, text[0]) + 16
    left, top = width - 8 - wide, height - 8 - size - text[1] - 22
    drawing.panel(out, left, top, width - 8, height - 8)
    wheel = color_wheel(size)
    x = left + (wide - size) // 2
    place = out[top + 6 : top + 6 + size, x : x + size]
    inside = wheel.any(axis=2)
    place[inside] = wheel[inside]
    drawing.put_text(out, label, (left + (wide - text[0]) // 2, height - 16), rim=False)
