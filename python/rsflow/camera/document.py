"""A parsed document whose values are taken out with checks: each message names file, key, got and expected."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError


class Document:
    """A mapping read from a file, and where in the file it stands."""

    def __init__(self, path: str, content: Any, prefix: str = "") -> None:
        self.path = path
        self._prefix = prefix
        if not isinstance(content, dict):
            where = f"{prefix.rstrip('.')}: " if prefix else ""
            raise FormatError(f"{path}: {where}got {_brief(content)}, expected keys with values")
        self._content = {str(key): value for key, value in content.items()}

    def value(self, key: str) -> Any:
        """Give the value as it was read, or None."""
        return self._content.get(key)

    def names(self) -> list[str]:
        """Give the keys."""
        return list(self._content)

    def first(self, *keys: str) -> str | None:
        """Give the first of the keys that is present."""
        return next((key for key in keys if self._content.get(key) is not None), None)

    def at(self, key: str) -> Document:
        """Give the mapping under a key."""
        return Document(self.path, self._content.get(key), f"{self._prefix}{key}.")

    def names_of_maps_with(self, key: str) -> list[str]:
        """Give the keys whose value is a mapping that holds `key`."""
        return [name for name, value in self._content.items() if isinstance(value, dict) and key in value]

    def keys_text(self) -> str:
        """Give some keys for a message."""
        names = list(self._content)
        return ", ".join(name[:40] for name in names[:8]) + (", ..." if len(names) > 8 else "") if names else "(none)"

    def error(self, key: str, got: Any, expected: str) -> FormatError:
        """Make the error for a key."""
        return FormatError(f"{self.path}: {self._prefix}{key}: got {_brief(got)}, expected {expected}")

    def _present(self, key: str, expected: str) -> Any:
        if self._content.get(key) is None:
            raise FormatError(f"{self.path}: {self._prefix}{key}: the key is missing, expected {expected}")
        return self._content[key]

    def number(self, key: str) -> float:
        """Give a finite number."""
        value = self._present(key, "a finite number")
        if not _is_number(value):
            raise self.error(key, value, "a finite number")
        return float(value)

    def integer(self, key: str) -> int:
        """Give a whole number."""
        return self.whole(key, self._present(key, "a whole number"))

    def whole(self, key: str, value: Any) -> int:
        """Check that a value is a whole number."""
        if not _is_number(value) or float(value) != int(value):
            raise self.error(key, value, "a whole number")
        return int(value)

    def word(self, key: str, allowed: tuple[str, ...]) -> Any:
        """Give one of the words allowed."""
        value = self._present(key, f"one of {', '.join(filter(None, allowed))}")
        if value not in allowed:
            raise self.error(key, value, f"one of {', '.join(filter(None, allowed))}")
        return value

    def numbers(self, key: str, lengths: tuple[int, ...] | None = None) -> tuple[float, ...]:
        """Give a flat list of finite numbers: a list, or a matrix with `data`."""
        expected = "a list of finite numbers"
        if lengths is not None:
            expected = f"a list of {' or '.join(map(str, lengths))} finite numbers"
        value = self._present(key, expected)
        rows = cols = None
        if isinstance(value, dict):
            rows, cols = value.get("rows"), value.get("cols")
            value = value.get("data")
        if isinstance(value, np.ndarray):
            value = value.ravel().tolist()
        if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
            value = [item for row in value for item in row]
        if not isinstance(value, list) or len(value) > 100_000 or not all(_is_number(item) for item in value):
            raise self.error(key, value, expected)
        if lengths is not None and len(value) not in lengths:
            raise self.error(key, f"{len(value)} numbers", expected)
        if isinstance(rows, int) and isinstance(cols, int) and rows * cols != len(value):
            raise self.error(key, f"{len(value)} numbers", f"{rows} x {cols} as its rows and cols say")
        return tuple(float(item) for item in value)

    def matrix(self, key: str) -> NDArray[np.float64]:
        """Give a 3 x 3 matrix."""
        return np.array(self.numbers(key, (9,))).reshape(3, 3)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _brief(value: Any) -> str:
    text = value if isinstance(value, str) and value[:1].isdigit() and value.endswith(" numbers") else repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
