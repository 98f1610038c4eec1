"""Results in the caller's arrays, as OpenCV's functions give them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["in_place"]


def in_place(given: Any, computed: NDArray[Any]) -> NDArray[Any]:
    """Write to the caller's array and return it where shape and type fit; else return what was computed, as OpenCV."""
    fits = isinstance(given, np.ndarray) and given.dtype == computed.dtype and given.shape == computed.shape
    if fits and given.flags.writeable:
        given[...] = computed
        return np.asarray(given)
    return computed
