"""Whether an extraction may write into a folder: not over what it reads, nor over the result of another one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .._results.folder import Identity, expect_own, expect_plain, read_json
from .._results.inputs import Inputs
from .file_names import NAMES, partial_name
from .settings import ExtractSettings
from .workspace import identities

__all__ = ["IDENTIFYING", "Claim", "input_files", "written_names"]

# Options that are files: what is in them counts, and nothing is written over them.
IDENTIFYING = ("camera", "height_m", "mask", "rates", "attitude", "times")


def written_names(settings: ExtractSettings) -> Iterator[str]:
    """Names of all files that a run with these settings may leave in its folder."""
    for name, file in NAMES.items():
        if name in ("velocity", "trajectory") and settings.height_m is None:
            continue
        if name in ("flow", "moving", "static") and not settings.videos:
            continue
        yield file
        yield partial_name(Path(file)).name


def input_files(settings: ExtractSettings) -> list[Any]:
    """Give the files that a run reads beside its source."""
    options = settings.flat()
    return [options[name] for name in IDENTIFYING if name in options]


class Claim:
    """The right of one run to write into `folder`.

    Parameters
    ----------
    folder : Path
    source : source of `rsflow.frames`
    settings : ExtractSettings
    overwrite : bool
        Replace the result of another source or of other settings too.

    Raises
    ------
    OptionError
        If a file would be written over that is read, or over the result of another run; nothing is written then.
    """

    def __init__(self, folder: Path, source: Any, settings: ExtractSettings, *, overwrite: bool) -> None:
        self.folder, self.settings = folder, settings
        Inputs(source, files=input_files(settings)).refuse(folder / name for name in written_names(settings))
        self.identity = Identity.of(source, settings.flat(), files=IDENTIFYING)
        self._stale: set[str] = set()
        found = sorted(path for name in written_names(settings) if (path := folder / name).exists())
        expect_plain(found)
        summaries = [read_json(path) for path in (folder / NAMES["summary"], partial_name(folder / NAMES["summary"]))]
        summaries = [summary for summary in summaries if summary]
        # One that was killed while it named its files has left no summary, but its workspace.
        own = not summaries and any(not self.identity.difference(left) for left in identities(folder))
        for summary in [] if own else summaries or [{}]:
            difference = self.identity.difference(summary.get("identity"))
            if difference and not overwrite:
                expect_own(folder, found, difference, detail=self._detail(summary))
            if difference and isinstance(summary.get("files"), dict):
                self._stale |= {str(name) for name in summary["files"].values()} & set(NAMES.values())

    def _detail(self, summary: Mapping[str, Any]) -> str:
        """Say which settings differ."""
        now, then = self.settings.as_text(), summary.get("settings")
        if not isinstance(then, dict):
            return ""
        texts = [f"{name} was {then[name]}" for name in now if name in then and str(then[name]) != now[name]]
        return "".join(f"; {text}" for text in texts[:3])

    def remove_stale(self, written: Mapping[str, Path]) -> None:
        """Remove what the replaced result had and this one has not: a folder holds the result of one run."""
        for name in self._stale - {path.name for path in written.values()}:
            with contextlib.suppress(OSError):
                (self.folder / name).unlink(missing_ok=True)
