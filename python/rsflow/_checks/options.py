"""Checks of options: numbers, words, flags, paths, and other single values."""

from __future__ import annotations

import inspect
import math
import operator
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import DTypeError
from .messages import refused

T = TypeVar("T")
Word = TypeVar("Word", bound=str)

# What lk-core's f32 options hold at most, and what its integers do.
FLOAT32_MAX = float(np.finfo(np.float32).max)
_INT_MAX = 2**63 - 1

# They have a length or a number's methods, and are not one.
_NO_NUMBER = (bool, np.bool_, np.timedelta64, np.complexfloating, np.flexible, np.ma.MaskedArray)


def number(
    name: str,
    value: object,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
    of: str = "",
    or_nan: bool = False,
    or_none: bool = False,
) -> float:
    """Take a finite real number, as float, within bounds; `of` is its unit, "pixels" say.

    With `or_nan` NaN is taken too, where it says that the number is not known.

    Examples
    --------
    >>> number("epsilon", np.float32(0.5), above=0, of="pixels")
    0.5
    >>> number("epsilon", "0.5", above=0, of="pixels")
    Traceback (most recent call last):
    rsflow.errors.OptionError: epsilon: got "0.5", expected a positive number of pixels
    """
    found = _real(value)
    if or_nan and found is not None and math.isnan(found):
        return found
    if (
        found is None
        or not math.isfinite(found)
        or (above is not None and not found > above)
        or (least is not None and not found >= least)
        or (below is not None and not found < below)
        or (most is not None and not found <= most)
    ):
        what = "a positive number" if above == 0 else "a finite number"
        bounds = _bounds(None if above == 0 else above, least, below, most if most != FLOAT32_MAX else None)
        text = f"{what}{f' of {of}' if of else ''}{bounds}"
        if found is not None and most == FLOAT32_MAX and found > most:
            text += f" up to {most:.3g}"
        raise refused(name, value, f"{text}, or None" if or_none else text)
    return found


def number_or_none(name: str, value: object, **bounds: Any) -> float | None:
    """Take a number as `number` does, or None."""
    return None if value is None else number(name, value, or_none=True, **bounds)


def _real(value: Any) -> float | None:
    """`value` as float where it is a real number; None where it is something else."""
    if isinstance(value, _NO_NUMBER) or (
        isinstance(value, np.ndarray) and (value.ndim or value.dtype.kind not in "fiu")
    ):
        return None
    kind = type(value)
    # float() alone also reads text and buffers.
    if not (hasattr(kind, "__float__") or hasattr(kind, "__index__")):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf
    except Exception:
        return None


def _bounds(above: float | None, least: float | None, below: float | None, most: float | None) -> str:
    words = []
    if least is not None and most is not None:
        return f" from {least:g} to {most:g}"
    if above is not None:
        words.append(f"above {above:g}")
    if least is not None:
        words.append(f"of at least {least:g}")
    if below is not None:
        words.append(f"below {below:g}")
    if most is not None:
        words.append(f"up to {most:g}")
    return f" {' and '.join(words)}" if words else ""


def integer(
    name: str,
    value: object,
    *,
    least: int | None = None,
    most: int | None = None,
    of: str = "",
    or_none: bool = False,
) -> int:
    """Take a whole number, as int, within bounds; without `most`, of 64 bits.

    Examples
    --------
    >>> integer("levels", np.int8(3), least=1)
    3
    >>> integer("levels", 2.9, least=1, or_none=True)
    Traceback (most recent call last):
    rsflow.errors.OptionError: levels: got 2.9, expected an integer of at least 1, or None
    """
    found = whole(value)
    if (
        found is None
        or (least is not None and found < least)
        or (most is not None and found > most)
        or not -_INT_MAX <= found <= _INT_MAX
    ):
        text = f"an integer{f' of {of}' if of else ''}"
        if least is not None and most is not None:
            text += f" from {least} to {most}"
        elif least is not None:
            text += f" of at least {least}"
        elif most is not None:
            text += f" of at most {most}"
        if found is not None and not -_INT_MAX <= found <= _INT_MAX:
            text += " that fits into 64 bits"
        raise refused(name, value, f"{text}, or None" if or_none else text)
    return found


def integer_or_none(name: str, value: object, **bounds: Any) -> int | None:
    """Take a whole number as `integer` does, or None."""
    return None if value is None else integer(name, value, or_none=True, **bounds)


def whole(value: Any) -> int | None:
    """Give `value` as int where it is a whole number; None where it is something else."""
    if isinstance(value, _NO_NUMBER):
        return None
    try:
        return operator.index(value)
    except Exception:
        return None


def integers(
    name: str, value: object, count: int, expected: str, *, least: int | None = None, most: int | None = None
) -> tuple[int, ...]:
    """Take a sequence of `count` whole numbers, (x, y, width, height) say, as a tuple.

    Examples
    --------
    >>> integers("board", np.array([9, 6]), 2, "(columns, rows)")
    (9, 6)
    >>> integers("board", "96", 2, "(columns, rows)")
    Traceback (most recent call last):
    rsflow.errors.OptionError: board: got "96", expected (columns, rows)
    """
    row = _row(value)
    found = [whole(item) for item in row] if len(row) == count else []
    fit = tuple(item for item in found if item is not None and abs(item) <= _INT_MAX)
    if len(fit) != count or (least is not None and min(fit) < least) or (most is not None and max(fit) > most):
        raise refused(name, value, expected)
    return fit


