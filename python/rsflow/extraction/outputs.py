"""The files of an extraction: opened at the start, grown frame by frame, named when it is known how the run ended."""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

from .._files import remove_leftovers
from . import columns
from .series import Series
from .tables import CsvTable, partial_name
from .track import Track
from .views import Views

if TYPE_CHECKING:
    from .claim import Claim
    from .pipeline import Measured
    from .settings import ExtractSettings

__all__ = ["NAMES", "Outputs"]

# Every file that an extraction may leave, by what it holds.
NAMES = {
    "report": "report.html",
    "motion": "motion.csv",
    "objects": "objects.csv",
    "velocity": "velocity.csv",
    "track": "track.csv",
    "flow": "flow.mp4",
    "moving": "moving.mp4",
    "static": "static.mp4",
    "background": "background.png",
    "summary": "summary.json",
}


class _Growing(Protocol):
    """A file under a hidden name until `keep` gives it its own."""

    def close(self) -> None: ...
    def keep(self, *, complete: bool) -> Path | None: ...
    def discard(self) -> None: ...


class Outputs:
    """The tables and videos of one extraction. As a context manager it leaves nothing hidden behind."""

    def __init__(self, folder: Path, stream: Any, settings: ExtractSettings, claim: Claim) -> None:
        self.folder, self.stream, self.settings, self.claim = folder, stream, settings, claim
        self.tables: dict[str, CsvTable] = {}
        self.series: dict[str, Series] = {}
        self.views: Views | None = None
        self.track: Track | None = None
        self._made = _made(folder)
        remove_leftovers(folder)
        try:
            self._open("motion", columns.MOTION)
            self._open("objects", columns.OBJECTS)
            if settings.height_m is not None:
                self._open("velocity", columns.VELOCITY)
                self._open("track", columns.TRACK)
                self.track = Track()
        except BaseException:
            self.discard()
            raise

    def _open(self, name: str, names: dict[str, str]) -> None:
        self.tables[name] = CsvTable(self.folder / NAMES[name], tuple(names))
        words = [column for column in names if column in columns.WORDS]
        self.series[name] = Series([column for column in names if column not in words], words)

    def begin(self, style: Any) -> None:
        """Open the views, which need the style of the arrows."""
        self.views = Views(
            self.folder, self.stream, style=style, stride=self.settings.stride, videos=self.settings.videos
        )

    def add(self, measured: Measured) -> None:
        """Write one frame's rows and hand its pictures to the views."""
        self._row("motion", measured.motion)
        for row in measured.objects:
            self._row("objects", row)
        if self.track is not None and measured.velocity_row is not None:
            self._row("velocity", measured.velocity_row)
            self._row("track", self.track.add(measured.velocity, measured.frame.index))
        if self.views is not None:
            self.views.add(measured)

    def _row(self, name: str, row: dict[str, Any]) -> None:
        self.tables[name].append(row)
        self.series[name].append(row)

    def finish(self, *, ended_well: bool) -> tuple[dict[str, Path], Exception | None]:
        """Close all files and name them; one that cannot be completed is removed, and the first such error given.

        Videos are closed first: those that fail relieve a full disk, and the tables then fit.
        """
        trouble: Exception | None = None
        if self.views is not None:
            trouble = self.views.drained()
        growing: dict[str, _Growing] = {**(self.views.clips if self.views is not None else {}), **self.tables}
        for name, item in list(growing.items()):
            try:
                item.close()
            except Exception as error:
                trouble = trouble or error
                with contextlib.suppress(OSError):
                    item.discard()
                del growing[name]
        files: dict[str, Path] = {}
        for name, item in growing.items():
            path = item.keep(complete=ended_well and trouble is None)
            if path is not None:
                files[name] = path
        return files, trouble

    def discard(self) -> None:
        """Remove what has no name yet, and the folder if it was made for this run and is empty."""
        if self.views is not None:
            self.views.discard()
        for table in self.tables.values():
            with contextlib.suppress(OSError):
                table.discard()
        for folder in self._made:
            with contextlib.suppress(OSError):
                folder.rmdir()

    def __enter__(self) -> Outputs:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard()


def remove_partial(folder: Path) -> None:
    """Remove the partial files of an earlier run: a complete one stands in their place."""
    for name in NAMES.values():
        with contextlib.suppress(OSError):
            partial_name(folder / name).unlink(missing_ok=True)


def _made(folder: Path) -> list[Path]:
    """Make a folder with its parents; give those that were missing, the innermost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise type(error)(error.errno, f"cannot make the folder {folder}: {error.strerror}") from None
    return missing
