"""Axes that are exchanged or mirrored, and the small turn that is left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ordered"]

F64 = NDArray[np.float64]


def ordered(rotation: F64) -> tuple[F64, F64]:
    """Take a rotation apart: the nearest exchange of axes with signs, and the small rotation vector left of it."""
    order = np.zeros((3, 3))
    size = np.abs(rotation)
    for row in np.argsort(-size.max(axis=1)):
        at = int(np.argmax(np.where(np.abs(order).sum(axis=0) > 0, -1.0, size[row])))
        order[row, at] = np.sign(rotation[row, at]) or 1.0
    rest = rotation @ order.T
    # The rotation nearest to what is left, as a vector.
    axis = np.array([rest[2, 1] - rest[1, 2], rest[0, 2] - rest[2, 0], rest[1, 0] - rest[0, 1]]) / 2
    sine, cosine = float(np.linalg.norm(axis)), float((np.trace(rest) - 1) / 2)
    return order, axis * (np.arctan2(sine, cosine) / sine if sine > 1e-12 else 1.0)
