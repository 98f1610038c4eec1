"""What the estimators of a run know, as numbers and arrays: written, and built again to the bit.

No code is stored and none is run: a state is a tree of plain values, arrays and the classes named here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._shared import Shared

__all__ = ["decode", "encode"]

# What of an object is not part of its state: it is made anew.
_MADE_ANEW = frozenset({"_flow", "_fixed", "_shared_lock"})


def _classes() -> dict[str, type]:
    from ..plotting import QuiverStyle
    from ..segmentation.levels import Levels
    from ..segmentation.objects import ObjectTracker
    from ..segmentation.segmenter import MotionSegmenter
    from ..segmentation.tracks.followed import Followed
    from .drift import Drift
    from .trajectory import Trajectory

    classes: tuple[type, ...] = (Levels, ObjectTracker, Followed, QuiverStyle, MotionSegmenter, Drift, Trajectory)
    return {item.__name__: item for item in classes}


def encode(value: Any, arrays: list[NDArray[Any]]) -> Any:
    """Give a value as JSON has it; arrays go to the end of `arrays` and are named by their place there.

    Raises
    ------
    TypeError
        If the value or a part of it is of a type that is not known here.
    """
    classes = _classes()

    def node(value: Any) -> Any:
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, np.generic):
            return {"scalar": value.dtype.str, "value": value.item()}
        if isinstance(value, np.ndarray):
            narrow = _narrow(value)
            # What goes on being worked with changes.
            arrays.append(narrow.copy() if np.may_share_memory(narrow, value) else narrow)
            return {"array": len(arrays) - 1, "dtype": value.dtype.str, "shape": list(value.shape)}
        if type(value) is list:
            return [node(item) for item in value]
        if type(value) is tuple:
            return {"tuple": [node(item) for item in value]}
        if type(value) is dict and all(type(name) is str for name in value):
            return {"dict": {name: node(item) for name, item in value.items()}}
        if classes.get(type(value).__name__) is type(value):
            state = {name: item for name, item in vars(value).items() if name not in _MADE_ANEW}
            if isinstance(value, Shared):
                state = value._packed(state)
            return {"object": type(value).__name__, "state": {name: node(item) for name, item in state.items()}}
        raise TypeError(f"a {type(value).__name__} is no part of a state")

    return node(value)


def decode(tree: Any, arrays: Sequence[NDArray[Any]], *, make: Mapping[str, Callable[[], Any]] | None = None) -> Any:
    """Build a value again; `make` gives those objects by class that have more than their state.

    Raises
    ------
    ValueError, KeyError, TypeError, IndexError, AttributeError
        If it is not what `encode` gives.
    """
    classes = _classes()
    make = make or {}

    def value(node: Any) -> Any:
        if node is None or isinstance(node, (bool, int, float, str)):
            return node
        if isinstance(node, list):
            return [value(item) for item in node]
        if "scalar" in node:
            return np.dtype(node["scalar"]).type(node["value"])
        if "array" in node:
            return _widened(arrays[node["array"]], np.dtype(node["dtype"]), tuple(node["shape"]))
        if "tuple" in node:
            return tuple(value(item) for item in node["tuple"])
        if "dict" in node:
            return {name: value(item) for name, item in node["dict"].items()}
        name = node["object"]
        made = make[name]() if name in make else object.__new__(classes[name])
        state = {attribute: value(item) for attribute, item in node["state"].items()}
        if isinstance(made, Shared):
            state = made._unpacked(state)
        for attribute, item in state.items():
            object.__setattr__(made, attribute, item)
        return made

    return value(tree)


def _narrow(array: NDArray[Any]) -> NDArray[Any]:
    """Give the same values in fewer bytes where that is exact: masks as bits, whole grey levels as integers."""
    plain = np.ascontiguousarray(array)
    if plain.dtype.kind == "b":
        return np.packbits(plain)
    if plain.dtype in (np.float32, np.int32) and plain.size:
        low, high = float(plain.min()), float(plain.max())
        if math.isfinite(low) and math.isfinite(high) and low >= 0 and high <= 65535:
            whole = plain.astype(np.uint8 if high <= 255 else np.uint16)
            # Compared as bits: a negative zero is another one than zero.
            if np.array_equal(whole.astype(plain.dtype).view(np.uint32), plain.view(np.uint32)):
                return whole
    return plain


def _widened(array: NDArray[Any], dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    if dtype.hasobject or array.dtype.hasobject:
        raise ValueError("an array of objects is no part of a state")
    if dtype.kind == "b" and array.dtype == np.uint8:
        return np.unpackbits(array, count=math.prod(shape)).view(bool).reshape(shape)
    return array.astype(dtype).reshape(shape)
