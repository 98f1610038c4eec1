"""Which reader serves a source, and the readers of pictures and of arrays in memory."""

from __future__ import annotations

import math
import os
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import number, path
from ..errors import CaptureError, DTypeError, OptionError
from ..io.limits import kind_of
from ..io.picture_headers import picture_kind
from ..io.picture_names import PICTURES, matches, natural_key
from .pages import PagesReader, PictureFile, read_picture
from .reader import Raw, Reader, Timestamps
from .stream import Frame, Frames

_LIVE_SCHEMES = ("rtsp", "rtsps", "rtmp", "rtmps", "udp", "rtp", "srt", "tcp", "mms")


def open_source(
    source: Any,
    *,
    newest: bool | None,
    timeout_s: float,
    reconnect_s: float | None,
    camera_size: tuple[int, int] | None,
    limit: int,
) -> Reader:
    """Find out what `source` is and open it."""
    live = _live_name(source, newest)
    if live is not None:
        from .live import LiveReader

        return LiveReader(
            live,
            newest=newest is not False,
            timeout_s=timeout_s,
            reconnect_s=reconnect_s,
            camera_size=camera_size,
        )
    if newest:
        raise OptionError(
            f"newest: got True, expected False or None: {_name(source)} is not live, no frame of it is lost by waiting"
        )
    if camera_size is not None:
        raise OptionError(f"camera_size: got {camera_size}, expected None: {_name(source)} is not a camera")
    if isinstance(source, Frames):
        raise OptionError(
            "source: got the frames of another call, expected what they are of: they have their options already and "
            "are used as they are"
        )
    if isinstance(source, np.ndarray):
        if source.ndim not in (3, 4):
            raise OptionError(
                f"source: got one array of shape {source.shape}, expected (N, H, W), (N, H, W, 3) or a list"
            )
        return ArrayReader(source, len(source), limit)
    if isinstance(source, (str, os.PathLike)):
        return _open_path(os.fspath(source), limit)
    if not isinstance(source, Iterable):
        raise OptionError(f"source: got {type(source).__name__}, expected an index, a path, a URL, arrays or a list")
    if isinstance(source, (list, tuple)):
        if not source:
            raise CaptureError("source: got an empty list, expected at least one frame")
        if all(isinstance(item, (str, os.PathLike)) for item in source):
            if len(source) == 1:
                return _picture_source(path("source", source[0], "paths of pictures"), limit)
            return PictureReader(
                [path("source", item, "paths of pictures") for item in source], f"list of {len(source)} pictures", limit
            )
        return ArrayReader(source, len(source), limit)
    return ArrayReader(source, None, limit)


def _live_name(source: Any, newest: bool | None) -> int | str | None:
    """Give what to hand to VideoCapture where the source is live, else None."""
    if isinstance(source, (bool, np.bool_)):
        raise OptionError(f"source: got {source}, expected a camera's index, a path, a URL, arrays or a list")
    if isinstance(source, (int, np.integer)):
        if source < 0:
            raise OptionError(f"source: got the camera index {source}, expected at least 0")
        return int(source)
    if not isinstance(source, (str, os.PathLike)):
        return None
    text = os.fspath(source)
    if text.isdigit() and not Path(text).exists():
        return int(text)
    if "://" in text:
        return text if newest or text.split("://")[0].lower() in _LIVE_SCHEMES else None
    return text if text.startswith("/dev/video") else None


def _name(source: Any) -> str:
    return str(source) if isinstance(source, (str, os.PathLike)) else f"a {type(source).__name__}"


def _open_path(text: str, limit: int) -> Reader:
    from .video import VideoReader

    if not text:
        raise CaptureError("source: got an empty path")
    if "\0" in text:
        raise CaptureError(f"source: got {text[:80]!r}, which is no path")
    if "://" in text:
        return VideoReader(text, limit)
    path = Path(text)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return _open_pattern(text, limit)
    except OSError as error:
        raise CaptureError(f"{text[:200]}: cannot be read: {error.strerror or error}") from None
    if stat.S_ISDIR(mode):
        found = [item for item in path.iterdir() if item.suffix.lower() in PICTURES and not item.name.startswith(".")]
        if not found:
            raise CaptureError(f"{text}: the folder holds no picture ({', '.join(PICTURES)})")
        return _pictures(sorted(found, key=natural_key), text, limit)
    if not stat.S_ISREG(mode):
        raise CaptureError(f"{text}: got {kind_of(mode)}, expected a file, a folder or a camera (/dev/video...)")
    if path.stat().st_size == 0:
        raise CaptureError(f"{text}: the file is empty")
    return _picture_source(path, limit) if _is_picture(path) else VideoReader(text, limit)


def _open_pattern(text: str, limit: int) -> Reader:
    from .video import VideoReader

    found = matches(text)
    if found is None:
        raise CaptureError(f"{text}: no such file or folder")
    if not found:
        raise CaptureError(f"{text}: no file matches")
    if len(found) == 1 and not _is_picture(found[0]):
        return VideoReader(str(found[0]), limit)
    return _pictures(found, text, limit)


