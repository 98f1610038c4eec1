"""The sources that words on a command line stand for: files, the videos in folders, what patterns match, storage."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from pathlib import Path

from ..errors import MissingExtraError, OptionError
from ..io.picture_names import PICTURES, natural_key
from . import remote

__all__ = ["VIDEOS", "found_sources"]

# Suffixes of what is looked for in folders; a file that is named by itself may have any.
VIDEOS = (
    *(".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".mts", ".m2ts", ".ts", ".wmv", ".flv"),
    *(".3gp", ".ogv", ".gif", ".h264", ".h265", ".hevc", ".mjpeg", ".mxf"),
)


def found_sources(words: Iterable[str]) -> tuple[list[int | str], list[str]]:
    """Give the sources that words stand for, each once and in order, and what was passed over, in sentences.

    A folder of pictures is one source. Any other folder stands for the videos in it and below, and a pattern for each
    video that it matches: pictures alone are one source, as for `rsflow.frames`. In storage a folder or pattern stands
    for videos. What stands for nothing is given as it is: it is told of when its turn comes, and stops nothing.

    Parameters
    ----------
    words : iterable of str
        Paths, patterns, URLs, cameras' numbers.
    """
    found: dict[int | str, None] = {}
    notes: list[str] = []
    for word in words:
        for source in _of_word(word, notes):
            found[source] = None
    return list(found), notes


def _of_word(word: str, notes: list[str]) -> list[int | str]:
    if remote.is_remote(word):
        try:
            return list(remote.listed(word, VIDEOS)) or [word]
        except (OSError, OptionError, MissingExtraError):
            return [word]
    path = Path(word)
    if path.is_dir():
        return _in_folder(path, notes)
    if path.exists() or "://" in word:
        return [word]
    if word.isdecimal():
        return [int(word)]
    if glob.has_magic(word):
        names = sorted(glob.glob(word, recursive=True), key=lambda name: natural_key(Path(name)))  # noqa: PTH207
        files = [name for name in names if Path(name).is_file()]
        if files and all(name.lower().endswith(PICTURES) for name in files):
            return [word]
        # What a pattern matches beside videos is as little meant as what else lies in a folder.
        videos: list[int | str] = [name for name in files if name.lower().endswith(VIDEOS)]
        folders = [source for name in names if Path(name).is_dir() for source in _in_folder(Path(name), notes)]
        _pass_over(word, [name for name in files if not name.lower().endswith(VIDEOS)], notes)
        return videos + folders or [word]
    return [word]


def _in_folder(folder: Path, notes: list[str]) -> list[int | str]:
    if any(_is_shown(item) and item.suffix.lower() in PICTURES for item in folder.iterdir()):
        return [str(folder)]
    files: list[Path] = []
    for place, inner, names in os.walk(folder):
        inner[:] = sorted(name for name in inner if not name.startswith("."))
        files += sorted((Path(place, name) for name in names if not name.startswith(".")), key=natural_key)
    videos: list[int | str] = [str(path) for path in files if path.suffix.lower() in VIDEOS]
    if not videos:
        return [str(folder)]
    _pass_over(str(folder), [str(path) for path in files if path.suffix.lower() not in VIDEOS], notes)
    return videos


def _is_shown(path: Path) -> bool:
    return path.is_file() and not path.name.startswith(".")


def _pass_over(word: str, names: list[str], notes: list[str]) -> None:
    if names:
        told = ", ".join(Path(name).name for name in names[:3]) + (", ..." if len(names) > 3 else "")
        notes.append(f"{word}: {len(names)} file{'s are' if len(names) > 1 else ' is'} no video and left out: {told}")
