"""Values between those that were measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["filled"]

# Rounds after which what is filled is left as it is, and the change, as a share of the span, below which it is at rest.
_ROUNDS = 2000
_AT_REST = 1e-5


def filled(values: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Fill what is not valid with the mean of its four neighbours, until nothing changes.

    >>> filled(np.array([[1.0, np.nan, 3.0]], np.float32), np.array([[True, False, True]]))
    array([[1., 2., 3.]], dtype=float32)
    """
    if not valid.any() or valid.all():
        return np.where(valid, values, np.float32(np.nan))
    known = values[valid].astype(np.float64)
    found = np.where(valid, values, known.mean()).astype(np.float64)
    span = float(np.ptp(known)) or 1.0
    for _ in range(_ROUNDS):
        wide = np.pad(found, 1, mode="edge")
        mean = 0.25 * (wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:])
        change = np.abs(mean - found)[~valid].max()
        found = np.where(valid, found, mean)
        if change < _AT_REST * span:
            break
    return found.astype(np.float32)
