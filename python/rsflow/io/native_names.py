"""Names of files as libraries take them that know UTF-8 alone: OpenCV's videos end the process at any other."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

__all__ = ["is_text", "native_name"]


def is_text(name: str) -> bool:
    """Whether a name can be said in UTF-8: names of the file system are bytes, and some are no text."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


@contextlib.contextmanager
def native_name(path: str | os.PathLike[str]) -> Iterator[str]:
    """Give a name in UTF-8 of a file, to read or to write: its own, or that of a link which ends with the context.

    Raises
    ------
    OSError
        If no link can be made.
    """
    name = os.fspath(path)
    if is_text(name):
        yield name
        return
    # The suffix stays: it says the format.
    suffix = Path(name).suffix
    with tempfile.TemporaryDirectory(prefix="rsflow-") as folder:
        link = Path(folder, f"video{suffix if is_text(suffix) else ''}")
        try:
            link.symlink_to(Path(name).absolute())
        except ValueError as error:
            raise OSError(str(error)) from None
        yield str(link)
