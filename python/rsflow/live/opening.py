"""The source of a live run: a camera, a stream, or something played in its place."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from ..capture.opening import frames

if TYPE_CHECKING:
    from ..capture.stream import Frames, FrameSource

__all__ = ["opened"]

# What a web address of such a name gives has an end: it is a file.
_FILES = (".mp4", ".mov", ".mkv", ".webm", ".avi", ".m4v", ".ts", ".gif")


def opened(source: FrameSource, *, real_time: bool = False, **options: Any) -> Frames:
    """Open it, in colour; `options` are of `rsflow.frames`. A web address is live unless it names a video."""
    newest = True if _is_live_address(source) and not real_time else None
    return frames(source, color=True, newest=newest, real_time=real_time, **options)


def _is_live_address(source: Any) -> bool:
    if not isinstance(source, str) or "://" not in source:
        return False
    address = urlsplit(source)
    return address.scheme.lower() in ("http", "https") and PurePosixPath(address.path).suffix.lower() not in _FILES
