"""Opening a video or camera with OpenCV, without what it and FFmpeg write to standard error."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from typing import Any

from .fork_guard import opening
from .native_names import is_text, native_name

__all__ = ["open_capture", "quiet"]

# OpenCV's log level is one for the whole process: the first to ask for quiet keeps what it was, the last restores it.
_quiet_lock = threading.Lock()
_quiet_depth = 0
_loud_level = 0


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep OpenCV from writing to standard error about what we report ourselves."""
    global _quiet_depth, _loud_level
    with opening:
        import cv2

    # OpenCV 4 has these two at the top, OpenCV 5 in a module; 0 is silent in both.
    logging = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    with _quiet_lock:
        if _quiet_depth == 0:
            _loud_level = logging.getLogLevel()
            logging.setLogLevel(0)
        _quiet_depth += 1
    try:
        yield
    finally:
        with _quiet_lock:
            _quiet_depth -= 1
            if _quiet_depth == 0:
                logging.setLogLevel(_loud_level)


def _renew() -> None:
    """In a child of a fork: threads that had asked for quiet, or were about to, are not there."""
    global _quiet_lock, _quiet_depth
    _quiet_lock = threading.Lock()
    if _quiet_depth:
        import cv2

        _quiet_depth = 0
        (cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging).setLogLevel(_loud_level)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew)


@contextlib.contextmanager
def _quiet_ffmpeg() -> Iterator[None]:
    """Keep FFmpeg quiet: OpenCV reads this variable once, when it opens its first video; -8 is AV_LOG_QUIET."""
    variable = "OPENCV_FFMPEG_LOGLEVEL"
    unset = variable not in os.environ
    if unset:
        os.environ[variable] = "-8"
    try:
        with quiet():
            yield
    finally:
        if unset:
            os.environ.pop(variable, None)


def open_capture(source: int | str) -> Any:
    """Open a cv2.VideoCapture without its messages; the caller checks `isOpened`."""
    with opening:
        import cv2

    with _quiet_ffmpeg():
        try:
            if not isinstance(source, str):
                return cv2.VideoCapture(source)
            if "://" in source or source.startswith("/dev/"):
                return cv2.VideoCapture(source) if is_text(source) else cv2.VideoCapture()
            # A file name must not be taken for a numbered pattern: only FFmpeg and the like may open it.
            with opening, native_name(source) as name:
                capture = cv2.VideoCapture(name, cv2.CAP_FFMPEG)
                return capture if capture.isOpened() else cv2.VideoCapture(name)
        except (cv2.error, OSError):
            return cv2.VideoCapture()
