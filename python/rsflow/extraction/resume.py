"""Which unfinished run of a folder is gone on with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._results.folder import read_json
from ..errors import FormatError, OptionError
from .checkpoint import Saved, restoring, versions
from .file_names import NAMES
from .result import Extraction
from .workspace import unfinished

if TYPE_CHECKING:
    from .claim import Claim

__all__ = ["finished", "saved_run"]


def saved_run(claim: Claim, *, overwrite: bool) -> Saved | None:
    """Give the run in the folder of `claim` that got furthest; None where there is none to go on with.

    Raises
    ------
    OptionError
        If the source cannot be known to be the same, or there are only runs of another source, other settings or
        another version.
    FormatError
        If there are only damaged ones.
    """
    if claim.identity.source is None:
        raise OptionError(
            "resume: got True, expected False: a camera, a stream or an iterable does not show the same again: begin "
            "anew"
        )
    best: Saved | None = None
    trouble: FormatError | OptionError | None = None
    for folder in unfinished(claim.folder):
        try:
            saved = Saved(folder)
            with restoring(saved):
                reason = _difference(claim, saved)
        except FormatError as error:
            trouble = trouble or error
            continue
        if reason:
            trouble = trouble or OptionError(
                f"resume: got {folder}, {reason}, expected the same run; begin anew with --overwrite"
            )
        elif best is None or saved.frame > best.frame:
            best = saved
    if best is None and trouble is not None and not overwrite:
        raise trouble
    return best


def _difference(claim: Claim, saved: Saved) -> str:
    found = claim.identity.difference(saved.value("identity"))
    if found:
        return found
    then, now = saved.value("versions"), versions()
    others = ", ".join(f"{name} {then.get(name)}, here {now[name]}" for name in now if then.get(name) != now[name])
    return f"of other versions ({others})" if others else ""


def finished(claim: Claim) -> Extraction | None:
    """Give the complete result of the same source and settings that the folder holds, if it does."""
    summary = read_json(claim.folder / NAMES["summary"])
    names: Any = summary.get("files")
    if not summary.get("complete") or not isinstance(names, dict) or claim.identity.difference(summary.get("identity")):
        return None
    files = {name: claim.folder / Path(str(names[name])).name for name in NAMES if name in names}
    return Extraction(claim.folder, True, files, summary) if all(path.is_file() for path in files.values()) else None
