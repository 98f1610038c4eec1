"""How a message speaks of a value."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..errors import OptionError, RsflowError

# Longer than this, a value is cut in a message: a message is a line.
_LONGEST = 80


def shown(value: object) -> str:
    """Give what a message says of a value: short, on one line, and never an error of its own.

    Examples
    --------
    >>> shown("best"), shown(float("nan")), shown(b"21"), shown((1, 2)), shown([0] * 1000)
    ('"best"', 'NaN', 'bytes', '(1, 2)', 'list of 1000')
    """
    if isinstance(value, np.generic) and not isinstance(value, (np.datetime64, np.timedelta64, np.void)):
        value = value.item()
    if value is None or isinstance(value, bool):
        return str(value)
    if isinstance(value, str):
        return _quoted(value, _LONGEST)
    if isinstance(value, int) and value.bit_length() > 256:
        return f"an integer of {value.bit_length()} bits"
    if isinstance(value, float) and value != value:
        return "NaN"
    if type(value) in (int, float, complex):
        return str(value)
    if isinstance(value, np.ndarray):
        return described(value)
    if type(value) in (list, tuple) or isinstance(value, os.PathLike):
        return _short(value)
    return type(value).__name__


def _quoted(text: str, longest: int) -> str:
    """Quote text as Rust does; what cannot be printed is escaped."""
    body = repr(text[:longest])[1:-1].replace("\\'", "'").replace('"', '\\"')
    return f'"{body}"' if len(text) <= longest else f'"{body}..." ({len(text)} characters)'


def _short(value: Any) -> str:
    """Give a list, a tuple or a path as it prints, where that is short."""
    try:
        if isinstance(value, os.PathLike):
            return _quoted(os.fspath(value), 4 * _LONGEST)
        inside = ", ".join(map(shown, value)) if len(value) <= 16 else ""
    except Exception:
        # A foreign object's own methods, or a list that holds itself.
        return type(value).__name__
    if len(value) > 16 or len(inside) > _LONGEST:
        return f"{type(value).__name__} of {len(value)}"
    if isinstance(value, tuple):
        return f"({inside},)" if len(value) == 1 else f"({inside})"
    return f"[{inside}]"


def described(value: object) -> str:
    """Give what a message says of an array: its type and shape; of anything else its type.

    Examples
    --------
    >>> described(np.zeros((2, 3))), described([1])
    ('dtype float64, shape (2, 3)', 'list')
    """
    if isinstance(value, np.ndarray):
        kind = "masked array, " if isinstance(value, np.ma.MaskedArray) else ""
        return f"{kind}dtype {value.dtype}, shape {value.shape}"
    return type(value).__name__


def refused(name: str, value: object, expected: str, error: type[RsflowError] = OptionError) -> RsflowError:
    """Make the error ``name: got value, expected ...``, to be raised."""
    return error(f"{name}: got {shown(value)}, expected {expected}")
