"""What a result prints: numbers with their deviations, arrays as type and shape, never more than a line each."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from typing import Any

import numpy as np

from .._checks.messages import shown

# A value whose deviation is below this many decimals is written with so many.
_MOST_DECIMALS = 9
# Longer than this a line is broken.
_LINE = 120


def measured(value: float, std: float) -> str:
    """Give a number with its standard deviation, of which two digits are kept; the number alone where it has none.

    Examples
    --------
    >>> measured(2.25031, 0.00412), measured(657.8, 12.3), measured(1.5, float("inf")), measured(3.0, 0.0)
    ('2.2503 +- 0.0041', '658 +- 12', '1.5', '3')
    """
    if not (math.isfinite(value) and math.isfinite(std) and std > 0):
        return f"{value:.4g}"
    decimals = min(max(1 - math.floor(math.log10(std)), 0), _MOST_DECIMALS)
    return f"{value:.{decimals}f} +- {std:.{decimals}f}"


def options(**given: object) -> str:
    """Give options as a call has them, without those that are None or False.

    Examples
    --------
    >>> options(preset="fast", max_displacement=None, covariance=True, max_corners=400)
    'preset="fast", covariance=True, max_corners=400'
    """
    told = {name: value for name, value in given.items() if value is not None and value is not False}
    return ", ".join(f"{name}={shown(value)}" for name, value in told.items())


def fields(record: Any) -> str:
    """Give a dataclass in a line or three: what is long or an array by its type and size; for its `__repr__`.

    Examples
    --------
    >>> @dataclasses.dataclass
    ... class Pair:
    ...     prev: object
    ...     shift_px: float
    ...     __repr__ = fields
    >>> Pair(np.zeros((48, 64), np.uint8), 2.0)
    Pair(prev=<uint8 (48, 64)>, shift_px=2)
    """
    name = type(record).__name__
    told = [f"{item.name}={_value(getattr(record, item.name))}" for item in dataclasses.fields(record) if item.repr]
    indent = " " * (len(name) + 1)
    return textwrap.fill(f"{name}({', '.join(told)})", _LINE, subsequent_indent=indent, break_long_words=False)


def _value(value: Any) -> str:
    """Give a value as `shown` does; arrays and what has many entries in angle brackets."""
    if isinstance(value, np.ndarray) and value.ndim:
        return f"<{value.dtype} {value.shape}>"
    if isinstance(value, float):
        return f"{value:.6g}"
    if dataclasses.is_dataclass(value) or isinstance(value, dict):
        return f"<{type(value).__name__}{f' of {len(value)}' if isinstance(value, dict) else ''}>"
    return shown(value)
