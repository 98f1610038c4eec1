"""Video files, with the timestamps that they carry."""

from __future__ import annotations

import contextlib
import heapq
import math
import os
import threading
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..errors import CaptureError
from ._reader import Raw, Timestamps

# Frames looked at when a file is opened, to see whether its timestamps exist and are in order. Reordering in H.264
# and HEVC spans at most 16 frames.
_PROBE_FRAMES = 24

# Backends of OpenCV that count frames and divide by the nominal rate instead of reading timestamps.
_COUNTING_BACKENDS = ("CV_MJPEG", "CV_IMAGES")

# Streams without a container carry no timestamps; FFmpeg makes up some for a few of them.
_BARE_STREAMS = (".h264", ".264", ".h265", ".265", ".hevc", ".m1v", ".m2v", ".mjpeg", ".mjpg", ".obu", ".av1")


# OpenCV's log level is one for the whole process: the first to ask for quiet keeps what it was, the last restores it.
_quiet_lock = threading.Lock()
_quiet_depth = 0
_loud_level = 0


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep OpenCV from writing to standard error about what we report ourselves."""
    global _quiet_depth, _loud_level
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
    import cv2

    with _quiet_ffmpeg():
        try:
            if isinstance(source, str) and "://" not in source and not source.startswith("/dev/"):
                # A file name must not be taken for a numbered pattern: only FFmpeg and the like may open it.
                capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG)
                return capture if capture.isOpened() else cv2.VideoCapture(source)
            return cv2.VideoCapture(source)
        except cv2.error:
            return cv2.VideoCapture()


class VideoReader:
    """One video file or finite URL, decoded in order."""

    def __init__(self, source: str, limit: int) -> None:
        import cv2

        self.source = source
        self._limit = limit
        self.live = False
        self.exact = False
        self.notes: tuple[str, ...] = ()
        self._capture = self._open()
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.frame_rate: float | None = rate if math.isfinite(rate) and rate > 0 else None
        promised = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self.count: int | None = int(promised) if math.isfinite(promised) and 0 < promised < 2**40 else None
        width = int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.size: tuple[int, int] | None = (width, height) if width > 0 and height > 0 else None
        self._read = 0
        self._given = 0
        self._longest_s = 0.0
        self._last_s = -math.inf
        self._ended = False
        self._buffer: deque[Any] = deque()
        self._waiting_s: list[float] = []
        self._delay = self._probe(self._capture.getBackendName())

    def _open(self) -> Any:
        capture = open_capture(self.source)
        if not capture.isOpened():
            size = f" ({Path(self.source).stat().st_size} bytes)" if Path(self.source).exists() else ""
            raise CaptureError(
                f"{self.source}{size}: cannot be opened as a video: missing, truncated, damaged, "
                "or of a format that OpenCV cannot read"
            )
        return capture

    def _probe(self, backend: str) -> int:
        """Look at the first timestamps: find out what they are worth and how far they are out of order."""
        import cv2

        times: list[float] = []
        with quiet():
            while len(times) < _PROBE_FRAMES and self._capture.grab():
                if not times:
                    # A picture that the file asks to be turned is turned; the header's size is that before.
                    done, image = self._capture.retrieve()
                    self.size = (image.shape[1], image.shape[0]) if done else self.size
                times.append(float(self._capture.get(cv2.CAP_PROP_POS_MSEC)))
        self._capture.release()
        if not times:
            raise CaptureError(f"{self.source}: the video holds no frame that can be decoded")
        self._capture = self._open()
        self.timestamps: Timestamps = "file"
        bare = Path(self.source).suffix.lower() in _BARE_STREAMS
        if bare or backend in _COUNTING_BACKENDS or (len(times) > 1 and max(times) <= times[0]):
            self.timestamps = "rate" if self.frame_rate is not None else "none"
            return 0
        rank = {position: place for place, position in enumerate(sorted(range(len(times)), key=times.__getitem__))}
        delay = max(position - place for position, place in rank.items())
        if delay > 0:
            self.notes = (
                f"{self.source}: its timestamps go back and forth by up to {delay} frames although its pictures are in "
                "order: the sorted timestamps are used",
            )
            # Two more than seen, since the order may be worse further on.
            return delay + 2
        return 0

    def _grab(self, wanted: bool) -> None:
        """Decode one more frame into the buffer, or note the end."""
        import cv2

        if not self._capture.grab():
            self._ended = True
            return
        index = self._read
        self._read += 1
        if self.timestamps == "file":
            t_s = round(float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3, 9)
        elif self.timestamps == "rate" and self.frame_rate:
            t_s = index / self.frame_rate
        else:
            t_s = math.nan
        image = None
        # With reordered timestamps frames are read before it is known whether they are wanted.
        if wanted or self._delay:
            ok, image = self._capture.retrieve()
            if not ok:
                raise CaptureError(f"{self.source}: frame {index} cannot be decoded")
        self._buffer.append(image)
        heapq.heappush(self._waiting_s, t_s)

    def read(self, wanted: bool) -> Raw | None:
        """Give the next frame with its timestamp."""
        while not self._ended and len(self._buffer) <= self._delay:
            self._grab(wanted)
        if not self._buffer:
            self._check_complete()
            return None
        image = self._buffer.popleft()
        t_s = heapq.heappop(self._waiting_s)
        if self._given:
            self._longest_s = max(self._longest_s, t_s - self._last_s)
        self._last_s = t_s
        raw = Raw(image, t_s, self._given)
        self._given += 1
        return raw

    def _check_complete(self) -> None:
        """Raise where the container promised more than it gave.

        Its count is exact in some formats and duration times rate in others, where dropped frames count too: the file
        is complete if either the frames or the time are there, within the longest pause between two frames.
        """
        if self.count is None or self.frame_rate is None or self._given >= self.count - 2:
            return
        duration_s = self.count / self.frame_rate
        slack_s = max(3.0 / self.frame_rate, 2.0 * self._longest_s)
        if math.isnan(self._last_s) or self._last_s + slack_s >= duration_s:
            return
        raise CaptureError(
            f"{self.source}: the video is truncated: it ends after frame {self._given - 1} at {self._last_s:.3f} s, "
            f"its header promises {self.count} frames and {duration_s:.3f} s"
        )

    def close(self) -> None:
        """Release the file."""
        self._ended = True
        self._buffer.clear()
        self._waiting_s.clear()
        self._capture.release()
