"""Values that no argument, or hardly any, expects: what a careless and what a hostile caller would pass."""

from __future__ import annotations

import datetime
import io
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

HEIGHT, WIDTH = 24, 32


class Hostile:
    """An object whose own methods all fail."""

    def _fail(self, *_: object) -> Any:
        raise ZeroDivisionError("a fault of the caller's own object")

    __repr__ = __str__ = __float__ = __index__ = __int__ = __len__ = __iter__ = __next__ = _fail
    __array__ = __fspath__ = __bool__ = __eq__ = __lt__ = __getitem__ = __call__ = __enter__ = __exit__ = _fail
    __hash__ = None  # type: ignore[assignment]


class Subclassed(np.ndarray):
    """An array of a class of its own."""


def _frame(dtype: Any) -> np.ndarray[Any, Any]:
    return np.random.default_rng(3).integers(0, 200, (HEIGHT, WIDTH)).astype(dtype)


def _nested() -> list[Any]:
    endless: list[Any] = []
    endless.append(endless)
    return endless


def _objects(*values: Any) -> np.ndarray[Any, Any]:
    array = np.empty(len(values), object)
    array[:] = values
    return array


def _read_only() -> np.ndarray[Any, Any]:
    frame = _frame(np.uint8)
    frame.flags.writeable = False
    return frame


