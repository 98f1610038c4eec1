"""How arrows are drawn: where, how long, in which colour."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING, Any

from .. import _checks
from . import drawing
from .flow_color import largest_motion, vectors_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..io.flow_files import FlowLike

    Field = FlowLike | ArrayLike

__all__ = ["QuiverStyle"]

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
