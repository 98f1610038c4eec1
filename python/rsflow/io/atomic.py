"""Writing files so that nothing partial ever stands under the final name, whoever else writes there."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .processes import is_alive, is_here, this_process

__all__ = ["Working", "left_by_the_dead", "of_elsewhere", "remove_leftovers", "working_name", "writing"]

# Stem, process (see `this_process`), random part, suffix.
_WORKING = re.compile(r"\..*\.working-(?P<process>\d+-[0-9a-f]+-\d+)-[0-9a-f]{12}(\.[^.]*)?", re.DOTALL)
# Characters of a stem and of a suffix that a working name repeats: with both it stays below what file systems allow.
_STEM, _SUFFIX = 40, 16
_TRIES = 10
# Names of open files, which have no place beside them to write to.
_DESCRIPTOR = re.compile(r"/dev/(?P<name>stdout|stderr)|/(dev|proc/self)/fd/(?P<number>\d+)")

_swept: set[tuple[int, int]] = set()


def working_name(path: Path) -> Path:
    """Give a new name for what is being written for `path`: hidden, in the same folder, never given twice.

    It names the process too, so that `remove_leftovers` knows what a dead one left.
    """
    suffix = path.suffix if len(path.suffix) <= _SUFFIX else ""
    return path.with_name(f".{path.stem[:_STEM]}.working-{this_process()}-{os.urandom(6).hex()}{suffix}")


def remove_leftovers(folder: Path) -> None:
    """Remove the working files in `folder` of processes of this machine that are dead."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if left_by_the_dead(entry.name) and not entry.is_dir(follow_symlinks=False):
                with contextlib.suppress(OSError):
                    # Of a link the link itself.
                    os.unlink(entry.path)  # noqa: PTH108


def left_by_the_dead(name: str) -> bool:
    """Whether `name` is a working name of a process of this machine that does not run any more."""
    found = _WORKING.fullmatch(name)
    return found is not None and not is_alive(found["process"])


def of_elsewhere(name: str) -> bool:
    """Whether `name` is a working name of a process of another machine or container, of which nothing else is known."""
    found = _WORKING.fullmatch(name)
    return found is not None and not is_here(found["process"])


class Working:
    """A file that is written beside its final name.

    What is at the final name stays as it is until `keep` puts the new file there in one step; a symbolic link there is
    replaced, what it points at is not touched. The working file is made anew under a name that nobody can know before,
    with the permissions that the umask gives; a link planted there is not followed. A final name that is no regular
    file (a pipe, a terminal, ``/dev/null``, ``/dev/stdout``) cannot be renamed to: it is written to by `keep`.

    Parameters
    ----------
    path : path
        The final name. Its folder is made if it is missing.

    Attributes
    ----------
    path : Path
        Where to write; of the suffix of the final name.

    Raises
    ------
    OSError
        If the folder cannot be made or written; the message names the final path.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.final = Path(path)
        self._stream = _is_stream(self.final)
        self._made: list[Path] = []
        try:
            if self._stream:
                descriptor, name = tempfile.mkstemp(prefix="rsflow-", suffix=self.final.suffix)
                os.close(descriptor)
                self.path = Path(name)
            else:
                self.path = self._beside()
        except OSError as error:
            self._unmake()
            raise _named(error, self.final) from error

    def _beside(self) -> Path:
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
        folder = self.final.parent
        if self.final.name in ("", "..") or self.final.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(self.final))
        for attempt in range(_TRIES):
            self._made = [path for path in (folder, *folder.parents) if not path.exists()] or self._made
            folder.mkdir(parents=True, exist_ok=True)
            _remove_leftovers_once(folder)
            name = working_name(self.final)
            try:
                os.close(os.open(name, flags, 0o666))
                return name
            except (FileExistsError, FileNotFoundError):
                # The folder may just have been removed again by another writer that failed and had made it.
                if attempt == _TRIES - 1:
                    raise
        raise AssertionError

    def keep(self, final: Path | None = None) -> Path:
        """Put the file at its final name, or at another one in its folder; give that name.

        Raises
        ------
        OSError
            If that fails; the working file is removed then.
        """
        target = self.final if final is None else final
        try:
            if self._stream:
                _copy(self.path, target)
                self.path.unlink()
            else:
                # What is renamed must be on the disk, or a crash leaves an empty file under the final name.
                with self.path.open("rb+") as file:
                    os.fsync(file.fileno())
                self.path.replace(target)
        except BaseException as error:
            self.discard()
            if isinstance(error, OSError):
                raise _named(error, target) from error
            raise
        return target

    def discard(self) -> None:
        """Remove the file, with the folders made for it that are empty; harmless when repeated, or after `keep`."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
        self._unmake()

    def _unmake(self) -> None:
        with contextlib.suppress(OSError):
            for folder in self._made:
                folder.rmdir()


@contextlib.contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a path beside `path` to write to, and rename it to `path` at the end; see `Working`.

    Where the body raises, the partial file is removed, with the folders made for it that are empty, and an older file
    of that name stays as it was. Of several that write one path at once all succeed, and the last one stays.

    Parameters
    ----------
    path : path
        The final name. Its folder is made if it is missing.

    Yields
    ------
    Path
        The temporary path: same suffix, and the same folder unless `path` is a device or a pipe.

    Raises
    ------
    OSError
        If the folder cannot be made or written; the message names the final path.
    """
    file = Working(path)
    try:
        yield file.path
    except BaseException as error:
        file.discard()
        if isinstance(error, OSError):
            raise _named(error, file.final) from error
        raise
    file.keep()


def _named(error: OSError, path: Path) -> OSError:
    """Give an error of the file system that names the final path; an error of ours stays as it is."""
    if error.errno is None or type(error).__module__ != "builtins" or str(error.strerror).startswith("cannot write "):
        return error
    return type(error)(error.errno, f"cannot write {path}: {os.strerror(error.errno)}")


def _is_stream(path: Path) -> bool:
    if _descriptor(path) is not None:
        return True
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _descriptor(path: Path) -> int | None:
    """Give the number of the open file that a name as /dev/stdout means."""
    found = _DESCRIPTOR.fullmatch(os.path.normpath(path)) if os.name == "posix" else None
    if found is None:
        return None
    return int(found["number"]) if found["number"] else {"stdout": 1, "stderr": 2}[found["name"]]


def _copy(source: Path, target: Path) -> None:
    descriptor = _descriptor(target)
    if descriptor is None:
        with source.open("rb") as file, target.open("wb", buffering=0) as stream:
            shutil.copyfileobj(file, stream)
        return
    import sys

    # What was printed before comes first.
    for printed in (sys.stdout, sys.stderr):
        if printed is not None:
            printed.flush()
    # Through the open file itself, which keeps its place where several write to it.
    with source.open("rb") as file, os.fdopen(os.dup(descriptor), "wb") as stream:
        shutil.copyfileobj(file, stream)


def _remove_leftovers_once(folder: Path) -> None:
    """Look through a folder at the first file that this process writes into it."""
    status = folder.stat()
    key = (status.st_dev, status.st_ino)
    if key not in _swept:
        _swept.add(key)
        remove_leftovers(folder)