def _is_picture(path: Path) -> bool:
    """Say whether a file is a picture, by its suffix or by its first bytes.

    FFmpeg reads GIF, with its times; what begins as a JPEG may be a stream of them.
    """
    if path.suffix.lower() in PICTURES:
        return True
    if path.suffix.lower() in (".gif", ".apng"):
        return False
    try:
        with path.open("rb") as file:
            return picture_kind(file.read(64)) not in ("", "gif", "jpeg")
    except OSError:
        return False


def _pictures(paths: list[Path], source: str, limit: int) -> Reader:
    return _picture_source(paths[0], limit) if len(paths) == 1 else PictureReader(paths, source, limit)


def _picture_source(path: Path, limit: int) -> Reader:
    """Give the reader of one picture file: of its pages where it has several."""
    file = PictureFile(path, limit)
    return PagesReader(file) if len(file.header.pages) > 1 else PictureReader([path], str(path), limit, file.picture())


class PictureReader:
    """Picture files in the order given."""

    def __init__(self, paths: list[Path], source: str, limit: int, first: NDArray[Any] | None = None) -> None:
        self.source = source
        self.frame_rate: float | None = None
        self.count: int | None = len(paths)
        self.timestamps: Timestamps = "none"
        self.live = False
        self.exact = True
        self.lost = 0
        self.notes: tuple[str, ...] = ()
        self._paths = paths
        self._limit = limit
        self._next = 0
        self._ahead = read_picture(paths[0], limit) if first is None else first
        height, width = self._ahead.shape[:2]
        self.size: tuple[int, int] | None = (width, height)

    def read(self, wanted: bool) -> Raw | None:
        """Give the next picture; one that is not wanted is not read."""
        index = self._next
        if index >= len(self._paths):
            return None
        self._next += 1
        path = self._paths[index]
        image = (self._ahead if index == 0 else read_picture(path, self._limit)) if wanted else None
        return Raw(image, float("nan"), index, str(path))

    def close(self) -> None:
        """End the reading."""
        self._next = len(self._paths)


# What stands where an iterable has ended: None may be one of its items, as cv2.imread's for a file it cannot read.
_END = object()


class ArrayReader:
    """Arrays, (array, t_s) pairs or `Frame` objects in memory, or made one by one by an iterable."""

    def __init__(self, items: Iterable[Any], count: int | None, limit: int) -> None:
        self.source = "arrays" if count is None else f"list of {count} arrays"
        self.frame_rate: float | None = None
        self.count = count
        self.live = False
        self.exact = True
        self.lost = 0
        self.notes: tuple[str, ...] = ()
        self._limit = limit
        self._items: Iterator[Any] = iter(items)
        self._next = 0
        self._last_s = -math.inf
        self._ahead = next(self._items, _END)
        if self._ahead is _END:
            raise CaptureError("source: got no frame, expected at least one")
        image, t_s, _ = self._parts(self._ahead, 0)
        self.size: tuple[int, int] | None = (image.shape[1], image.shape[0]) if image.ndim >= 2 else None
        self.timestamps: Timestamps = "none" if np.isnan(t_s) else "given"

    def _parts(self, item: Any, index: int) -> tuple[NDArray[Any], float, str]:
        if isinstance(item, Frame):
            seconds = number(f"source: item {index}: t_s", item.t_s, of="seconds", or_nan=True)
            return (item.image if item.color is None else item.color), seconds, item.name
        if isinstance(item, (str, os.PathLike)):
            return read_picture(path(f"source: item {index}", item), self._limit), float("nan"), str(item)
        t_s = float("nan")
        if isinstance(item, tuple) and len(item) == 2:
            item, given = item
            t_s = number(f"source: item {index}: t_s", given, of="seconds", or_nan=True)
            if isinstance(item, (str, os.PathLike)):
                return read_picture(path(f"source: item {index}", item), self._limit), t_s, str(item)
        if not isinstance(item, np.ndarray):
            raise DTypeError(
                f"source: item {index}: got {type(item).__name__}, expected an array, an (array, t_s) pair, "
                "a path or a Frame"
            )
        return item, t_s, ""

    def read(self, wanted: bool) -> Raw | None:
        """Give the next array."""
        item = self._ahead if self._next == 0 else next(self._items, _END)
        if item is _END:
            return None
        index = self._next
        self._next += 1
        image, t_s, name = self._parts(item, index)
        # NaN, where a time is not known, is neither before nor after.
        if t_s <= self._last_s:
            raise OptionError(f"source: item {index}: t_s: got {t_s} after {self._last_s}, expected increasing times")
        self._last_s = t_s if t_s == t_s else self._last_s
        return Raw(image, t_s, index, name)

    def close(self) -> None:
        """Let go of what is left."""
        self._items = iter(())
        self._ahead = _END
