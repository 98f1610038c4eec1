"""Which files a pattern stands for, and which of them are pictures."""

from __future__ import annotations

import glob
import re
from pathlib import Path

__all__ = ["PICTURES", "matches", "natural_key"]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".webp", ".jp2", ".exr", ".hdr")


_NUMBERED = re.compile(r"%0?\d*d")


def natural_key(path: Path) -> tuple[tuple[int, int | str], ...]:
    """Sort key that puts img2 before img10."""
    parts = re.split(r"(\d+)", path.name)
    return tuple((0, int(part)) if part.isdigit() else (1, part.casefold()) for part in parts if part)


def matches(pattern: str) -> list[Path] | None:
    """Files that match a glob or a numbered pattern, in natural order; None where `pattern` is neither."""
    numbered = _NUMBERED.search(pattern)
    if numbered:
        head, tail = pattern[: numbered.start()], pattern[numbered.end() :]
        names = glob.glob(glob.escape(head) + "*" + glob.escape(tail))  # noqa: PTH207
        names = [name for name in names if name[len(head) : len(name) - len(tail)].isdigit()]
    elif glob.has_magic(pattern):
        names = glob.glob(pattern, recursive=True)  # noqa: PTH207
    else:
        return None
    return sorted((Path(name) for name in names if Path(name).is_file()), key=natural_key)
