"""What workers do for a batch: a whole source, or a part of a long one, and what comes before and after that."""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._core import __version__, set_num_threads
from ..errors import RsflowError
from ..io.atomic import working_name, writing
from . import remote
from .assignment import Assignment, Failure, Plan, part_name, seed_name
from .items import BatchItem, BatchStatus

if TYPE_CHECKING:
    from ..extraction import Extraction
    from ..extraction.parts import Span

__all__ = ["OF_WHAT_MOVES", "cut", "end", "join", "look_ahead", "measure_part", "whole"]

# Below the folder of a result: the parts of a run, until they are joined.
PARTS = "parts.partial.d"
# Columns of motion.csv that tell of what moves, as the scene is remembered; of parts that overlap those of one run but
# for what is older than the overlap.
OF_WHAT_MOVES = (
    *("moving_share", "objects", "camera_dx_px", "camera_dy_px", "camera_rotation_rad", "camera_scale"),
    *("camera_model", "segmentation_status"),
)
# Beside a result in storage: what it is of.
_STAMP = ".rsflow-batch.json"


def one_line(error: BaseException) -> str:
    """Give the message of an error in one line, with its type where it has none or is not expected."""
    text = " ".join(str(error).split())
    if isinstance(error, (RsflowError, OSError, MemoryError)):
        return text or type(error).__name__
    return f"{type(error).__name__}: {text}"


def end(what: str, assignment: Assignment, *arguments: Any) -> Any:
    """Do one step of a source; every expected failure is given back, so that it cannot stop the others."""
    from .stop import stoppable

    if assignment.version != __version__:
        return Failure(f"a worker has rsflow {__version__}, expected {assignment.version} as here")
    if assignment.threads is not None:
        set_num_threads(assignment.threads)
    begun = False
    try:
        with stoppable():
            begun = True
            if what in ("whole", "cut") and (done := _done(assignment)) is not None:
                return done
            with remote.fetched(assignment.source) as source:
                return _STEPS[what](assignment, source, *arguments)
    except KeyboardInterrupt:
        return Failure("interrupted" if begun else "not begun: the batch was interrupted", interrupted=True)
    except Exception as error:
        if isinstance(error, OSError) and error.strerror and "working-" in str(error):
            # The names of hidden files tell nobody anything.
            return Failure(f"{assignment.folder}: cannot be written: {error.strerror}")
        return Failure(one_line(error))


# --- a source in one piece ------------------------------------------------------------------------------------------


def whole(assignment: Assignment, source: Any, again: bool = False) -> BatchItem:
    """Extract from a source; with `again` go on with what a worker that died has left."""
    from ..extraction import ExtractionInterrupted, PartialExtractionError, extract

    options = dict(assignment.options)
    if again and not isinstance(source, int):
        options["resume"] = True
    with _results(assignment, source) as folder:
        try:
            done = extract(source, folder, **options)
        except (PartialExtractionError, ExtractionInterrupted) as stop:
            return assignment.item(BatchStatus.PARTIAL, " ".join(str(stop).split()), stop.extraction.summary)
        if assignment.parquet:
            from .parquet import as_parquet

            as_parquet(done.files, rows=None)
        # Of a run that died when its parts were joined.
        _removed(f"{assignment.folder}/{PARTS}")
        return assignment.item(BatchStatus.DONE, summary=done.summary)


