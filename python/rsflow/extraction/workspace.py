"""The folder in which the files of a run grow, hidden in its output folder, and where it waits to be resumed."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._results.folder import read_json
from ..io.atomic import left_by_the_dead, of_elsewhere, working_name
from . import checkpoint

if TYPE_CHECKING:
    from .._results.folder import Identity

__all__ = ["PARKED", "Grown", "Workspace", "identities", "parked", "remove_killed", "unfinished"]

# Where an interrupted run waits to be resumed.
PARKED = "resume.partial.d"
_IDENTITY = "identity.json"
_LOCK = "lock"


class Workspace:
    """A hidden folder of this run alone, in the folder of the results.

    Parameters
    ----------
    folder : Path
        Of the results; it exists.
    identity : Identity
        What the run is of; whoever finds its files without a summary, since it was killed, can read it here.
    adopted : Path, optional
        The workspace of a run that ended early, to go on in.
    """

    def __init__(self, folder: Path, identity: Identity, adopted: Path | None = None) -> None:
        self.folder = folder
        self._lock: int | None = None
        self.path = working_name(folder / "run")
        if adopted is None:
            self.path.mkdir()
            try:
                (self.path / _IDENTITY).write_text(json.dumps(identity.as_dict()), encoding="utf-8")
            except BaseException:
                self.remove()
                raise
        else:
            # In one step: of two that would go on with a run, one does. Until it is locked again nobody takes it.
            (adopted / _LOCK).unlink(missing_ok=True)
            adopted.rename(self.path)
        self._lock = _locked(self.path / _LOCK)

    @property
    def checkpoint(self) -> Path:
        """Where the checkpoint is."""
        return self.path / checkpoint.NAME

    def park(self) -> None:
        """Leave the run to be resumed; if it has no checkpoint, remove it."""
        if not self.checkpoint.exists():
            self.remove()
            return
        self._unlock()
        parked = self.folder / PARKED
        shutil.rmtree(parked, ignore_errors=True)
        with contextlib.suppress(OSError):
            self.path.rename(parked)

    def remove(self) -> None:
        """Remove it with all that is in it; harmless when repeated."""
        # First, or what is left of the rest would be taken for a run to go on with.
        with contextlib.suppress(OSError):
            self.checkpoint.unlink(missing_ok=True)
        self._unlock()
        shutil.rmtree(self.path, ignore_errors=True)

    def _unlock(self) -> None:
        lock, self._lock = self._lock, None
        if lock is not None:
            os.close(lock)


@contextlib.contextmanager
def parked(folder: Path) -> Iterator[Path]:
    """Give an empty folder to put a run together in, which then waits in `folder` to be resumed."""
    place = working_name(folder / "run")
    place.mkdir()
    try:
        yield place
        shutil.rmtree(folder / PARKED, ignore_errors=True)
        place.rename(folder / PARKED)
    except BaseException:
        shutil.rmtree(place, ignore_errors=True)
        raise


def unfinished(folder: Path) -> Iterator[Path]:
    """Give the workspaces in `folder` that have a checkpoint and that no living process works in."""
    return (path for path in _left(folder) if (path / checkpoint.NAME).is_file())


def identities(folder: Path) -> Iterator[dict[str, Any]]:
    """Give what the runs were of that left a workspace in `folder`."""
    return (read_json(path / _IDENTITY) for path in _left(folder))


def remove_killed(folder: Path) -> None:
    """Remove what killed runs left in `folder`."""
    for path in _left(folder):
        if path.name != PARKED:
            shutil.rmtree(path, ignore_errors=True)


def _left(folder: Path) -> Iterator[Path]:
    with contextlib.suppress(OSError):
        for path in sorted(folder.iterdir()):
            killed = left_by_the_dead(path.name) or (of_elsewhere(path.name) and _unlocked(path / _LOCK))
            if (killed or path.name == PARKED) and path.is_dir() and not path.is_symlink():
                yield path


def _locked(path: Path) -> int | None:
    """Lock a new file at `path` until this process ends: it tells those on other machines that it runs."""
    try:
        import fcntl
    except ImportError:
        return None
    # It gets its name when it is locked.
    early = working_name(path)
    descriptor = os.open(early, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        early.replace(path)
    except OSError:
        os.close(descriptor)
        with contextlib.suppress(OSError):
            early.unlink()
            # One of another process would say that this one is dead.
            path.unlink(missing_ok=True)
        return None
    return descriptor


def _unlocked(path: Path) -> bool:
    """Whether nobody holds the lock at `path`; False where that cannot be known."""
    try:
        import fcntl

        descriptor = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
    except (ImportError, OSError):
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


class Grown:
    """A file in a workspace, to get its final name or to be given beside as partial."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def keep(self, final: Path) -> Path:
        """Give it its final name."""
        self.path.replace(final)
        return final

    def copy(self, final: Path) -> Path:
        """Give it under another name too, without its bytes where the file system can."""
        target = working_name(final)
        try:
            os.link(self.path, target)
        except OSError:
            with self.path.open("rb") as file, target.open("xb") as copy:
                shutil.copyfileobj(file, copy)
        target.replace(final)
        # Where `final` was this very file already, nothing was renamed.
        target.unlink(missing_ok=True)
        return final

    def part(self) -> None:
        """Make it a file of its own, where `copy` gave it another name: that one must not change with it."""
        if self.path.stat().st_nlink > 1:
            target = working_name(self.path)
            shutil.copyfile(self.path, target)
            target.replace(self.path)