# Each is made anew for each call, since a call may use it up.
VALUES: dict[str, Callable[[Path], Any]] = {
    "None": lambda _: None,
    "True": lambda _: True,
    "False": lambda _: False,
    "numpy True": lambda _: np.True_,
    "0": lambda _: 0,
    "-1": lambda _: -1,
    "1": lambda _: 1,
    "7": lambda _: 7,
    "2.9": lambda _: 2.9,
    "-0.5": lambda _: -0.5,
    "nan": lambda _: float("nan"),
    "inf": lambda _: float("inf"),
    "-inf": lambda _: float("-inf"),
    "1e300": lambda _: 1e300,
    "1e-300": lambda _: 1e-300,
    "10**30": lambda _: 10**30,
    "-10**30": lambda _: -(10**30),
    "2**63": lambda _: 2**63,
    "10**5000": lambda _: 10**5000,
    "complex": lambda _: 1 + 2j,
    "fraction": lambda _: Fraction(1, 3),
    "decimal NaN": lambda _: Decimal("NaN"),
    "numpy int": lambda _: np.int16(3),
    "numpy float": lambda _: np.float32(3.5),
    "0-d int": lambda _: np.array(3),
    "0-d float": lambda _: np.array(2.9),
    "0-d text": lambda _: np.array("21"),
    "empty text": lambda _: "",
    "21": lambda _: "21",
    "none": lambda _: "none",
    "surrogate": lambda _: "\ud800",
    "NUL": lambda _: "a\0b",
    "no file": lambda _: "nowhere/nothing.png",
    "long text": lambda _: "x" * 5000,
    "lines": lambda _: "a\nb\r\x1b[31m",
    "numpy text": lambda _: np.str_("21"),
    "bytes": lambda _: b"21",
    "no bytes": lambda _: b"",
    "bytearray": lambda _: bytearray(b"21"),
    "memoryview": lambda _: memoryview(b"2"),
    "numpy date": lambda _: np.datetime64("2020-01-01"),
    "NaT": lambda _: np.timedelta64("NaT"),
    "date": lambda _: datetime.datetime(2020, 1, 1),
    "masked": lambda _: np.ma.masked,
    "[]": lambda _: [],
    "[1]": lambda _: [1],
    "[None]": lambda _: [None],
    "ragged": lambda _: [[1, 2], [3]],
    "words": lambda _: ["a", "b"],
    "endless": lambda _: _nested(),
    "()": lambda _: (),
    "(1, 2)": lambda _: (1, 2),
    "(-1, 2)": lambda _: (-1, 2),
    "(1.5, 2.5)": lambda _: (1.5, 2.5),
    "(1, 2, 3)": lambda _: (1, 2, 3),
    "(1, 2, 3, 4)": lambda _: (1, 2, 3, 4),
    "(nan, 1, 2)": lambda _: (float("nan"), 1.0, 2.0),
    "(10**400, 1)": lambda _: (10**400, 1),
    "(True, '1')": lambda _: (True, "1"),
    "{}": lambda _: {},
    "{'a': 1}": lambda _: {"a": 1},
    "set": lambda _: {1, 2},
    "range": lambda _: range(3),
    "generator": lambda _: (i for i in range(3)),
    "iterator": lambda _: iter([1, 2]),
    "object": lambda _: object(),
    "hostile": lambda _: Hostile(),
    "[hostile]": lambda _: [Hostile()],
    "lambda": lambda _: lambda: None,
    "type": lambda _: int,
    "ellipsis": lambda _: ...,
    "error": lambda _: ValueError("a value"),
    "file": lambda _: io.BytesIO(b"abc"),
    "path to nowhere": lambda folder: folder / "nowhere" / "nothing.npy",
    "folder": lambda folder: folder,
    "folder as text": lambda folder: str(folder),
    "text file": lambda folder: folder / "latin1.txt",
    "empty array": lambda _: np.zeros((0, 0), np.uint8),
    "no rows": lambda _: np.zeros((0, 2)),
    "row": lambda _: np.zeros(5),
    "2 x 3": lambda _: np.zeros((2, 3)),
    "2 x 2 of nan": lambda _: np.full((2, 2), np.nan),
    "3 x 3": lambda _: np.arange(9.0).reshape(3, 3),
    "3 x 3 of 0": lambda _: np.zeros((3, 3)),
    "3-d": lambda _: np.zeros((3, 4, 5)),
    "5-d": lambda _: np.zeros((1, 1, 1, 1, 1), np.uint8),
    "one pixel": lambda _: np.zeros((1, 1), np.uint8),
    "bool frame": lambda _: np.zeros((HEIGHT, WIDTH), bool),
    "uint8 frame": lambda _: _frame(np.uint8),
    "uint16 frame": lambda _: _frame(np.uint16),
    "float64 frame": lambda _: _frame(np.float64),
    "int64 frame": lambda _: _frame(np.int64),
    "nan frame": lambda _: np.full((HEIGHT, WIDTH), np.nan, np.float32),
    "inf frame": lambda _: np.full((HEIGHT, WIDTH), np.inf, np.float32),
    "huge frame": lambda _: np.full((HEIGHT, WIDTH), 3e38, np.float32),
    "float16 frame": lambda _: _frame(np.float16),
    "big-endian frame": lambda _: _frame(">u2"),
    "read-only frame": lambda _: _read_only(),
    "fortran frame": lambda _: np.asfortranarray(_frame(np.uint8)),
    "backwards frame": lambda _: _frame(np.uint8)[::-1, ::-1],
    "colour frame": lambda _: np.zeros((HEIGHT, WIDTH, 3), np.uint8),
    "float colour": lambda _: np.zeros((HEIGHT, WIDTH, 3), np.float32),
    "flow": lambda _: np.ones((HEIGHT, WIDTH, 2), np.float32),
    "flow of nan": lambda _: np.full((HEIGHT, WIDTH, 2), np.nan, np.float32),
    "flow of inf": lambda _: np.full((HEIGHT, WIDTH, 2), np.inf, np.float32),
    "huge flow": lambda _: np.full((HEIGHT, WIDTH, 2), 1e38, np.float32),
    "small flow": lambda _: np.ones((3, 4, 2), np.float32),
    "masked frame": lambda _: np.ma.masked_greater(_frame(np.uint8), 100),
    "subclass": lambda _: _frame(np.uint8).view(Subclassed),
    "object frame": lambda _: _frame(object),
    "objects": lambda _: _objects(None, object()),
    "texts": lambda _: np.array(["a", "b"]),
    "complex array": lambda _: np.zeros((HEIGHT, WIDTH), complex),
    "dates": lambda _: np.zeros((2, 2), "datetime64[s]"),
    "records": lambda _: np.zeros(3, [("a", "i4")]),
}