@contextlib.contextmanager
def _results(assignment: Assignment, source: Any) -> Iterator[Path]:
    """Give the folder that results are written into, which is brought into storage at the end."""
    if not remote.is_remote(assignment.folder):
        yield Path(assignment.folder)
        _named(Path(assignment.folder), assignment, source)
        return
    with tempfile.TemporaryDirectory(prefix="rsflow-result-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        yield folder
        for hidden in folder.iterdir():
            # What a run of this machine alone could go on with.
            if hidden.is_dir():
                shutil.rmtree(hidden)
        _named(folder, assignment, source)
        (folder / _STAMP).write_text(json.dumps({"of": _stamped(assignment)}), encoding="utf-8")
        remote.sent(folder, assignment.folder, last=_STAMP)


def _named(folder: Path, assignment: Assignment, source: Any) -> None:
    """Let a result name a source in storage as it was given, not where it was fetched to."""
    if not remote.is_remote(assignment.source):
        return
    for path in folder.iterdir():
        if path.suffix in (".html", ".json") and path.is_file():
            text = path.read_text(encoding="utf-8")
            with writing(path) as partial:
                partial.write_text(text.replace(str(source), str(assignment.source)), encoding="utf-8")


def _stamped(assignment: Assignment) -> str:
    """Sum up what a result is of: the source, the settings, the versions of what measures."""
    from .._results.folder import Identity
    from ..extraction.checkpoint import versions
    from ..extraction.claim import IDENTIFYING

    there = remote.is_remote(assignment.source)
    identity = Identity.of("" if there else assignment.source, assignment.settings.flat(), files=IDENTIFYING)
    source = remote.stamp(str(assignment.source)) if there else identity.source
    text = json.dumps([source, identity.settings, versions(), assignment.part_frames, assignment.overlap])
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def _done(assignment: Assignment) -> BatchItem | None:
    """Give what became of the source where its result is in storage already, and it is to be resumed."""
    if not (assignment.resume and remote.is_remote(assignment.folder)):
        return None
    stamped = _stamped(assignment)
    found, summary = (remote.read(f"{assignment.folder}/{name}") for name in (_STAMP, "summary.json"))
    if found is None or summary is None or json.loads(found).get("of") != stamped:
        return None
    return assignment.item(BatchStatus.DONE, summary=json.loads(summary))


# --- a source in parts ----------------------------------------------------------------------------------------------


def cut(assignment: Assignment, source: Any) -> Plan | BatchItem:
    """Say how a source is cut, and which parts of it are there; or that there is nothing left to do."""
    from ..extraction.claim import Claim
    from ..extraction.parts import spans
    from ..extraction.resume import finished
    from ..extraction.workspace import unfinished

    assert assignment.part_frames is not None
    here = None if remote.is_remote(assignment.folder) else Path(assignment.folder)
    if here is not None:
        claim = Claim(here, source, assignment.settings, overwrite=bool(assignment.options.get("overwrite")))
        if assignment.resume:
            if (complete := finished(claim)) is not None:
                # A worker that died at the end has left them.
                _removed(f"{assignment.folder}/{PARTS}")
                return assignment.item(BatchStatus.DONE, summary=complete.summary)
            if any(unfinished(here)):
                return Plan()
    found = () if isinstance(source, int) else tuple(spans(source, assignment.settings, assignment.part_frames))
    if not found:
        return Plan()
    root = f"{assignment.folder}/{PARTS}/{_stamped(assignment)}"
    if not assignment.resume:
        _removed(f"{assignment.folder}/{PARTS}")
    return Plan(found, root, _there(root, len(found)))


def _removed(place: str) -> None:
    if remote.is_remote(place):
        remote.removed(place)
    else:
        shutil.rmtree(place, ignore_errors=True)


def _there(root: str, count: int) -> frozenset[str]:
    """Give the names of the parts and seeds that are complete."""
    from ..extraction.checkpoint import NAME
    from ..extraction.parts import NOTE

    wanted = {part_name(k): NOTE for k in range(count)} | {seed_name(k): NAME for k in range(1, count)}
    if remote.is_remote(root):
        file_system, path = remote.storage(root)
        try:
            found = {str(name)[len(path) :].lstrip("/") for name in file_system.find(path)}
        except FileNotFoundError:
            return frozenset()
        return frozenset(name for name, last in wanted.items() if f"{name}/{last}" in found)
    return frozenset(name for name, last in wanted.items() if (Path(root) / name / last).is_file())


@contextlib.contextmanager
def _new(root: str, name: str, last: str) -> Iterator[Path]:
    """Give an empty folder that becomes `name` in the folder of the parts, at once."""
    if remote.is_remote(root):
        with tempfile.TemporaryDirectory(prefix="rsflow-part-", ignore_cleanup_errors=True) as folder:
            yield Path(folder)
            remote.moved(Path(folder), f"{root}/{name}", last=last)
        return
    Path(root).mkdir(parents=True, exist_ok=True)
    folder_here = working_name(Path(root) / name)
    folder_here.mkdir()
    try:
        yield folder_here
        remote.moved(folder_here, f"{root}/{name}", last=last)
    finally:
        shutil.rmtree(folder_here, ignore_errors=True)


@contextlib.contextmanager
def _old(root: str, *names: str) -> Iterator[list[Path]]:
    """Give folders of earlier steps, fetched if they are in storage."""
    if not remote.is_remote(root):
        yield [Path(root) / name for name in names]
        return
    with tempfile.TemporaryDirectory(prefix="rsflow-parts-", ignore_cleanup_errors=True) as folder:
        yield [remote.received(f"{root}/{name}", Path(folder) / name) for name in names]


def look_ahead(assignment: Assignment, source: Any, root: str, span: Span) -> bool:
    """Find what a part must know of all before it; False where the source ends before."""
    from ..extraction.checkpoint import NAME
    from ..extraction.parts import NoFrameError, scout

    before = [seed_name(span.number - 1)] if span.number > 1 else []
    try:
        with _old(root, *before) as found, _new(root, seed_name(span.number), NAME) as folder:
            scout(source, assignment.settings, span, folder, found[0] if found else None)
    except NoFrameError:
        return False
    return True


def measure_part(assignment: Assignment, source: Any, root: str, span: Span, seed: str | None) -> bool:
    """Measure a part; False where the source ends before."""
    from ..extraction.parts import NOTE, NoFrameError, extract_part

    try:
        with _old(root, *([seed] if seed else [])) as found, _new(root, part_name(span.number), NOTE) as folder:
            known = found[0] if found else None
            extract_part(source, assignment.settings, span, folder, seed=known, overlap=assignment.overlap)
    except NoFrameError:
        return False
    return True


def join(assignment: Assignment, source: Any, root: str, count: int) -> BatchItem | Failure:
    """Make the result of its parts, and remove them."""
    from ..extraction import ExtractionInterrupted, PartialExtractionError, extract
    from ..extraction.joining import NotOneError, join_parts
    from ..extraction.workspace import unfinished

    overwrite = bool(assignment.options.get("overwrite"))
    with _results(assignment, source) as folder:
        rows: list[dict[str, int]] | None = None
        # One that a worker has left when it died is complete.
        if not any(unfinished(folder)):
            try:
                with _old(root, *map(part_name, range(count))) as parts:
                    rows = join_parts(source, assignment.settings, folder, parts, overwrite=overwrite)
            except NotOneError as error:
                return Failure(str(error), in_one_piece=True)
        try:
            done = extract(source, folder, **{**assignment.options, "resume": True})
        except (PartialExtractionError, ExtractionInterrupted) as stop:
            return assignment.item(BatchStatus.PARTIAL, " ".join(str(stop).split()), stop.extraction.summary)
        if assignment.overlap is not None:
            _told_of_parts(done, count, assignment.overlap)
        if assignment.parquet:
            from .parquet import as_parquet

            as_parquet(done.files, rows=rows)
    _removed(f"{assignment.folder}/{PARTS}")
    return assignment.item(BatchStatus.DONE, summary=done.summary)


def _told_of_parts(done: Extraction, count: int, overlap: int) -> None:
    """Say in the summary what of the tables is not that of one run to the byte."""
    before = f"{overlap} frame{'' if overlap == 1 else 's'}"
    done.summary["parts"] = count
    done.summary["notes"].append(
        f"Measured in {count} parts, each of which looked at {before} before it for what moves: objects.csv and "
        f"{', '.join(OF_WHAT_MOVES)} in motion.csv are those of one run but for what it would remember of the scene "
        "for longer. All else is that of one run, byte for byte; with --in-order (overlap=None) everything is."
    )
    with writing(done.files["summary"]) as partial:
        partial.write_text(json.dumps(done.summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")


_STEPS: dict[str, Any] = {
    "whole": whole,
    "cut": cut,
    "look ahead": look_ahead,
    "part": measure_part,
    "join": join,
}
