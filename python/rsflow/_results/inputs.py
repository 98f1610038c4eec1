"""What a call reads, by identity: nothing may be written over it, nor where its source would find it as a frame."""

from __future__ import annotations

import fnmatch
import glob
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..errors import OptionError
from ..io.picture_names import PICTURES, matches

__all__ = ["Inputs", "expect_apart"]


class Inputs:
    """The files that a call reads: those of its source, and others beside it.

    Parameters
    ----------
    source : source of `rsflow.frames`, optional
        Only files are looked at: a camera or an array cannot be written over. No picture may be written among its own.
    files : iterable
        Single files: a camera, a table of heights, a mask, one of a pair of pictures; what is no path is passed over.

    Examples
    --------
    >>> import pathlib, rsflow, tempfile
    >>> from rsflow._results.inputs import Inputs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "flow.mp4")
    ...     path.touch()
    ...     try:
    ...         Inputs(path).refuse([path])
    ...     except rsflow.OptionError as error:
    ...         print(str(error).replace(folder, "folder"))
    cannot write folder/flow.mp4: it is folder/flow.mp4, which is read; write to another folder or name
    """

    def __init__(self, source: Any = None, *, files: Iterable[Any] = ()) -> None:
        self._source = source
        self._files = [Path(file) for file in files if isinstance(file, (str, os.PathLike))]
        self._known: dict[tuple[int, int], Path] | None = None
        self._pictures: set[Path] | None = None

    def refuse(self, outputs: Iterable[str | os.PathLike[str]]) -> None:
        """Raise OptionError where one of `outputs` is read, or would be read as a frame the next time.

        The same file is known by its identity: under another name, a link of either kind, upper or lower case.
        """
        for output in map(Path, outputs):
            read = self._same(output)
            if read is not None:
                raise OptionError(
                    f"cannot write {output}: it is {read}, which is read; write to another folder or name"
                )
            if self._reaches(output):
                raise OptionError(
                    f"cannot write {output} beside the pictures of {self._name()}: it would be read as a frame the "
                    f"next time; write to another folder, {output.parent / 'motion'} say"
                )

    def _name(self) -> str:
        return str(self._source) if isinstance(self._source, (str, os.PathLike)) else "the source"

    def _same(self, output: Path) -> Path | None:
        key = _identity(output)
        if key is None:
            return None
        if self._known is None:
            # Looked up only where there is something to compare it with: folders may hold many pictures.
            found = ((_identity(path), path) for path in (*source_files(self._source), *self._files))
            self._known = {known: path for known, path in found if known is not None}
        return self._known.get(key)

    def _reaches(self, output: Path) -> bool:
        """Whether `output` is a picture among those of the source, or where a pattern finds it."""
        if output.suffix.lower() not in PICTURES:
            return False
        if _real(output.parent) in self._folders():
            return True
        if not isinstance(self._source, (str, os.PathLike)):
            return False
        text = os.fspath(self._source)
        if "://" in text or Path(text).exists() or not glob.has_magic(text):
            return False
        parts = Path(os.path.abspath(text)).parts  # noqa: PTH100 - `resolve` would follow what is no name
        plain = next(index for index, part in enumerate(parts) if glob.has_magic(part))
        head, below = _real(Path(*parts[:plain])), _real(output.parent) / output.name
        return below.is_relative_to(head) and _matches(below.relative_to(head).parts, parts[plain:])

    def _folders(self) -> set[Path]:
        """Folders of the source's pictures; those of a single picture and of a video do not count."""
        if self._pictures is None:
            single = isinstance(self._source, (str, os.PathLike)) and Path(self._source).is_file()
            files = () if single else source_files(self._source)
            self._pictures = {_real(folder) for folder in {p.parent for p in files if p.suffix.lower() in PICTURES}}
        return self._pictures


def expect_apart(outputs: Mapping[str, str | os.PathLike[str] | None]) -> None:
    """Raise OptionError where two outputs of a call, by the name of their option, are one file or folder."""
    seen: dict[Any, tuple[str, Path]] = {}
    for option, given in outputs.items():
        if given is None:
            continue
        path = Path(given)
        for key in (_real(path), _real(path.parent) / path.name, _identity(path)):
            before = seen.setdefault(key, (option, path)) if key is not None else (option, path)
            if before[0] != option:
                raise OptionError(
                    f"{option} {path}: it is what {before[0]} {before[1]} writes to; give each output a name of its own"
                )


def source_files(source: Any) -> Iterator[Path]:
    """Give the files that a source of `rsflow.frames` reads, without opening one."""
    if isinstance(source, tuple) and len(source) == 2 and isinstance(source[0], (str, os.PathLike)):
        # A pair of a path and its time, unless it is a list of two paths.
        yield from source_files(source[0])
        if isinstance(source[1], (str, os.PathLike)):
            yield from source_files(source[1])
    elif isinstance(source, (list, tuple)):
        for item in source:
            if isinstance(item, (str, os.PathLike, tuple)):
                yield from source_files(item)
    elif isinstance(source, (str, os.PathLike)):
        text = os.fspath(source)
        if text.startswith("file:"):
            from urllib.parse import unquote, urlsplit

            text = unquote(urlsplit(text).path)
        path = Path(text)
        if "://" in text or not text:
            return
        if path.is_dir():
            yield from (item for item in path.iterdir() if item.suffix.lower() in PICTURES)
        elif path.exists():
            yield path
        else:
            yield from matches(text) or ()


def _identity(path: Path) -> tuple[int, int] | None:
    """Device and number of a regular file, whatever it is called; None where there is none."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return (status.st_dev, status.st_ino) if stat.S_ISREG(status.st_mode) else None


def _real(path: Path) -> Path:
    return Path(os.path.realpath(path))


def _matches(parts: tuple[str, ...], pattern: tuple[str, ...]) -> bool:
    """Whether a path below a folder matches a glob's parts; ``**`` stands for any number of folders."""
    if not pattern:
        return not parts
    if pattern[0] == "**":
        return any(_matches(parts[skipped:], pattern[1:]) for skipped in range(len(parts) + 1))
    return bool(parts) and fnmatch.fnmatch(parts[0], pattern[0]) and _matches(parts[1:], pattern[1:])
