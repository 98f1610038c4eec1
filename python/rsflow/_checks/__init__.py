"""The one check of each kind of argument: a number, an integer, a word, a flag, a path, a frame, a mask, points.

Each takes the argument's name and what the caller gave, and returns it in the type that the rest of the package works
with. Where it does not fit, the message is ``name: got X, expected Y``, as lk-core's is. Text is never taken for a
number, 2.9 never for 2, True never for 1, and NaN or infinity never for a number. numpy's scalars and its arrays of
no dimension count as what they hold.

An option (number, word, flag, size) that does not fit is an `OptionError`, whatever is wrong with it; an array, an
object or a path of the wrong kind is a `DTypeError`, and an array of the wrong shape a `ShapeError`.
"""

from __future__ import annotations

from .arrays import (
    array,
    bools,
    broadcast,
    coordinates,
    frame,
    mask,
    mask_or_none,
    pair,
    picture,
    points,
    unmasked,
    vector,
)
from .messages import described, refused, shown
from .options import (
    FLOAT32_MAX,
    any_of,
    choice,
    file_name,
    flag,
    function,
    instance,
    integer,
    integer_or_none,
    integers,
    iterable,
    number,
    number_or_none,
    options,
    path,
    region,
    size,
    text,
    whole,
)

__all__ = [
    "FLOAT32_MAX",
    "any_of",
    "array",
    "bools",
    "broadcast",
    "choice",
    "coordinates",
    "described",
    "file_name",
    "flag",
    "frame",
    "function",
    "instance",
    "integer",
    "integer_or_none",
    "integers",
    "iterable",
    "mask",
    "mask_or_none",
    "number",
    "number_or_none",
    "options",
    "pair",
    "path",
    "picture",
    "points",
    "refused",
    "region",
    "shown",
    "size",
    "text",
    "unmasked",
    "vector",
    "whole",
]
