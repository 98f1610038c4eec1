"""A mask of the first frame, carried to a later one by what a grid measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .filling import filled
from .result import Grid

__all__ = ["carried"]

F64 = NDArray[np.float64]

# Steps of the fixed point: what deviates from the mean motion shrinks by its gradient in each.
_STEPS = 12
# Pixels that are worked on at once.
_BAND = 1 << 18


def carried(mask: NDArray[np.bool_], grid: Grid) -> NDArray[np.bool_]:
    """Give which pixels of the newer frame of `grid` show what counts in the older one.

    A pixel q shows the place p with p + u(p) = q. With the mean motion A p + b of the nodes taken out, it is the fixed
    point of p = A^-1 (q - b - r(p)); r lies between the nodes, filled in where they are not valid, and runs on beyond
    them. What came from outside the older frame does not count, nor does anything where no node is valid.
    """
    height, width = mask.shape
    counts = np.zeros(mask.shape, np.bool_)
    if not grid.valid.any():
        return counts
    moved = grid.raw.astype(np.float64)
    places = np.stack([grid.x, grid.y], axis=-1).astype(np.float64)
    turn, shift = _mean_motion(places[grid.valid], moved[grid.valid])
    back = np.linalg.inv(turn)
    beside = (places + moved - places @ turn.T - shift).astype(np.float32)
    rest = np.stack([filled(beside[..., k], grid.valid) for k in range(2)], axis=-1).astype(np.float64)
    rows = max(_BAND // width, 1)
    for top in range(0, height, rows):
        bottom = min(top + rows, height)
        y, x = np.mgrid[top:bottom, :width].astype(np.float64)
        target = np.stack([x, y], axis=-1).reshape(-1, 2) - shift
        at = target @ back.T
        for _ in range(_STEPS):
            at = (target - _between(rest, places[0, 0], grid.step, at)) @ back.T
        column, row = (np.rint(np.nan_to_num(at[:, k], nan=-1.0)).clip(-1, 1 << 30).astype(np.int64) for k in range(2))
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        found = np.zeros(len(at), np.bool_)
        found[inside] = mask[row[inside], column[inside]]
        counts[top:bottom] = found.reshape(bottom - top, width)
    return counts


def _mean_motion(places: F64, moved: F64) -> tuple[F64, F64]:
    """Fit where places go by an affine map, or by a shift where they do not tell one."""
    middle = places.mean(axis=0)
    around = places - middle
    turn = np.eye(2)
    if np.linalg.matrix_rank(around) == 2:
        turn = turn + np.linalg.lstsq(around, moved, rcond=None)[0].T
        if np.linalg.det(turn) < 0.1:
            turn = np.eye(2)
    return turn, middle + moved.mean(axis=0) - turn @ middle


def _between(values: F64, first: F64, step: int, at: F64) -> F64:
    """Blend the values of the four nodes around each place, up to a cell beyond them."""
    corners: list[list[tuple[NDArray[np.int64], F64]]] = []
    for axis in range(2):
        count = values.shape[1 - axis]
        place = (at[:, axis] - first[axis]) / step
        place = np.clip(np.nan_to_num(place), -1.0, float(count)) if count > 1 else np.zeros(len(at))
        low = np.clip(np.floor(place).astype(np.int64), 0, max(count - 2, 0))
        share = place - low
        corners.append([(low, 1.0 - share), (np.minimum(low + 1, count - 1), share)])
    found = np.zeros((len(at), 2))
    for column, across in corners[0]:
        for row, down in corners[1]:
            found += (across * down)[:, None] * values[row, column]
    return found