def _row(value: Any) -> Sequence[Any]:
    """Give a sequence in the sense of a list, of one dimension and in an order; anything else, text too, as empty."""
    if isinstance(value, np.ndarray):
        return list(value) if value.ndim == 1 and not isinstance(value, np.ma.MaskedArray) else []
    return value if isinstance(value, Sequence) and not isinstance(value, (str, bytes, bytearray, memoryview)) else []


def region(name: str, value: object) -> tuple[int, int, int, int]:
    """Take (x, y, width, height) in whole pixels."""
    x, y, width, height = integers(
        name, value, 4, "(x, y, width, height), four integers that are not negative", least=0
    )
    return x, y, width, height


def size(name: str, value: object, *, least: int = 1, most: int = 1_000_000) -> tuple[int, int]:
    """Take (width, height) in whole pixels."""
    width, height = integers(
        name, value, 2, f"(width, height), integers from {least} to {most}", least=least, most=most
    )
    return width, height


def text(name: str, value: object) -> str:
    """Take any text."""
    if not isinstance(value, str):
        raise refused(name, value, "text")
    return value


def choice(name: str, value: object, allowed: Iterable[Word], *, or_none: bool = False) -> Word:
    """Take one of the words in `allowed`.

    Examples
    --------
    >>> choice("preset", "best", ("ultrafast", "fast", "balanced", "accurate"))
    Traceback (most recent call last):
    rsflow.errors.OptionError: preset: got "best", expected "ultrafast", "fast", "balanced" or "accurate"
    """
    words = list(allowed)
    if isinstance(value, str):
        for word in words:
            if word == value:
                return word
    quoted = [f'"{word}"' for word in words] + (["None"] if or_none else [])
    raise refused(name, value, any_of(quoted))


def flag(name: str, value: object) -> bool:
    """Take True or False, numpy's included; 0, 1 and text are neither.

    Examples
    --------
    >>> flag("record", np.True_)
    True
    """
    if isinstance(value, np.ndarray) and value.ndim == 0 and not isinstance(value, np.ma.MaskedArray):
        value = value[()]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    raise refused(name, value, "True or False")


def path(name: str, value: object, expected: str = "a path") -> Path:
    """Take a file's name, a str or an `os.PathLike` of str.

    Examples
    --------
    >>> path("path", b"motion.flo")
    Traceback (most recent call last):
    rsflow.errors.DTypeError: path: got bytes, expected a path
    """
    given: object = None
    if isinstance(value, (str, os.PathLike)):
        try:
            given = os.fspath(value)
        except Exception:
            given = None
    if not isinstance(given, str):
        raise refused(name, value, expected, DTypeError)
    if not given or "\0" in given:
        raise refused(name, given, f"{expected}, not empty and without NUL")
    try:
        os.fsencode(given)
    except UnicodeEncodeError:
        raise refused(name, given, f"{expected} of characters that the file system can hold") from None
    return Path(given)


def file_name(name: str, value: object, suffixes: Sequence[str]) -> Path:
    """Take the name of a file to write, which ends in one of `suffixes`, in upper or lower case."""
    file = path(name, value)
    if file.suffix.lower() not in suffixes:
        raise refused(name, file, f"a name that ends in {any_of(suffixes)}")
    return file


def any_of(words: Sequence[str]) -> str:
    """Give "a, b or c".

    Examples
    --------
    >>> any_of(["a"]), any_of([".csv", ".parquet"])
    ('a', '.csv or .parquet')
    """
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def function(name: str, value: T, arguments: int) -> T:
    """Take something that can be called with so many arguments; what it raises then is the caller's own."""
    expected = f"a function of {arguments} argument{'s' if arguments > 1 else ''}"
    if not callable(value):
        raise refused(name, value, expected, DTypeError)
    try:
        inspect.signature(value).bind(*[None] * arguments)
    except TypeError:
        raise refused(name, value, expected, DTypeError) from None
    except Exception:
        # One that does not say what it takes, as many of C do not.
        return value
    return value


def iterable(name: str, value: object, expected: str) -> Iterable[Any]:
    """Take something that can be gone through, and is no text."""
    if isinstance(value, (str, bytes)) or (isinstance(value, np.ndarray) and value.ndim == 0):
        raise refused(name, value, expected, DTypeError)
    try:
        return iter(value)  # type: ignore[call-overload, no-any-return]
    except Exception:
        raise refused(name, value, expected, DTypeError) from None


def instance(name: str, value: object, kind: type[T] | tuple[type[T], ...], expected: str) -> T:
    """Take an object of a class."""
    if not isinstance(value, kind):
        raise refused(name, value, expected, DTypeError)
    return value


def options(call: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse a keyword that `call` does not have, as Python does for those in a signature."""
    import difflib

    names = list(known)
    for name in given:
        if name not in names:
            nearest = difflib.get_close_matches(name, names, n=1)
            hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
            raise TypeError(f"{call}() got an unexpected keyword argument {name!r}{hint}")
