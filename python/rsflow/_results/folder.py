"""Folders of results: what stands there is replaced by the same command alone, unless the user says so."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import stat
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ..errors import OptionError, RsflowError
from ..io.atomic import writing
from ..io.limits import kind_of, read_text
from . import identity as _identity

__all__ = ["Identity", "ResultFolder", "expect_own", "expect_plain", "made_folder", "read_json"]

# What is known of the results in a folder, by command; `rsflow extract` has it in its summary.json.
MANIFEST = ".rsflow.json"
# In it: files of an earlier run that stand beside those of the recorded one until that one is complete.
_EARLIER = "earlier"
_JSON_BYTES = 1 << 24


@dataclass(frozen=True)
class Identity:
    """Check sums of what a result is of; `source` is None where another run cannot be known to see the same."""

    source: str | None
    settings: str

    @classmethod
    def of(cls, source: Any, settings: Mapping[str, Any], *, files: Iterable[str] = ()) -> Identity:
        """Sum up a source and options by name; those named in `files` are paths whose content counts."""
        return cls(_identity.of_source(source), _identity.of_settings(settings, files=files))

    def as_dict(self) -> dict[str, str | None]:
        """Give what is kept with a result."""
        return {"source": self.source, "settings": self.settings}

    def difference(self, recorded: Any) -> str:
        """Say in what a result that is there differs; nothing where it is of the same source and settings."""
        if not (isinstance(recorded, dict) and {"source", "settings"} <= recorded.keys()):
            return "a result of which nothing is known"
        if self.source is None or recorded["source"] is None:
            return "a result, and its source cannot be known to be the same (a camera, a stream, an iterable)"
        if self.source != recorded["source"]:
            return "the result of another source"
        return "" if self.settings == recorded["settings"] else "the result of other settings"


def expect_own(folder: Path, existing: Sequence[Path], difference: str, *, detail: str = "") -> None:
    """Raise OptionError where `existing` files are of another run; `difference` says of which."""
    if not existing or not difference:
        return
    names = ", ".join(str(path.relative_to(folder)) for path in existing[:3]) + (", ..." if len(existing) > 3 else "")
    raise OptionError(
        f"{folder} holds {difference} ({names}{detail}): write to another folder, or replace it with --overwrite "
        "(in Python overwrite=True)"
    )


def expect_plain(paths: Iterable[Path]) -> None:
    """Raise OptionError where one of `paths` is a pipe, a device or a socket: a folder holds files of its own."""
    for path in paths:
        try:
            mode = path.stat().st_mode
        except (OSError, ValueError):
            continue
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise OptionError(f"{path}: got {kind_of(mode)}, expected a regular file or none: remove it")


def made_folder(folder: Path) -> list[Path]:
    """Make a folder that results are written into, before they are measured; give those that were missing.

    Raises
    ------
    OptionError
        If it is a file.
    OSError
        If it cannot be made, or nothing can be written into it.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OptionError(f"out: {folder}: got a file, or a link that leads nowhere, expected a folder") from None
    except OSError as error:
        raise type(error)(error.errno, f"cannot make the folder {folder}: {error.strerror}") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, f"cannot write into the folder {folder}: {os.strerror(errno.EACCES)}")
    return missing


class ResultFolder:
    """A folder that a command writes its files into, with a record of what they are of.

    As a context manager it makes the folder, and takes both back where the command failed before there was a file.

    Parameters
    ----------
    folder : path
    command : str
        Whose files these are.
    names : iterable of str
        Names or patterns below the folder, of all files that the command may write.
    identity : Identity
        What they will be of.
    overwrite : bool
        Replace the files of another run too. Those of its files that this one does not write are removed by `finish`.

    Raises
    ------
    OptionError
        If there are files of another run, or a pipe or device where a file belongs; nothing is written then.
    """

    def __init__(
        self, folder: Path, command: str, names: Iterable[str], identity: Identity, *, overwrite: bool = False
    ) -> None:
        self.folder, self._command, self._identity = folder, command, identity
        self._names = list(names)
        found = self._existing()
        expect_plain([folder / MANIFEST, *found])
        recorded = _manifest(folder).get(command)
        difference = identity.difference(recorded)
        if not overwrite:
            expect_own(folder, found, difference)
        # What an unknown run left may be anyone's.
        self._stale: list[Path] = []
        if isinstance(recorded, dict):
            left = recorded.get(_EARLIER)
            earlier = {str(name) for name in left} if isinstance(left, list) else set()
            self._stale = [path for path in found if difference or self._name(path) in earlier]
        self._recorded = False
        self._made: list[Path] = []

    def _existing(self) -> list[Path]:
        return sorted(path for name in self._names for path in self.folder.glob(name))

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()

    def record(self) -> None:
        """Write down whose the files are; to be called before the first of them gets its name."""
        if self._recorded:
            return
        self._recorded = True
        self._write(self._stale)

    def _write(self, earlier: Iterable[Path]) -> None:
        entry: dict[str, Any] = dict(self._identity.as_dict())
        names = [self._name(path) for path in earlier]
        if names:
            # The run may never complete: the next one must know whose these are.
            entry[_EARLIER] = names
        manifest = _manifest(self.folder) | {self._command: entry}
        with writing(self.folder / MANIFEST) as partial:
            partial.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")

    def finish(self, written: Iterable[Path]) -> None:
        """Remove the files of another run that were not replaced."""
        kept = {os.path.realpath(path) for path in written}
        for path in self._stale:
            if os.path.realpath(path) not in kept:
                with contextlib.suppress(OSError):
                    path.unlink()
        if self._recorded and self._stale:
            self._write([])

    def __enter__(self) -> Self:
        self._made = made_folder(self.folder)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None or self._existing():
            return
        with contextlib.suppress(OSError):
            if self._recorded:
                self._take_back()
            for folder in self._made:
                folder.rmdir()

    def _take_back(self) -> None:
        manifest = _manifest(self.folder)
        manifest.pop(self._command, None)
        path = self.folder / MANIFEST
        if manifest:
            with writing(path) as partial:
                partial.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
        else:
            path.unlink()


def _manifest(folder: Path) -> dict[str, Any]:
    return read_json(folder / MANIFEST)


def read_json(path: Path) -> dict[str, Any]:
    """Give the object in a small JSON file of ours; an empty one where it is missing or is not one."""
    try:
        found = json.loads(read_text(path, most=_JSON_BYTES))
    except (OSError, ValueError, RecursionError, RsflowError):
        return {}
    return found if isinstance(found, dict) else {}
