"""Rows as columns of equal length: what `pandas.DataFrame` and a writer of files take."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def columns(rows: Iterable[Mapping[str, Any]], names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Give rows, which have at least these names, as one array for each name.

    Examples
    --------
    >>> table = columns([{"id": 1, "x_px": 2.5}, {"id": 2, "x_px": 3.5}], ("id", "x_px"))
    >>> table["id"].tolist(), table["x_px"].tolist(), columns([], ("id",))["id"].shape
    ([1, 2], [2.5, 3.5], (0,))
    """
    found = list(rows)
    return {name: np.array([row[name] for row in found]) for name in names}
