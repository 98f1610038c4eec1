"""What the workers of a batch are told of a source, and what they tell of it."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._core import __version__
from . import remote
from .items import BatchItem, BatchStatus

if TYPE_CHECKING:
    from ..extraction import ExtractSettings
    from ..extraction.parts import Span

__all__ = ["NO_SETTINGS", "Assignment", "Failure", "Plan", "part_name", "seed_name"]

# Options of `rsflow.extract` that do not change what it measures.
NO_SETTINGS = ("progress", "overwrite", "resume", "on_frame")


@dataclass(frozen=True)
class Assignment:
    """One source of a batch, as its workers know it.

    Attributes
    ----------
    source : str or int
    folder : str
        Of the results; a path, or a URL of storage.
    options : dict
        Of `rsflow.extract`.
    threads : int or None
        That each worker uses.
    part_frames : int or None
        Of a part; None: a source is one piece.
    overlap : int or None
        Frames by which parts overlap; None: each goes on with all that the one before knew.
    parquet : bool
        Tables as Parquet too.
    version : str
        Of the rsflow that asks.
    given : str, int or None
        The source as it was given, where it is named otherwise for workers that are elsewhere.
    """

    source: str | int
    folder: str
    options: dict[str, Any] = field(repr=False)
    threads: int | None = None
    part_frames: int | None = None
    overlap: int | None = None
    parquet: bool = False
    version: str = __version__
    given: str | int | None = None

    @property
    def settings(self) -> ExtractSettings:
        """What is measured."""
        from ..extraction import ExtractSettings

        return ExtractSettings(**{name: value for name, value in self.options.items() if name not in NO_SETTINGS})

    @property
    def resume(self) -> bool:
        """Whether what is done already is not to be done again."""
        return bool(self.options.get("resume"))

    def elsewhere(self) -> Assignment:
        """Name all files so that workers in other folders, or on machines that share them, find them."""
        options = {name: _absolute(value) if name in _FILES else value for name, value in self.options.items()}
        sensors = options.get("sensors")
        if sensors is not None:
            logs = {name: _absolute(getattr(sensors, name)) for name in ("rates", "attitude")}
            options["sensors"] = replace(sensors, **logs)
        source, folder = _absolute(self.source), str(_absolute(self.folder))
        return replace(self, source=source, folder=folder, options=options, given=self.source)

    def place(self) -> Path | str:
        """Where the results are, as an item tells it."""
        return self.folder if remote.is_remote(self.folder) else Path(self.folder)

    def item(self, status: BatchStatus, error: str = "", summary: dict[str, Any] | None = None) -> BatchItem:
        """Say what became of the source."""
        source = self.source if self.given is None else self.given
        return BatchItem(source, self.place(), status, error, {} if summary is None else summary)


# Options that may be the path of a file.
_FILES = ("camera", "height_m", "mask", "times")


def _absolute(place: Any) -> Any:
    """Give a path from the root; what is a URL, or no path at all, as it is."""
    camera = isinstance(place, str) and place.isdecimal() and not os.path.exists(place)  # noqa: PTH110
    if isinstance(place, os.PathLike) or (isinstance(place, str) and "://" not in place and not camera):
        return os.path.abspath(place)  # noqa: PTH100
    return place


@dataclass(frozen=True)
class Failure:
    """Why something could not be done: in one line, and whether it is only that a part must not be cut out."""

    error: str
    interrupted: bool = False
    in_one_piece: bool = False


@dataclass(frozen=True)
class Plan:
    """How a source is cut: its parts and where they are put; none where it is one piece.

    Attributes
    ----------
    spans : tuple of Span
    root : str
        Folder or URL of the parts.
    done : frozenset of str
        Names in it that are there already.
    """

    spans: tuple[Span, ...] = ()
    root: str = ""
    done: frozenset[str] = frozenset()


def part_name(number: int) -> str:
    """Name of the folder of a part."""
    return f"part-{number:05d}"


def seed_name(number: int) -> str:
    """Name of the folder of what a part must know."""
    return f"seed-{number:05d}"
