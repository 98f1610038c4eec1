"""The tables of a live run, as those of `rsflow.extract`: grown hidden, and named when the run ends."""

from __future__ import annotations

import threading
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from .._results.folder import Identity, ResultFolder
from .._results.inputs import Inputs
from ..extraction.claim import input_files
from ..extraction.columns import MOTION, OBJECTS, VELOCITY
from ..extraction.file_names import NAMES, partial_name
from ..extraction.tables import CsvTable

if TYPE_CHECKING:
    from ..extraction.pipeline import Measured
    from ..extraction.settings import ExtractSettings

__all__ = ["Tables"]

_COLUMNS = {"motion": MOTION, "objects": OBJECTS, "velocity": VELOCITY}
_FILES = ("camera", "height_m", "mask", "rates", "attitude")


class Tables:
    """``motion.csv``, ``objects.csv`` and with a camera ``velocity.csv`` of one run in a folder.

    Parameters
    ----------
    folder : Path
    source : source of `rsflow.frames`
    settings : ExtractSettings
    overwrite : bool
        Replace the tables of another run too.

    Raises
    ------
    OptionError
        If the folder holds the tables of another run, or one would be written over a file that is read.
    """

    def __init__(self, folder: Path, source: Any, settings: ExtractSettings, *, overwrite: bool) -> None:
        names = [name for name in _COLUMNS if name != "velocity" or settings.height_m is not None]
        finals = [folder / NAMES[name] for name in names]
        Inputs(source, files=input_files(settings)).refuse(finals)
        identity = Identity.of(source, settings.flat(), files=_FILES)
        patterns = [text for path in finals for text in (path.name, partial_name(path).name)]
        self._folder = ResultFolder(folder, "live", patterns, identity, overwrite=overwrite)
        self._tables: dict[str, CsvTable] = {}
        # A thread that cannot be waited for must not write into a table that is closed.
        self._lock = threading.Lock()
        self._open = True
        self._folder.__enter__()
        try:
            for name, final in zip(names, finals, strict=True):
                self._tables[name] = CsvTable(final, tuple(_COLUMNS[name]))
        except BaseException:
            self.discard()
            raise

    def add(self, measured: Measured) -> None:
        """Write the rows of a frame."""
        with self._lock:
            if not self._open:
                return
            self._tables["motion"].append(measured.motion)
            for row in measured.objects:
                self._tables["objects"].append(row)
            if "velocity" in self._tables and measured.velocity_row is not None:
                self._tables["velocity"].append(measured.velocity_row)

    def keep(self, *, complete: bool) -> dict[str, Path]:
        """Give the tables their names; partial ones where they lack what there was to write."""
        with self._lock:
            self._open = False
        if not self._tables["motion"].rows:
            self.discard()
            return {}
        self._folder.record()
        files = {name: table.keep(complete=complete) for name, table in self._tables.items()}
        self._folder.finish(files.values())
        self._folder.__exit__(None, None, None)
        self._tables.clear()
        return files

    def discard(self) -> None:
        """Leave nothing; harmless after `keep`."""
        with self._lock:
            self._open = False
        if self._tables:
            for table in self._tables.values():
                table.discard()
            self._tables.clear()
            self._folder.__exit__(RuntimeError, None, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.discard()
