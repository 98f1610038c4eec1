"""Pictures of motion: arrows over the picture, and Middlebury's colours.

Every picture is blue, green, red uint8, as OpenCV reads and writes them. A scale is fixed over a clip by fitting it
once (`QuiverStyle.fitted`, `fitted_max_flow`) and handing it to every call.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks
from ..errors import OptionError, ShapeError
from ..io.atomic import writing
from . import arrows, drawing
from .flow_color import color_wheel, fitted_max_flow, flow_over_picture, flow_to_color, largest_motion, vectors_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ..io.flow_files import FlowLike

    Field = FlowLike | ArrayLike
    Picture = NDArray[np.uint8]

__all__ = ["QuiverStyle", "color_wheel", "fitted_max_flow", "flow_over_picture", "flow_to_color", "quiver"]

# A field that hardly moves is noise: its arrows are not blown up beyond this many pixels per pixel of motion.
_HIGHEST_SCALE = 20.0


@dataclasses.dataclass(frozen=True)
class QuiverStyle:
    """How arrows are drawn; one style for all frames keeps the scale of a clip.

    Attributes
    ----------
    step : int
        Distance between arrows in pixels of the picture (MATLAB's ``DecimationFactor``).
    scale : float
        Length of an arrow in pixels of the picture per pixel of motion (MATLAB's ``ScaleFactor``).
    max_length : float or None
        Arrows longer than this many pixels of the picture are cut there and drawn without a head.
    color : (int, int, int)
        Blue, green, red.
    line_width : int
        Width of the lines in pixels of the result; a dark rim of one more pixel is around them.
    zoom : int
        How many times the picture is enlarged first.
    key : bool
        Whether an arrow of a round length with its unit is drawn in the lower left corner.
    unit : str
        What the key is labelled with.
    unit_per_px : float
        How much of the unit one pixel of motion is; with "m/s", for one, height / focal length x frame rate.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> style = rsflow.QuiverStyle.fitted(np.full((480, 640, 2), 3.0))
    >>> style.step, style.scale
    (16, 5.0)
    """

    step: int = 16
    scale: float = 1.0
    max_length: float | None = None
    color: tuple[int, int, int] = (0, 230, 255)
    line_width: int = 1
    zoom: int = 1
    key: bool = True
    unit: str = "px/frame"
    unit_per_px: float = 1.0

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        for name, most in (("step", 10_000), ("line_width", 255), ("zoom", 1000)):
            put(name, _checks.integer(name, getattr(self, name), least=1, most=most))
        for name in ("scale", "unit_per_px"):
            put(name, _checks.number(name, getattr(self, name), least=1e-9, most=1e9))
        put("max_length", _checks.number_or_none("max_length", self.max_length, least=1e-9, most=1e9, of="pixels"))
        levels = "(blue, green, red), integers from 0 to 255"
        put("color", _checks.integers("color", self.color, 3, levels, least=0, most=255))
        put("key", _checks.flag("key", self.key))
        put("unit", _checks.text("unit", self.unit))

    @classmethod
    def fitted(
        cls,
        fields: Field | list[Field],
        *,
        width: int | None = None,
        step: int | None = None,
        scale: float | None = None,
        **others: Any,
    ) -> QuiverStyle:
        """Choose step, scale and zoom from one field or several of one clip.

        Parameters
        ----------
        fields : FlowField, ndarray (height, width, 2) or (n, 2), or a list of them
            The first fields of a clip, for one; a list is taken as several.
        width : int, optional
            Width of the picture in pixels; needed with motions of points alone, (n, 2).
        step, scale : optional
            Taken as they are when given.
        **others
            The other attributes.

        Returns
        -------
        QuiverStyle
            40 arrows side by side, at least 8 px from each other, and a round scale at which the largest motions are
            up to a step and a half long. A picture below 480 px of width is enlarged.
        """
        largest = largest_motion(fields)
        if width is None:
            first = vectors_of(fields[0] if isinstance(fields, list | tuple) else fields, "fields")
            if first.ndim == 2:
                motions = "the picture's width in pixels, since fields are motions of points"
                raise _checks.refused("width", width, motions)
            width = first.shape[1]
        width = _checks.integer("width", width, least=1, most=1_000_000, of="pixels")
        if step is None:
            step = max(8, round(width / 40))
        cls(step=step)
        if scale is None:
            wanted = 1.5 * step / largest if largest > 0 else _HIGHEST_SCALE
            scale = drawing.round_number(min(wanted, _HIGHEST_SCALE), (1, 2, 3, 5, 7))
        if others.get("zoom") is None:
            others["zoom"] = max(1, math.ceil(480 / width))
        return cls(step=step, scale=scale, **others)


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
    unknown = set(knobs) - set(_KNOBS)
    if unknown:
        raise OptionError(f"quiver: got the knob {sorted(unknown)[0]!r}, expected one of {', '.join(_KNOBS)}")
    if style is not None:
        _checks.instance("style", style, QuiverStyle, "a QuiverStyle")
    if path is not None:
        path = drawing.expect_picture_name(path, vectors=True)
    uv = vectors_of(field)
    starts = None if points is None else _checks.coordinates("points", points)
    size = _size(uv, starts, picture)
    canvas = np.full((*size, 3), 48, np.uint8) if picture is None else drawing.displayed(picture)
    if canvas.shape[:2] != size:
        raise ShapeError(f"picture: got shape {canvas.shape[:2]}, expected that of the flow, {size}")
    shown: NDArray[np.bool_] = np.isfinite(uv[..., 0]) & np.isfinite(uv[..., 1])
    if valid is not None:
        shown &= _checks.bools("valid", valid, shown.shape, "the motion")
    if style is None:
        style = QuiverStyle.fitted([uv[shown]], width=size[1], **knobs)
    else:
        style = dataclasses.replace(style, **knobs)
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
