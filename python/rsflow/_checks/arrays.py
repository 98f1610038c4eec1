"""Checks of arrays: frames, masks, points, pictures, vectors."""

from __future__ import annotations

from collections.abc import Sequence
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DTypeError, OptionError, ShapeError
from .messages import described, shown


def array(
    name: str,
    value: object,
    shape: Sequence[int | str] | EllipsisType,
    expected: str,
    *,
    kinds: str = "fiu",
    finite: bool = False,
) -> NDArray[Any]:
    """Take anything that numpy makes an array of real numbers of, of this shape; a word in `shape` is any length.

    An ellipsis for `shape` is any.

    Examples
    --------
    >>> array("matrix", [[1, 0], [0, 1]], (2, 2), "a matrix of 2 x 2").shape
    (2, 2)
    """
    if isinstance(value, np.ma.MaskedArray):
        raise DTypeError(f"{name}: got {described(value)}, expected {expected}, without a mask of its own")
    try:
        found = np.asarray(value)
    except Exception:
        # Rows of different lengths, numbers that no type holds, or a foreign object's own error.
        raise ShapeError(f"{name}: got {described(value)} that is no array, expected {expected}") from None
    if found.dtype.kind not in kinds and found.size:
        got = shown(value) if found.ndim == 0 else f"dtype {found.dtype}"
        raise DTypeError(f"{name}: got {got}, expected {expected}")
    if shape is not ... and (
        found.ndim != len(shape)
        or any(isinstance(side, int) and side != size for side, size in zip(shape, found.shape, strict=True))
    ):
        raise ShapeError(f"{name}: got shape {found.shape}, expected {expected}")
    if finite and found.dtype.kind == "f" and not np.isfinite(found).all():
        at = np.argwhere(~np.isfinite(found))[0].tolist()
        where = f"{at}" if at else ""
        raise OptionError(f"{name}{where}: got {shown(found[tuple(at)])}, expected {expected}")
    return found


def broadcast(names: str, first: NDArray[Any], second: NDArray[Any]) -> None:
    """Refuse two arrays whose shapes do not go together."""
    try:
        np.broadcast_shapes(first.shape, second.shape)
    except ValueError:
        shapes = f"{first.shape} and {second.shape}"
        raise ShapeError(f"{names}: got the shapes {shapes}, expected two that broadcast") from None


def vector(name: str, value: object, count: int, expected: str) -> NDArray[np.float64]:
    """Take `count` finite numbers as an array of float64; `expected` says which."""
    found = array(name, value, (count,), expected, finite=True)
    return found.astype(np.float64)


def coordinates(name: str, value: object) -> NDArray[Any]:
    """Take positions (x, y) as (N, 2) of any real type; an empty list has none. NaN is a point that is not known."""
    if isinstance(value, (list, tuple)) and not value:
        return np.empty((0, 2), np.float32)
    return array(name, value, ("N", 2), "(N, 2), x and y of each point")


def points(name: str, value: object) -> NDArray[np.float32]:
    """Take positions as `coordinates` does, as float32.

    Examples
    --------
    >>> points("points", [(1, 2), (3, 4)]).shape, points("points", []).shape
    ((2, 2), (0, 2))
    """
    # What float32 cannot hold is infinite, which is a point that cannot be measured.
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(coordinates(name, value), dtype=np.float32)


_FRAME = "a numpy array (height, width) of uint8, uint16 or float32"


def frame(name: str, value: object) -> NDArray[Any]:
    """Take a grey frame of uint8, uint16 or float32, as it is; lk-core's binding says the same in the same words."""
    if not isinstance(value, np.ndarray):
        raise DTypeError(f"{name}: got {described(value)}, expected {_FRAME}")
    unmasked(name, value)
    shape = value.shape
    if len(shape) == 3 and shape[2] in (3, 4):
        raise ShapeError(
            f"{name}: got colour, shape {shape}, expected grey (height, width): "
            f"convert it with cv2.cvtColor({name}, cv2.COLOR_BGR2GRAY), or read it with rsflow.frames"
        )
    if len(shape) != 2:
        raise ShapeError(f"{name}: got {len(shape)} dimensions, shape {shape}, expected 2: (height, width)")
    if value.dtype not in (np.uint8, np.uint16, np.float32):
        number = value.dtype.kind in "fiub"
        fix = (
            f"convert it with {name}.astype(numpy.float32)" if number else "rsflow never rescales or converts silently"
        )
        raise DTypeError(f"{name}: got dtype {value.dtype}, expected uint8, uint16 or float32: {fix}")
    return value


def pair(prev: object, next: object, names: tuple[str, str] = ("prev", "next")) -> tuple[NDArray[Any], NDArray[Any]]:
    """Take two frames of one type and one size."""
    first, second = frame(names[0], prev), frame(names[1], next)
    if first.dtype != second.dtype:
        raise DTypeError(f"{names[1]}: got dtype {second.dtype}, expected that of {names[0]}, {first.dtype}")
    if first.shape != second.shape:
        raise ShapeError(f"{names[1]}: got {second.shape}, expected the shape of {names[0]}, {first.shape}")
    return first, second


def unmasked(name: str, value: object) -> None:
    """Refuse numpy's masked array: its mask would be passed over."""
    if isinstance(value, np.ma.MaskedArray):
        raise DTypeError(
            f"{name}: got a masked array, expected a plain one: give {name}.data, and "
            f"mask=~numpy.ma.getmaskarray({name}) where there is a mask argument"
        )


def mask(name: str, value: object, shape: tuple[int, ...] | None = None, of: str = "the frames") -> NDArray[np.bool_]:
    """Take a bool array (height, width), of `shape` where that is known; lk-core's binding says the same."""
    if not isinstance(value, np.ndarray) or value.dtype != np.bool_ or value.ndim != 2:
        raise DTypeError(
            f"{name}: got {described(value)}, expected a bool array (height, width), True where to measure; of a "
            f"picture of numbers {name} != 0"
        )
    unmasked(name, value)
    if shape is not None and value.shape != shape:
        raise ShapeError(f"{name}: got shape {value.shape}, expected that of {of}, {shape}")
    return value


def mask_or_none(
    name: str, value: object, shape: tuple[int, ...] | None = None, of: str = "the frames"
) -> NDArray[np.bool_] | None:
    """Take a mask as `mask` does, or None."""
    return None if value is None else mask(name, value, shape, of)


def bools(name: str, value: object, shape: tuple[int, ...], of: str) -> NDArray[np.bool_]:
    """Take anything that numpy makes a bool array of `shape` of: where something is known, say."""
    found: NDArray[np.bool_] = array(name, value, ..., "bools", kinds="b")
    if found.shape != shape or found.dtype != np.bool_:
        raise ShapeError(f"{name}: got shape {found.shape}, expected that of {of}, {shape}")
    return found


def picture(name: str, value: object, *, uint8_only: bool = False) -> NDArray[Any]:
    """Take a picture to look at, (height, width) or (height, width, 3): uint8, or also uint16 and floating point."""
    expected = "uint8" if uint8_only else "uint8, uint16 or floating point"
    found = array(name, value, ..., f"a picture of {expected}", kinds="fiub")
    if found.ndim not in (2, 3) or (found.ndim == 3 and found.shape[2] != 3) or found.size == 0:
        raise ShapeError(f"{name}: got shape {found.shape}, expected (height, width) or (height, width, 3)")
    if found.dtype != np.uint8 and (uint8_only or (found.dtype != np.uint16 and found.dtype.kind != "f")):
        raise DTypeError(f"{name}: got dtype {found.dtype}, expected {expected}")
    return found
