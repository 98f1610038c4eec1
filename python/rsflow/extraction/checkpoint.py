"""The file from which a run goes on: numbers and arrays with a check sum, and nothing that could be run."""

from __future__ import annotations

import contextlib
import json
import os
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import __version__
from ..errors import FormatError, RsflowError
from ..io.atomic import writing
from .state import decode, encode

__all__ = ["NAME", "CheckpointError", "Draft", "Saved", "Schedule", "restoring", "versions"]

NAME = "checkpoint.npz"
_FORMAT = "rsflow checkpoint 2"

# A checkpoint is written after so many seconds, but the writing takes no more than this share of the time, and long
# runs have no more than some hundreds: each is a piece of every video.
_EVERY_S = 5.0
_SHARE = 0.01
_GROWTH = 0.02


class Schedule:
    """When the next checkpoint is due."""

    def __init__(self, *, never: bool = False) -> None:
        self._never = never
        self._begin = self._last = time.monotonic()
        self._took = 0.0

    def due(self) -> bool:
        """Whether it is time for one; the next is counted from here."""
        now = time.monotonic()
        if self._never or now - self._last < max(_EVERY_S, self._took / _SHARE, _GROWTH * (now - self._begin)):
            return False
        self._last = now
        return True

    def took(self, seconds: float) -> None:
        """Say how long the last one took."""
        self._took = seconds


def versions() -> dict[str, str]:
    """Give what must be the same for the rest of a run to be as if it had not been interrupted."""
    import cv2

    return {"rsflow": __version__, "OpenCV": cv2.__version__, "numpy": np.__version__}


class Draft:
    """A checkpoint that is put together: what is added is copied at once."""

    def __init__(self) -> None:
        self._tree: dict[str, Any] = {}
        self._arrays: list[NDArray[Any]] = []

    @classmethod
    def of(cls, saved: Saved) -> Draft:
        """Begin with all that is in another one."""
        draft = cls()
        draft._tree, draft._arrays = dict(saved._tree), list(saved._arrays)
        return draft

    def add(self, name: str, value: Any) -> None:
        """Take in a value under a name; it takes the place of one of that name."""
        self._tree[name] = encode(value, self._arrays)

    def write(self, path: Path) -> None:
        """Write it in one step; it is on the disk when this returns."""
        text = json.dumps({"format": _FORMAT, "content": self._tree}).encode()
        arrays = {f"a{number}": array for number, array in enumerate(self._arrays)}
        with writing(path) as partial, partial.open("wb") as file:
            np.savez(file, allow_pickle=False, text=np.frombuffer(text, np.uint8), **arrays)
        if os.name == "posix":
            # The name too, with those of the parts that it tells of.
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


class Saved:
    """A checkpoint that was read.

    Parameters
    ----------
    folder : Path
        The workspace of the run.

    Raises
    ------
    FormatError
        If there is none, it is damaged, or it is something else.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / NAME
        try:
            with zipfile.ZipFile(self.path) as archive:
                # It is written without packing: one that would grow is none of ours.
                if sum(info.file_size for info in archive.infolist()) > self.path.stat().st_size:
                    raise ValueError("it is packed")
            with np.load(self.path, allow_pickle=False) as found:
                text = json.loads(found["text"].tobytes())
                if not isinstance(text, dict) or text.get("format") != _FORMAT:
                    raise ValueError("it is of another format")
                self._arrays = [found[f"a{number}"] for number in range(len(found.files) - 1)]
                self._tree: dict[str, Any] = dict(text["content"])
            self.frame = int(self._tree["frame"])
        except _DAMAGED as error:
            raise _damaged(self.path, error) from None

    def value(self, name: str, *, make: Mapping[str, Callable[[], Any]] | None = None) -> Any:
        """Give what was added under a name; `make` is that of `state.decode`."""
        return decode(self._tree[name], self._arrays, make=make)


# What reading bytes that mean nothing may raise.
_DAMAGED = (
    OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, EOFError, RecursionError, OverflowError,
    MemoryError, NotImplementedError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


class CheckpointError(FormatError):
    """A checkpoint that cannot be gone on from."""


def _damaged(path: Path, error: BaseException) -> CheckpointError:
    reason = " ".join(str(error).split()) or type(error).__name__
    return CheckpointError(f"{path}: a run cannot be resumed from it: {reason}; begin anew with --overwrite")


@contextlib.contextmanager
def restoring(saved: Saved | None) -> Iterator[None]:
    """Say of any fault in what was saved where it is."""
    try:
        yield
    except RsflowError:
        raise
    except _DAMAGED as error:
        if saved is None:
            raise
        raise _damaged(saved.path, error) from error
