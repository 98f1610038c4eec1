"""Tables that grow a row at a time and keep every finished row, whatever ends the run."""

from __future__ import annotations

import contextlib
import math
import os
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

from ..io.atomic import Working, remove_leftovers
from .file_names import partial_name
from .workspace import Grown, remove_killed, unfinished

__all__ = ["CsvTable", "cell", "discard_working"]


def cell(value: object) -> str:
    """Write one value of a table: numbers with 9 significant digits, ``nan`` and ``inf`` by name.

    Nine digits carry a float32 without loss and a time of days to a tenth of a millisecond.
    """
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        if math.isfinite(value):
            # Adding zero turns -0.0 into 0.0.
            return f"{value + 0.0:.9g}"
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    text = str(value)
    if any(mark in text for mark in ',"\n\r'):
        return '"' + text.replace('"', '""') + '"'
    return text


def discard_working(folder: Path) -> None:
    """Remove what a process that died was writing in `folder`, and the folder if nothing else is in it.

    A run that can be resumed stays.
    """
    remove_leftovers(folder)
    if not any(unfinished(folder)):
        remove_killed(folder)
    with contextlib.suppress(OSError):
        folder.rmdir()


class CsvTable:
    """A CSV file with fixed columns; each row is on its way to the disk when `append` returns.

    Rows go to a hidden file beside `path`. `keep` gives it its final name; a row that could not be written in full
    (a full disk) is cut off, so that the file ends with the last whole row.

    Parameters
    ----------
    path : path
        The final name.
    columns : sequence of str
        The header. Units stand in the names.
    place : Path, optional
        Where it grows; by default hidden beside `path`.
    state : sequence of int, optional
        Go on with the file at `place`, of which `state` told.

    Raises
    ------
    ValueError
        If the file at `place` does not begin as `state` says.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        columns: Sequence[str],
        *,
        place: Path | None = None,
        state: Sequence[int] | None = None,
    ) -> None:
        self.path = Path(path)
        self.columns = tuple(columns)
        self.rows = 0
        self._working: Working | None = None
        if place is None:
            self._working = Working(self.path)
            place = self._working.path
        self.place = place
        self._end = self._sum = 0
        self._file = self.place.open("wb" if state is None else "rb+", buffering=0)
        try:
            if state is None:
                self._write(",".join(self.columns))
            else:
                self._go_on(*state)
        except BaseException:
            self.discard()
            raise

    def _go_on(self, rows: int, end: int, check: int) -> None:
        self.rows, self._end, left = rows, end, end
        while left and (data := self._file.read(min(left, 1 << 20))):
            self._sum = zlib.crc32(data, self._sum)
            left -= len(data)
        if left or self._sum != check:
            raise ValueError(f"{self.place.name} is not as it was")
        self._file.truncate(end)
        self._file.seek(end)

    def state(self) -> tuple[int, int, int]:
        """Give what tells of the file as it is: rows, bytes and their check sum."""
        return self.rows, self._end, self._sum

    def sync(self) -> None:
        """Bring what is written to the disk."""
        if not self._file.closed:
            os.fsync(self._file.fileno())

    def append(self, row: Mapping[str, object]) -> list[str]:
        """Write one row and give its cells; a column that `row` does not name stays empty.

        Raises
        ------
        KeyError
            If `row` names a column that the table does not have.
        OSError
            If the row cannot be written; the rows before it stay.
        """
        unknown = row.keys() - set(self.columns)
        if unknown:
            raise KeyError(f"{self.path.name} has no column {', '.join(sorted(unknown))}")
        cells = [cell(row.get(name)) for name in self.columns]
        self._write(",".join(cells))
        self.rows += 1
        return cells

    def _write(self, line: str) -> None:
        data = memoryview(f"{line}\n".encode())
        try:
            written = 0
            while written < len(data):
                # A raw write may take only a part, as it does on a disk that becomes full.
                written += self._file.write(data[written:]) or 0
        except OSError as error:
            self._file.truncate(self._end)
            self._file.seek(self._end)
            raise OSError(error.errno, os.strerror(error.errno or 0), str(self.path)) from None
        self._end += len(data)
        self._sum = zlib.crc32(data, self._sum)

    def close(self) -> None:
        """Bring what is written to the disk; the file keeps its hidden name until `keep`."""
        self.sync()
        self._file.close()

    def keep(self, *, complete: bool = True, copy: bool = False) -> Path:
        """Close the table and name it: `path`, or its partial name where the run did not end well.

        With `copy` it stays where it grows too.
        """
        self.close()
        final = self.path if complete else partial_name(self.path)
        if self._working is not None:
            return self._working.keep(final)
        grown = Grown(self.place)
        return grown.copy(final) if copy else grown.keep(final)

    def discard(self) -> None:
        """Close the table and remove what was written."""
        self._file.close()
        if self._working is not None:
            self._working.discard()

    def __enter__(self) -> CsvTable:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.keep(complete=error is None)
