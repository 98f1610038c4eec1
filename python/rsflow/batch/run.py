"""The main job over many sources, on a pool of processes or any other executor."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import _checks
from .._core import set_num_threads
from .._display import fields
from .._results.status import WordStatus
from ..errors import OptionError, RsflowError

if TYPE_CHECKING:
    from ..extraction import ExtractSettings
    from .stop import StopWish

# Options of `rsflow.extract` that do not change what it measures.
_NO_SETTINGS = ("progress", "overwrite", "resume", "on_frame")

# How long a signal waits to be seen, in seconds.
_LOOK_S = 0.1

__all__ = ["BatchItem", "BatchStatus", "extract_many", "folder_names"]


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
    folder : Path
        The folder of its results.
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
    folder: Path
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


def _given(sources: Iterable[str | int | os.PathLike[str]]) -> list[str | int]:
    """Take a list of sources, each a camera's number or a path."""
    expected = "a list of paths and of cameras' numbers"
    found: list[str | int] = []
    for source in _checks.iterable("sources", sources, expected):
        number = _checks.whole(source)
        found.append(str(_checks.path("sources", source, "paths and cameras' numbers")) if number is None else number)
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
    taken: set[str] = set()
    names: list[str] = []
    for source in _given(sources):
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


def _extract_one(source: str | int, folder: str, threads: int | None, options: dict[str, Any]) -> BatchItem:
    """Run one extraction in a worker; every expected failure becomes an item, so that it cannot stop the others."""
    from ..extraction import ExtractionInterrupted, PartialExtractionError, extract
    from .stop import stoppable

    if threads is not None:
        set_num_threads(threads)
    begun = False
    try:
        with stoppable():
            begun = True
            done = extract(source, folder, **options)
        return BatchItem(source, Path(folder), BatchStatus.DONE, "", done.summary)
    except (PartialExtractionError, ExtractionInterrupted) as stop:
        return BatchItem(source, Path(folder), BatchStatus.PARTIAL, _one_line(stop), stop.extraction.summary)
    except KeyboardInterrupt:
        return (
            BatchItem(source, Path(folder), BatchStatus.FAILED, "interrupted", {})
            if begun
            else _cancelled(source, folder)
        )
    except (RsflowError, OSError, MemoryError) as error:
        return BatchItem(source, Path(folder), BatchStatus.FAILED, _one_line(error) or type(error).__name__, {})
    except Exception as error:
        return BatchItem(source, Path(folder), BatchStatus.FAILED, f"{type(error).__name__}: {_one_line(error)}", {})


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def extract_many(
    sources: Iterable[str | int | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    jobs: int | None = None,
    executor: Executor | None = None,
    on_done: Callable[[BatchItem], None] | None = None,
    **options: Any,
) -> list[BatchItem]:
    """Extract from many sources at once; one that fails does not stop the others.

    Parameters
    ----------
    sources : iterable of str, path or int
        Sources as for `rsflow.extract`.
    out : path
        Each source gets a folder of its own in this one, named after it (see `folder_names`).
    jobs : int, optional
        Processes; by default one for every processor, at most one a source. Each uses its share of the processors.
    executor : concurrent.futures.Executor, optional
        Where to run instead, for instance ``dask.distributed.Client().get_executor()``; it stays open. Sources,
        options and results must then be picklable and `out` reachable from its workers.
    on_done : callable, optional
        Called with each `BatchItem` as it ends.
    **options
        Options of `rsflow.extract`, the same for all.

    Returns
    -------
    list of BatchItem
        In the order of `sources`.

    Raises
    ------
    OptionError
        If there are no sources, an option is outside of what it allows, or a result would be written over a source.

    Notes
    -----
    At Ctrl-C or SIGTERM, whether it reaches this process alone or its workers too, no source is begun any more; those
    at hand end after the frame at hand and keep what is finished, as with `rsflow.extract`, and the second time they
    end at once. The list is then returned as always: its items say what became of each. An `executor` of the caller's
    own is not told, and waited for; the second time is a KeyboardInterrupt.

    Examples
    --------
    >>> import tempfile, numpy as np, rsflow
    >>> from rsflow.batch import extract_many
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     items = extract_many(["missing.mp4"], folder, jobs=1)
    >>> print(items[0].status)
    failed
    """
    from ..extraction import ExtractSettings, extract
    from .stop import StopWish
    from .workers import Workers

    given = _given(sources)
    if not given:
        raise OptionError("sources: got none, expected at least one")
    out = _checks.path("out", out, "a folder")
    jobs = _checks.integer_or_none("jobs", jobs, least=1)
    if executor is not None:
        _checks.instance("executor", executor, Executor, "a concurrent.futures.Executor")
    if on_done is not None:
        _checks.function("on_done", on_done, 1)
    known = [*inspect.signature(extract).parameters][2:]
    _checks.options("extract_many", options, known)
    settings = ExtractSettings(**{name: value for name, value in options.items() if name not in _NO_SETTINGS})
    settings.validate()
    folders = [str(Path(out) / name) for name in folder_names(given)]
    _expect_apart(given, folders, settings)
    if executor is not None:
        return _collected(executor, given, folders, None, options, on_done, at_once=len(given))
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = min(jobs or processors, len(given))
    # Not fork: the parent may hold threads of OpenCV or of a video library.
    context = get_context("spawn")
    wish = StopWish(context)
    share = max(1, processors // workers)
    with Workers(context, wish.watch) as pool:
        try:
            return _collected(pool, given, folders, share, options, on_done, at_once=workers, wish=wish)
        except BaseException:
            # `on_done` raised: the pool is left as soon as its jobs have ended.
            wish.ask()
            raise


def _expect_apart(sources: Sequence[str | int], folders: Sequence[str], settings: ExtractSettings) -> None:
    """Raise OptionError where a result would be written over a source, or two results into one folder."""
    from .._results.inputs import Inputs
    from ..extraction.claim import input_files, written_names

    taken: dict[str, str] = {}
    for folder in folders:
        real = os.path.realpath(folder)
        if real in taken:
            raise OptionError(
                f"out: got {taken[real]} and {folder}, which are one folder, {real}, expected one for each source"
            )
        taken[real] = folder
    for source in sources:
        if not isinstance(source, int) and Path(source).is_dir() and (real := os.path.realpath(source)) in taken:
            raise OptionError(f"out: got {taken[real]}, the folder of the pictures {source}, expected another one")
    # What is read must outlast the whole batch.
    read = Inputs(list(sources), files=input_files(settings))
    read.refuse(Path(folder) / name for folder in folders for name in written_names(settings))


def _collected(
    executor: Executor,
    sources: Sequence[str | int],
    folders: Sequence[str],
    threads: int | None,
    options: dict[str, Any],
    on_done: Callable[[BatchItem], None] | None,
    *,
    at_once: int,
    wish: StopWish | None = None,
) -> list[BatchItem]:
    """Hand out the sources, `at_once` at a time: what waits in a pool's own queue could not be called back.

    At Ctrl-C or SIGTERM nothing more is begun, and with a `wish` what runs is asked to end and keep what it has; the
    second time, to end at once. The workers of a caller's executor cannot be asked: they end by themselves, and the
    second time is a KeyboardInterrupt.
    """
    from ..extraction.stopping import StopRequest

    items: dict[int, BatchItem] = {}

    def ended(index: int, item: BatchItem) -> None:
        items[index] = item
        if on_done is not None:
            on_done(item)

    waiting = list(range(len(sources)))
    running: dict[Future[BatchItem], int] = {}
    # Signals are counted, so that none comes between taking a result and keeping it.
    with StopRequest(interrupts=False) as stop:
        while waiting or running:
            if stop.requested:
                for future in running:
                    future.cancel()
                for index in waiting:
                    ended(index, _cancelled(sources[index], folders[index]))
                waiting.clear()
                if wish is None and stop.count > 1:
                    raise KeyboardInterrupt
                if wish is not None:
                    wish.ask(stop.count)
            while waiting and len(running) < at_once:
                index = waiting.pop(0)
                job = executor.submit(_extract_one, sources[index], folders[index], threads, options)
                running[job] = index
            finished, _ = wait(running, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
            for future in finished:
                index = running.pop(future)
                ended(index, _item(future, sources[index], folders[index], ours=wish is not None))
    return [items[index] for index in range(len(sources))]


def _cancelled(source: str | int, folder: str) -> BatchItem:
    return BatchItem(source, Path(folder), BatchStatus.CANCELLED, "not begun: the batch was interrupted", {})


def _item(future: Future[BatchItem], source: str | int, folder: str, *, ours: bool) -> BatchItem:
    from ..extraction.tables import discard_working

    if future.cancelled():
        return _cancelled(source, folder)
    error = future.exception()
    if error is not None:
        # The worker itself died: killed, out of memory, or its result could not be sent.
        # In a pool of the caller's others may still be closing their files.
        if ours and isinstance(error, BrokenProcessPool):
            discard_working(Path(folder))
        reason = f"the worker ended: {type(error).__name__}: {_one_line(error)}"
        return BatchItem(source, Path(folder), BatchStatus.FAILED, reason, {})
    return future.result()
