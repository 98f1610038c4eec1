"""Which of some rows belongs to which of some columns at the least cost in all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F64 = NDArray[np.float64]


def assign(cost: F64, most: float) -> list[tuple[int, int]]:
    """Pair rows and columns so that the sum of the costs of the pairs is least, each unpaired row costing `most`.

    Exact: shortest augmenting paths (Jonker and Volgenant, Computing 38, 1987) over each group of rows and columns
    that are linked by costs below `most`. Of solutions of one cost always the same is given.

    Parameters
    ----------
    cost : (n, m) float64
        NaN and infinite where a pair is impossible.
    most : float
        A pair that costs as much or more is none.

    Returns
    -------
    list of (row, column)
        By row.
    """
    possible = cost < most
    pairs: list[tuple[int, int]] = []
    rows_left = np.flatnonzero(possible.any(axis=1)).tolist()
    seen: set[int] = set()
    for first in rows_left:
        if first in seen:
            continue
        rows, columns = _linked(possible, first)
        seen.update(rows)
        if len(rows) == 1 and len(columns) == 1:
            pairs.append((rows[0], columns[0]))
            continue
        block = np.where(possible[np.ix_(rows, columns)], cost[np.ix_(rows, columns)], most) - most
        pairs.extend((rows[i], columns[j]) for i, j in _solved(block) if possible[rows[i], columns[j]])
    return sorted(pairs)


def _linked(possible: NDArray[np.bool_], first: int) -> tuple[list[int], list[int]]:
    """Rows and columns that a chain of possible pairs links with a row."""
    rows = np.zeros(possible.shape[0], bool)
    rows[first] = True
    columns = possible[first].copy()
    while True:
        more = possible[:, columns].any(axis=1)
        if (more <= rows).all():
            return np.flatnonzero(rows).tolist(), np.flatnonzero(columns).tolist()
        rows |= more
        columns |= possible[rows].any(axis=0)


def _solved(cost: F64) -> list[tuple[int, int]]:
    """Pair every row of a block with a column, columns of no cost beside them for those that get none."""
    n, m = cost.shape
    wide = np.concatenate([cost, np.zeros((n, n))], axis=1)
    total = m + n
    row_price, column_price = np.zeros(n + 1), np.zeros(total + 1)
    # Row of each column, counted from 1; 0 is none. Column 0 holds the row that is being placed.
    owner = np.zeros(total + 1, np.intp)
    way = np.zeros(total + 1, np.intp)
    for row in range(1, n + 1):
        owner[0], column = row, 0
        least = np.full(total + 1, np.inf)
        used = np.zeros(total + 1, bool)
        while owner[column]:
            used[column] = True
            here = owner[column]
            reduced = wide[here - 1] - row_price[here] - column_price[1:]
            better = ~used[1:] & (reduced < least[1:])
            least[1:][better] = reduced[better]
            way[1:][better] = column
            free = np.where(used, np.inf, least)
            free[0] = np.inf
            following = int(np.argmin(free))
            delta = free[following]
            row_price[owner[used]] += delta
            column_price[used] -= delta
            least[~used] -= delta
            column = following
        while column:
            owner[column] = owner[way[column]]
            column = int(way[column])
    return [(int(owner[column]) - 1, column - 1) for column in range(1, m + 1) if owner[column]]
