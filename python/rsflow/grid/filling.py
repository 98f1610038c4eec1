"""Values between those that were measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._display import fields

__all__ = ["Replaced", "filled"]

# Rounds after which what is filled is left as it is, and the change, as a share of the span, below which it is at rest.
_ROUNDS = 2000
_AT_REST = 1e-5


@dataclass(frozen=True, eq=False)
class Replaced:
    """Displacements of all nodes: measured where they are valid, else from the valid ones around them.

    Attributes
    ----------
    u, v : ndarray of float32, shape (ny, nx)
        Displacement in pixels; NaN if no node is valid.
    replaced : ndarray of bool, shape (ny, nx)
        Where it was not measured.

    Examples
    --------
    >>> import rsflow
    >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0 * x + 1.0, 0 * y), size=(96, 96), seed=1)
    >>> rsflow.displacement_grid(scene.prev, scene.next).replaced().replaced.any()
    np.False_
    """

    u: NDArray[np.float32]
    v: NDArray[np.float32]
    replaced: NDArray[np.bool_]

    __repr__ = fields


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
