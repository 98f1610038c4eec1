"""What an extraction gives back, and how it says that it ended early."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import RsflowError

__all__ = ["Extraction", "ExtractionInterrupted", "PartialExtractionError"]


@dataclass(frozen=True)
class Extraction:
    """The files of one extraction and its key figures.

    Attributes
    ----------
    folder : Path
        Where the files are.
    complete : bool
        True where the source was read to its end (or to `stop`; for a live source, until it was stopped).
    files : dict of str to Path
        The files that exist, by what they hold: ``motion``, ``objects``, ``velocity``, ``track``, ``flow``,
        ``moving``, ``static``, ``background``, ``report``, ``summary``. In a partial extraction their names carry
        ``.partial``.
    summary : dict
        Key figures, also in ``summary.json``; see `docs <summary.json>`.
    """

    folder: Path
    complete: bool
    files: dict[str, Path]
    summary: dict[str, Any]

    @property
    def frames(self) -> int:
        """Number of frames in ``motion.csv``."""
        return int(self.summary["frames"])


class PartialExtractionError(RsflowError, RuntimeError):
    """An extraction failed on its way; what was finished until then is kept.

    Attributes
    ----------
    extraction : Extraction
        What is kept. The cause of the failure is the exception's ``__cause__``.
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
    """

    def __init__(self, message: str, extraction: Extraction) -> None:
        super().__init__(message)
        self.extraction = extraction

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.args[0], self.extraction)
