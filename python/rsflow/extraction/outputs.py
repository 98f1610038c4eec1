"""The files of an extraction: opened at the start, grown frame by frame, named when it is known how the run ended."""

from __future__ import annotations

import contextlib
import csv
import itertools
import shutil
import time
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from ..io.atomic import remove_leftovers
from .checkpoint import Draft, Saved, Schedule, versions
from .columns import MOTION, OBJECTS, TRAJECTORY, VELOCITY, WORDS
from .file_names import NAMES, partial_name
from .series import Series
from .tables import CsvTable
from .trajectory import Trajectory
from .views import Views
from .workspace import PARKED, Grown, Workspace, remove_killed

if TYPE_CHECKING:
    from .claim import Claim
    from .pipeline import Measured
    from .settings import ExtractSettings

__all__ = ["Outputs", "remove_partial"]


_TABLES = {"motion": MOTION, "objects": OBJECTS, "velocity": VELOCITY, "trajectory": TRAJECTORY}


class Outputs:
    """The tables and videos of one extraction. As a context manager it leaves nothing hidden behind.

    Parameters
    ----------
    folder : Path
    stream : Frames
    settings : ExtractSettings
    claim : Claim
        The right to write into the folder.
    saved : Saved, optional
        Go on with this run, in its files.
    """

    def __init__(
        self, folder: Path, stream: Any, settings: ExtractSettings, claim: Claim, saved: Saved | None = None
    ) -> None:
        self.folder, self.stream, self.settings, self.claim = folder, stream, settings, claim
        self.tables: dict[str, CsvTable] = {}
        # What the tables hold, once all is written: a run of days takes no memory for it.
        self.series: dict[str, Series] = {}
        self.views: Views | None = None
        self.trajectory: Trajectory | None = None
        self.seconds_before = 0.0
        self.schedule = Schedule()
        # Whether all is written, so that nothing is left to go on with.
        self.released = False
        self._made = _made(folder)
        if saved is None:
            remove_leftovers(folder)
            remove_killed(folder)
        self.workspace = Workspace(folder, claim.identity, None if saved is None else saved.folder)
        try:
            for name in ("motion", "objects") if settings.height_m is None else _TABLES:
                self._open(name, saved)
            if settings.height_m is not None:
                self.trajectory = Trajectory() if saved is None else saved.value("trajectory")
            if saved is not None:
                self.seconds_before = float(saved.value("seconds"))
        except BaseException:
            self.discard()
            raise

    def _open(self, name: str, saved: Saved | None) -> None:
        columns = _TABLES[name]
        place = self.workspace.path / NAMES[name]
        state = None if saved is None else saved.value("tables")[name]
        if state is not None:
            Grown(place).part()
        self.tables[name] = CsvTable(self.folder / NAMES[name], tuple(columns), place=place, state=state)

    @property
    def resumable(self) -> bool:
        """Whether a later run can be known to see the same source."""
        return self.claim.identity.source is not None

    def begin(self, style: Any) -> None:
        """Open the views, which need the style of the arrows."""
        self.views = Views(
            self.folder,
            self.workspace.path,
            self.stream,
            style=style,
            stride=self.settings.stride,
            videos=self.settings.videos,
        )

    def go_on(self, saved: Saved, frame: Any) -> None:
        """Open the views as they were after `frame`."""
        self.begin(saved.value("style"))
        assert self.views is not None
        self.views.restore(saved.value("views"), frame)

    def add(self, measured: Measured, attitude: dict[str, Any]) -> None:
        """Write one frame's rows and hand its pictures to the views; `attitude` is for `Trajectory.add`."""
        self._row("motion", measured.motion)
        for row in measured.objects:
            self._row("objects", row)
        if self.trajectory is not None and measured.velocity is not None and measured.velocity_row is not None:
            self._row("velocity", measured.velocity_row)
            self._row("trajectory", self.trajectory.add(measured.velocity, measured.frame.index, **attitude))
        if self.views is not None:
            self.views.add(measured)

    def _row(self, name: str, row: dict[str, Any]) -> None:
        self.tables[name].append(row)

    def checkpoint(
        self, frame: int, pipeline: dict[str, Any], seconds: float, *, drained: bool = False, must: bool = False
    ) -> None:
        """Keep what a run needs to go on after `frame`: now what changes, and when all is drawn the rest.

        With `must` it raises OSError where there is no room for it.
        """
        views = self.views
        assert views is not None
        begin = time.thread_time()
        draft = Draft()
        for name, value in (
            ("versions", versions()),
            ("identity", self.claim.identity.as_dict()),
            ("frame", frame),
            ("seconds", self.seconds_before + seconds),
            ("tables", {name: table.state() for name, table in self.tables.items()}),
            ("trajectory", self.trajectory),
            ("pipeline", pipeline),
            ("style", views.style),
        ):
            draft.add(name, value)
        took = time.thread_time() - begin

        def write() -> None:
            begin = time.monotonic()
            # A checkpoint tells of what is on the disk.
            draft.add("views", views.state())
            for table in self.tables.values():
                table.sync()
            if self.resumable:
                # Without room for it the run goes on, from the last one if it must.
                with contextlib.nullcontext() if must else contextlib.suppress(OSError):
                    draft.write(self.workspace.checkpoint)
            self.schedule.took(took + time.monotonic() - begin)

        if drained:
            write()
        else:
            views.after(write)

    def finish(self, *, ended_well: bool) -> tuple[dict[str, Path], Exception | None]:
        """Close all files and name them; one that cannot be completed is left out, and the first such error given.

        Videos are closed first: those that fail relieve a full disk, and the tables then fit.
        """
        clips = {} if self.views is None else self.views.clips
        trouble: Exception | None = None
        if self.views is not None:
            trouble = self.views.drained() or self.views.close()
        joined: dict[str, Path] = {}
        for name, clip in clips.items():
            try:
                path = clip.joined()
                if path is not None:
                    joined[name] = path
            except Exception as error:
                trouble = trouble or error
                clip.discard(parts=not self.workspace.checkpoint.exists())
        self.series = {name: _series(table) for name, table in self.tables.items()}
        tables = dict(self.tables)
        for name, table in self.tables.items():
            try:
                table.close()
            except Exception as error:
                trouble = trouble or error
                del tables[name]
        complete = ended_well and trouble is None
        # What a run that is killed now would go on with stays in its place too, until all is written.
        copy = self.workspace.checkpoint.exists()
        files: dict[str, Path] = {}
        for name, path in joined.items():
            final = self.folder / NAMES[name]
            grown = Grown(path)
            # What was joined is of no use to what goes on.
            give = grown.copy if copy and path.name != final.name else grown.keep
            files[name] = give(final if complete else partial_name(final))
        for name, table in tables.items():
            files[name] = table.keep(complete=complete, copy=copy)
        return files, trouble

    def discard(self) -> None:
        """Leave what a later run can go on with; remove the rest, and the folder if it was made and is empty."""
        if self.views is not None:
            self.views.discard()
        for table in self.tables.values():
            with contextlib.suppress(OSError):
                table.discard()
        if self.released or not self.resumable:
            self.workspace.remove()
        else:
            self.workspace.park()
        for folder in self._made:
            with contextlib.suppress(OSError):
                folder.rmdir()

    def __enter__(self) -> Outputs:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard()


def _series(table: CsvTable) -> Series:
    """Read what a table holds, as it stands there."""
    words = [column for column in table.columns if column in WORDS]
    series = Series([column for column in table.columns if column not in words], words)
    with table.place.open(newline="", encoding="utf-8") as file:
        for row in itertools.islice(csv.reader(file), 1, None):
            series.append_cells(table.columns, row)
    return series


def remove_partial(folder: Path) -> None:
    """Remove the partial files of an earlier run, and what it would have gone on with: it is complete now."""
    for name in NAMES.values():
        with contextlib.suppress(OSError):
            partial_name(folder / name).unlink(missing_ok=True)
    shutil.rmtree(folder / PARKED, ignore_errors=True)


def _made(folder: Path) -> list[Path]:
    """Make a folder with its parents; give those that were missing, the innermost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise type(error)(error.errno, f"cannot make the folder {folder}: {error.strerror}") from None
    return missing
