"""Writing files so that nothing partial ever stands under the final name."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a path beside `path` to write to, and rename it to `path` at the end.

    Where the body raises, the partial file is removed, with the folders made for it that are empty, and an older file
    of that name stays as it was.

    Parameters
    ----------
    path : path
        The final name. Its folder is made if it is missing.

    Yields
    ------
    Path
        The temporary path: same folder, same suffix.

    Raises
    ------
    OSError
        If the folder cannot be made or written; the message names the final path.
    """
    final = Path(path)
    partial = final.with_name(f".{final.stem}.partial-{os.getpid()}{final.suffix}")
    missing = [folder for folder in final.parents if not folder.exists()]
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        # What is renamed must be on the disk, or a crash leaves an empty file under the final name.
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(final)
    except BaseException as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
            for folder in missing:
                folder.rmdir()
        if isinstance(error, OSError) and error.errno is not None and type(error).__module__ == "builtins":
            raise type(error)(error.errno, f"cannot write {final}: {os.strerror(error.errno)}") from error
        raise
