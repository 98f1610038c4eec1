"""Which source and which settings a result is of: check sums that are kept with it."""

from __future__ import annotations

import hashlib
import os
import stat
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .inputs import source_files

__all__ = ["of_file", "of_settings", "of_source"]

# Of a large file its size and samples are taken: both ends, where containers have their tables, and places between.
_SAMPLE = 1 << 16
_SAMPLES = 64


def of_source(source: Any) -> str | None:
    """Give a check sum of a source of `rsflow.frames`; None where two runs cannot be known to see the same.

    Videos count by what is in them, pictures by name, size and time of change, arrays by their pixels. A camera, a
    stream or an iterable shows something else each time.
    """
    if isinstance(source, np.ndarray):
        return _sum(["array", *_array(source)])
    if isinstance(source, (list, tuple)):
        parts: list[str] = ["list"]
        for item in source:
            part = _item(item)
            if part is None:
                return None
            parts += part
        return _sum(parts)
    if not isinstance(source, (str, os.PathLike)):
        return None
    text = os.fspath(source)
    files = sorted(source_files(source))
    try:
        if len(files) == 1 and Path(text).is_file():
            return of_file(files[0])
        if files:
            return _sum(["pictures", *(part for path in files for part in _picture(path))])
    except OSError:
        return None
    return _sum(["url", text]) if "://" in text and text.split("://")[0] in ("http", "https") else None


def of_file(path: Path) -> str | None:
    """Give a check sum of a regular file by its size and samples of its bytes; None where it is not one."""
    digest = hashlib.blake2b(digest_size=16)
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                return None
            digest.update(b"file %d" % status.st_size)
            last = max(0, status.st_size - _SAMPLE)
            for place in sorted({last * step // _SAMPLES for step in range(_SAMPLES + 1)}):
                file.seek(place)
                digest.update(file.read(_SAMPLE))
    except OSError:
        return None
    return digest.hexdigest()


def of_settings(settings: Mapping[str, Any], *, files: Iterable[str] = ()) -> str:
    """Give a check sum of options by name; those named in `files` count by what is in the file, if they are a path."""
    parts = []
    for name in sorted(settings):
        value = settings[name]
        if name in files and isinstance(value, (str, os.PathLike)):
            value = of_file(Path(value)) or os.fspath(value)
        if isinstance(value, np.ndarray):
            value = _array(value)
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and value.is_integer():
            # 30 and 30.0 mean the same.
            value = int(value)
        if isinstance(value, (list, tuple)):
            value = tuple(value)
        parts += [name, repr(value)]
    return _sum(parts)


def _item(item: Any) -> list[str] | None:
    """Parts of the check sum that one frame of a list gives; None for what is none."""
    if isinstance(item, np.ndarray):
        return _array(item)
    if isinstance(item, (str, os.PathLike)):
        try:
            return _picture(Path(item))
        except OSError:
            return None
    if isinstance(item, tuple) and len(item) == 2:
        part = _item(item[0])
        return None if part is None else [*part, repr(item[1])]
    image, t_s = getattr(item, "image", None), getattr(item, "t_s", None)
    if isinstance(image, np.ndarray):
        color = getattr(item, "color", None)
        return [*_array(image if color is None else color), repr(t_s)]
    return None


def _array(array: Any) -> list[str]:
    plain = np.ascontiguousarray(array)
    return [str(plain.shape), plain.dtype.str, f"{zlib.crc32(plain.view(np.uint8).data if plain.size else b''):x}"]


def _picture(path: Path) -> list[str]:
    status = path.stat()
    return [path.name, str(status.st_size), str(status.st_mtime_ns)]


def _sum(parts: Iterable[str]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(f"{len(part)}:{part}".encode(errors="surrogateescape"))
    return digest.hexdigest()
