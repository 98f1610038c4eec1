"""What became of the sources of a batch, and where the results of each are."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import _checks
from .._display import fields
from .._results.status import WordStatus

__all__ = ["BatchItem", "BatchStatus", "folder_names", "given"]


class BatchStatus(WordStatus):
    """What became of a source of a batch; equal to its word, ``"done"`` say.

    Examples
    --------
    >>> from rsflow.batch import BatchStatus
    >>> status = BatchStatus("partial")
    >>> print(status, status.valid, "--", status.explanation)
    partial False -- it failed or was stopped on its way, and what was finished is kept
    """

    DONE = "done", "Read to its end, with all results."
    PARTIAL = "partial", "It failed or was stopped on its way, and what was finished is kept."
    FAILED = "failed", "It failed, and nothing is kept."
    CANCELLED = "cancelled", "It was never begun."


@dataclass(frozen=True, eq=False)
class BatchItem:
    """What became of one source of a batch.

    Attributes
    ----------
    source : str or int
        The source as it was given.
    folder : Path or str
        The folder of its results; the URL where that is in storage.
    status : BatchStatus
        ``partial``: it failed or was stopped on its way, and what was finished is kept; ``failed``: nothing is kept;
        ``cancelled``: it was never begun.
    error : str
        Why, in one line; empty when done.
    summary : dict
        Key figures as in ``summary.json``; empty where nothing is kept.

    Examples
    --------
    >>> import tempfile
    >>> from rsflow.batch import extract_many
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     (item,) = extract_many(["missing.mp4"], folder, jobs=1)
    >>> print(item.status, "--", item.error)
    failed -- missing.mp4: no such file or folder
    >>> item.status == "failed", item.folder.name
    (True, 'missing')
    """

    source: str | int
    folder: Path | str
    status: BatchStatus
    error: str
    summary: dict[str, Any]

    __repr__ = fields

    def to_dict(self) -> dict[str, str | int]:
        """Give it as a row, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to str or int
            Source, folder, status, error, and how many frames there are in ``motion.csv``.

        Examples
        --------
        >>> item = BatchItem("a.mp4", Path("out/a"), BatchStatus.DONE, "", {"frames": 120})
        >>> item.to_dict()
        {'source': 'a.mp4', 'folder': 'out/a', 'status': 'done', 'error': '', 'frames': 120}
        """
        frames = int(self.summary.get("frames", 0))
        status = BatchStatus(self.status).word
        return {
            "source": self.source,
            "folder": str(self.folder),
            "status": status,
            "error": self.error,
            "frames": frames,
        }


def given(sources: Iterable[str | int | os.PathLike[str]]) -> list[str | int]:
    """Take a list of sources, each a camera's number or a path."""
    expected = "a list of paths and of cameras' numbers"
    found: list[str | int] = []
    for source in _checks.iterable("sources", sources, expected):
        number = _checks.whole(source)
        if number is None:
            path = _checks.path("sources", source, "paths and cameras' numbers")
            # A URL is no path: two slashes are not one.
            found.append(source if isinstance(source, str) and "://" in source else str(path))
        else:
            found.append(number)
    return found


def folder_names(sources: Sequence[str | int | os.PathLike[str]]) -> list[str]:
    """Give each source a folder name: its own name without suffix, numbered where two would be alike.

    Parameters
    ----------
    sources : sequence of str, path or int
        As for `extract_many`.

    Returns
    -------
    list of str
        All different, also where upper and lower case are not told apart.

    Examples
    --------
    >>> from rsflow.batch import folder_names
    >>> folder_names(["a/clip.mp4", "b/clip.mp4", 0])
    ['clip', 'clip-2', 'camera-0']
    """
    # The overview of all stands beside the folders.
    taken = {"index.html"}
    names: list[str] = []
    for source in given(sources):
        if isinstance(source, int):
            base = f"camera-{source}"
        else:
            last = re.split(r"[\\/]", os.fspath(source).rstrip("\\/"))[-1]
            stem = last.rsplit(".", 1)[0] or last
            base = re.sub(r"[^\w.-]+", "-", stem).strip("-.") or "source"
        name, number = base, 1
        while name.lower() in taken:
            number += 1
            name = f"{base}-{number}"
        taken.add(name.lower())
        names.append(name)
    return names
