"""What an extraction gives back, and how it says that it ended early."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..errors import RsflowError
from . import columns

__all__ = ["Extraction", "ExtractionInterrupted", "PartialExtractionError"]


@dataclass(frozen=True, eq=False)
class Extraction:
    """The files of one extraction and its key figures.

    Attributes
    ----------
    folder : Path
        Where the files are.
    complete : bool
        True where the source was read to its end (or to `stop`; for a live source, until it was stopped).
    files : dict of str to Path
        The files that exist, by what they hold: ``motion``, ``objects``, ``velocity``, ``trajectory``, ``flow``,
        ``moving``, ``static``, ``background``, ``report``, ``summary``. In a partial extraction their names carry
        ``.partial``.
    summary : dict
        Key figures, also in ``summary.json``; see `docs <summary.json>`.

    Examples
    --------
    >>> import tempfile, rsflow
    >>> flight = rsflow.synthetic.flight(frames=4, seed=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = rsflow.extract(flight.images, folder, frame_rate=30, videos=False)
    ...     done.files["motion"].read_text().splitlines()[0][:25]
    'frame,t_s,dt_s,dx_px,dy_p'
    >>> done.complete, done.frames
    (True, 4)
    """

    folder: Path
    complete: bool
    files: dict[str, Path]
    summary: dict[str, Any]

    def __repr__(self) -> str:
        frames = f"{self.summary['frames']} frames" if "frames" in self.summary else "no summary"
        whole = "complete" if self.complete else "partial"
        return f'Extraction("{self.folder}", {whole}, {frames}:\n           {", ".join(self.files) or "no files"})'

    def to_table(self, name: str = "motion") -> dict[str, NDArray[Any]]:
        """Read a table as columns of equal length, for ``pandas.DataFrame``: a row for each of the file.

        Parameters
        ----------
        name : {"motion", "objects", "velocity", "trajectory"}
            Which one of `files`.

        Returns
        -------
        dict of str to ndarray
            Numbers as float64, NaN where the file has nothing; statuses and models as text.

        Raises
        ------
        OptionError
            If there is no such table.
        OSError
            If the file cannot be read.

        Examples
        --------
        >>> import tempfile, rsflow
        >>> flight = rsflow.synthetic.flight(frames=3, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     table = rsflow.extract(flight.images, folder, frame_rate=30, videos=False).to_table("motion")
        >>> table["frame"].tolist(), table["status"].tolist()
        ([0.0, 1.0, 2.0], ['first_frame', 'ok', 'ok'])
        """
        tables = [known for known, path in self.files.items() if path.suffix == ".csv"]
        if not tables:
            raise _checks.refused("name", name, "a table, of which there is none")
        name = _checks.choice("name", name, tables)
        with self.files[name].open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        names = rows[0] if rows else self.files[name].read_text(encoding="utf-8").split("\n")[0].strip().split(",")
        return {column: _column(column, [row[column] for row in rows]) for column in names}

    @property
    def frames(self) -> int:
        """Number of frames in ``motion.csv``."""
        return int(self.summary["frames"])


def _column(name: str, texts: list[str]) -> NDArray[Any]:
    """Give a column as text where it holds words, else as numbers."""
    if name in columns.WORDS:
        return np.array(texts, dtype=np.str_)
    return np.array([float(text) if text else np.nan for text in texts])


class PartialExtractionError(RsflowError, RuntimeError):
    """An extraction failed on its way; what was finished until then is kept.

    Attributes
    ----------
    extraction : Extraction
        What is kept. The cause of the failure is the exception's ``__cause__``.

    Examples
    --------
    >>> import tempfile, rsflow
    >>> pictures = [*rsflow.synthetic.flight(frames=4, seed=1).images, None]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     try:
    ...         rsflow.extract(pictures, folder, frame_rate=30, videos=False)
    ...     except rsflow.PartialExtractionError as stop:
    ...         print(stop.extraction.frames, stop.extraction.files["motion"].name)
    4 motion.partial.csv
    """

    def __init__(self, message: str, extraction: Extraction) -> None:
        super().__init__(message)
        self.extraction = extraction

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.args[0], self.extraction)


class ExtractionInterrupted(KeyboardInterrupt):
    """An extraction was stopped by Ctrl-C or SIGTERM; what was finished until then is kept.

    Attributes
    ----------
    extraction : Extraction
        What is kept.

    Examples
    --------
    >>> import signal, tempfile, rsflow
    >>> flight = rsflow.synthetic.flight(frames=12, seed=1)
    >>> def interrupted():
    ...     for index, image in enumerate(flight.images):
    ...         if index == 4:  # Ctrl-C is pressed
    ...             signal.raise_signal(signal.SIGINT)
    ...         yield image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     try:
    ...         rsflow.extract(interrupted(), folder, frame_rate=30, videos=False)
    ...     except rsflow.ExtractionInterrupted as stop:
    ...         print(stop.extraction.frames, stop.extraction.files["motion"].name)
    5 motion.partial.csv
    """

    def __init__(self, message: str, extraction: Extraction) -> None:
        super().__init__(message)
        self.extraction = extraction

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.args[0], self.extraction)
