"""The main job over many sources, on a pool of processes or any other executor."""

from __future__ import annotations

import inspect
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import _checks
from .._results.folder import made_folder
from ..errors import OptionError
from . import remote
from .assignment import NO_SETTINGS, Assignment
from .course import Course, Step
from .items import BatchItem, folder_names, given
from .processors import processors
from .work import end, one_line

if TYPE_CHECKING:
    from ..extraction import ExtractSettings
    from .stop import StopWish

# How long a signal waits to be seen, in seconds.
_LOOK_S = 0.1

# Frames by which parts overlap, so that what moves is told as in one run: the scene is learned, things are numbered.
OVERLAP = 60

__all__ = ["OVERLAP", "extract_many"]


def extract_many(
    sources: Iterable[str | int | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    jobs: int | None = None,
    executor: Executor | None = None,
    on_done: Callable[[BatchItem], None] | None = None,
    part_frames: int | None = None,
    overlap: int | None = OVERLAP,
    retries: int = 0,
    parquet: bool = False,
    at_once: Callable[[], int] | None = None,
    on_progress: Callable[[float, int], None] | None = None,
    **options: Any,
) -> list[BatchItem]:
    """Extract from many sources at once; one that fails does not stop the others.

    Parameters
    ----------
    sources : iterable of str, path or int
        Sources as for `rsflow.extract`, and URLs of storage that fsspec knows (``s3://bucket/clip.mp4``).
    out : path or URL
        Each source gets a folder of its own in this one, named after it (see `folder_names`). Beside them is
        ``index.html``, a page of the whole: what was not done first, headline figures, links to the reports.
    jobs : int, optional
        Processes; by default one for every processor that this process may use (those it is bound to, within the quota
        of its container), at most one a source or part. Each uses its share of the processors.
    executor : concurrent.futures.Executor, optional
        Where to run instead, for instance ``dask.distributed.Client().get_executor(pure=False)``; it stays open.
        Sources, options and results must then be picklable and `out` reachable from its workers.
    on_done : callable, optional
        Called with each `BatchItem` as it ends.
    part_frames : int, optional
        Cut sources of at least twice as many frames into parts of so many, which are measured at once and joined.
    overlap : int or None
        Frames by which parts overlap, for what moves. None: each part goes on with all that the one before knew, one
        after the other; then every table is that of one run.
    retries : int
        How often a source or part is done again whose process died.
    parquet : bool
        Write each table as Parquet too, with a row group for each part.
    at_once : callable, optional
        How many sources and parts are handed to `executor` at once, asked again and again; by default as many as there
        are sources, and twice as many as processors of this machine where they are cut; 0: none for now.
    on_progress : callable, optional
        Called with how many sources are done, parts of them counted as fractions, and how many there are.
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
    OSError
        If `out` cannot be made or written into; nothing is measured then.

    Notes
    -----
    Without `executor` new processes do the work, which import the script that calls: there the call stands under
    ``if __name__ == "__main__":``.

    Of parts that overlap, the displacement and the dense flow in ``motion.csv``, ``velocity.csv`` and
    ``trajectory.csv`` are those of one run, byte for byte. What moves is told as after `overlap` frames:
    ``objects.csv`` and, in ``motion.csv``, ``moving_share``, ``objects``, ``camera_dx_px``, ``camera_dy_px``,
    ``camera_rotation_rad``, ``camera_scale``, ``camera_model`` and ``segmentation_status`` are those of one run to
    within what a longer memory of the scene makes, and a note in ``summary.json`` says so; things keep their numbers
    where their boxes agree. docs/explanation/scale.md has the rule, and by how much they differed in an hour of video.

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
    from ..extraction.parts import LEAST_FRAMES
    from .stop import StopWish
    from .workers import Workers

    listed = given(sources)
    if not listed:
        raise OptionError("sources: got none, expected at least one")
    if remote.is_remote(out):
        # What cannot be written is told before hours are spent on it.
        remote.storage(str(out))
        if executor is None and str(out).lower().startswith("memory://"):
            raise OptionError(f"out: got {out}, expected a place that outlasts the processes that write to it")
    else:
        out = _checks.path("out", out, "a folder")
    jobs = _checks.integer_or_none("jobs", jobs, least=1)
    if executor is not None:
        _checks.instance("executor", executor, Executor, "a concurrent.futures.Executor")
    for name, function, count in (("on_done", on_done, 1), ("at_once", at_once, 0), ("on_progress", on_progress, 2)):
        if function is not None:
            _checks.function(name, function, count)
    part_frames = _checks.integer_or_none("part_frames", part_frames, least=LEAST_FRAMES)
    overlap = _checks.integer_or_none("overlap", overlap, least=1)
    if part_frames is not None and overlap is not None and overlap >= part_frames:
        raise OptionError(f"overlap: got {overlap}, expected fewer frames than part_frames, {part_frames}")
    retries = _checks.integer("retries", retries, least=0)
    parquet = _checks.flag("parquet", parquet)
    known = [*inspect.signature(extract).parameters][2:]
    _checks.options("extract_many", options, known)
    settings = ExtractSettings(**{name: value for name, value in options.items() if name not in NO_SETTINGS})
    settings.validate()
    folders = [
        f"{str(out).rstrip('/')}/{name}" if remote.is_remote(out) else str(Path(out) / name)
        for name in folder_names(listed)
    ]
    _expect_apart(listed, out, folders, settings)
    if not remote.is_remote(out):
        made_folder(Path(out))
    assignment = Assignment("", "", options, None, part_frames, overlap, parquet)
    courses = [
        Course(replace(assignment, source=source, folder=folder), retries)
        for source, folder in zip(listed, folders, strict=True)
    ]
    usual = len(listed) if part_frames is None else max(len(listed), 2 * processors())
    if executor is not None:
        for course in courses:
            course.assignment = course.assignment.elsewhere()
        return _collected(executor, courses, out, on_done, on_progress, at_once or (lambda: usual))
    available = processors()
    workers = min(jobs or available, len(listed) if part_frames is None else jobs or available)
    share = max(1, available // workers)
    for course in courses:
        course.assignment = replace(course.assignment, threads=share)
    # Not fork: the parent may hold threads of OpenCV or of a video library.
    context = get_context("spawn")
    wish = StopWish(context)
    with Workers(context, wish.watch) as pool:
        try:
            return _collected(pool, courses, out, on_done, on_progress, lambda: workers, wish=wish)
        except BaseException:
            # `on_done` raised: the pool is left as soon as its jobs have ended.
            wish.ask()
            raise


def _expect_apart(
    sources: Sequence[str | int], out: str | os.PathLike[str], folders: Sequence[str], settings: ExtractSettings
) -> None:
    """Raise OptionError where a result would be written over a source, or two results into one folder."""
    from .._results.inputs import Inputs
    from ..extraction.claim import input_files, written_names
    from .overview import expect_place

    expect_place(out)
    taken: dict[str, str] = {}
    for folder in folders:
        real = folder if remote.is_remote(folder) else os.path.realpath(folder)
        if real in taken:
            raise OptionError(
                f"out: got {taken[real]} and {folder}, which are one folder, {real}, expected one for each source"
            )
        taken[real] = folder
    for source in sources:
        if not isinstance(source, int) and Path(source).is_dir() and (real := os.path.realpath(source)) in taken:
            raise OptionError(f"out: got {taken[real]}, the folder of the pictures {source}, expected another one")
    # What is read must outlast the whole batch.
    read = Inputs([source for source in sources if not remote.is_remote(source)], files=input_files(settings))
    here = [folder for folder in folders if not remote.is_remote(folder)]
    read.refuse(Path(folder) / name for folder in here for name in written_names(settings))


def _collected(
    executor: Executor,
    courses: Sequence[Course],
    out: str | os.PathLike[str],
    on_done: Callable[[BatchItem], None] | None,
    on_progress: Callable[[float, int], None] | None,
    at_once: Callable[[], int],
    *,
    wish: StopWish | None = None,
) -> list[BatchItem]:
    """Hand out the steps, `at_once` at a time: what waits in a pool's own queue could not be called back.

    At Ctrl-C or SIGTERM nothing more is begun, and with a `wish` what runs is asked to end and keep what it has; the
    second time, to end at once. The workers of a caller's executor cannot be asked: they end by themselves, and the
    second time is a KeyboardInterrupt.
    """
    from ..extraction.stopping import StopRequest
    from .overview import write_overview

    waiting, active = deque(courses), list[Course]()
    running: dict[Future[Any], tuple[Course, Step]] = {}
    done = 0
    # Signals are counted, so that none comes between taking a result and keeping it.
    with StopRequest(interrupts=False) as stop:
        while waiting or active:
            if stop.requested:
                for future in running:
                    future.cancel()
                active += waiting
                waiting.clear()
                for course in active:
                    course.stop()
                if wish is None and stop.count > 1:
                    raise KeyboardInterrupt
                if wish is not None:
                    wish.ask(stop.count)
            else:
                _hand_out(executor, waiting, active, running, at_once())
            if running:
                finished, _ = wait(running, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
            else:
                finished = set()
                time.sleep(0.0 if any(course.item for course in active) else _LOOK_S)
            for future in finished:
                _taken(future, *running.pop(future))
            for course in [course for course in active if course.item is not None]:
                active.remove(course)
                done += 1
                if on_done is not None:
                    assert course.item is not None
                    on_done(course.item)
            if finished and on_progress is not None:
                on_progress(done + sum(course.share for course in active), len(courses))
    # Steps of a source that has failed may still run: they are not waited for.
    items = [course.item for course in courses if course.item is not None]
    write_overview(items, out)
    return items


def _hand_out(
    executor: Executor,
    waiting: deque[Course],
    active: list[Course],
    running: dict[Future[Any], tuple[Course, Step]],
    at_once: int,
) -> None:
    """Give workers what can be done now, of the sources that are begun first."""
    at = 0
    while len(running) < at_once:
        if at == len(active):
            if not waiting:
                return
            active.append(waiting.popleft())
        course = active[at]
        step = course.next()
        if step is None:
            at += 1
            continue
        running[executor.submit(end, step.what, course.assignment, *step.arguments)] = (course, step)


def _taken(future: Future[Any], course: Course, step: Step) -> None:
    """Give a course what became of its step."""
    if future.cancelled():
        course.cancelled()
        return
    error = future.exception()
    if error is None:
        course.ended(step, future.result())
    elif isinstance(error, CancelledError):
        course.cancelled()
    else:
        # The worker itself died: killed, out of memory, or its result could not be sent.
        course.died(step, f"{type(error).__name__}: {one_line(error)}")
