"""A live camera or stream: the newest frame, the clock's time, and what happens when it goes away."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import CaptureError
from ..io.fork_guard import OfProcess
from ..io.opencv_files import open_capture, quiet
from ..io.picture_names import natural_key
from .gaps import GapRule
from .reader import Raw, Timestamps

# Frames kept for a reader that wants all of them: beyond, the camera's own driver drops.
_QUEUE_FRAMES = 32

# Pause before the first attempt to open a source that went away, in seconds; each later one is twice as long, up to the
# last. A camera that is put in again is found within that time.
_RETRY_S, _LONGEST_RETRY_S = 0.2, 2.0


class LiveReader(OfProcess):
    """Frames grabbed in a thread of their own, so that waiting has an end even where the driver's call has none."""

    def __init__(
        self,
        source: int | str,
        *,
        newest: bool,
        timeout_s: float,
        camera_size: tuple[int, int] | None,
        reconnect_s: float | None = None,
        opener: Callable[[int | str], Any] = open_capture,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.source = f"camera {source}" if isinstance(source, int) else source
        self.count: int | None = None
        self.timestamps: Timestamps = "clock"
        self.live = True
        self.exact = False
        self.lost = 0
        self._device = source
        self._timeout_s = timeout_s
        self._reconnect_s = timeout_s if reconnect_s is None else reconnect_s
        self._camera_size = camera_size
        self._opener = opener
        self._clock = clock
        self._changed = threading.Condition()
        self._queue: deque[Raw] = deque(maxlen=1 if newest else None)
        self._newest = newest
        self._stopped = False
        self._failure: str | None = None
        self._grabbed = 0
        self.reconnects = 0
        self._gaps = GapRule()
        self._reopened = False
        capture = self._opened()
        if capture is None:
            raise CaptureError(
                f"{self.source}: cannot be opened: no such camera or stream, or it is in use{_there_are(source)}"
            )
        self.size, self.frame_rate = _properties(capture)
        self._thread = threading.Thread(target=self._run, args=(capture,), name="rsflow-capture", daemon=True)
        self._thread.start()

    @property
    def notes(self) -> tuple[str, ...]:
        """Say how often the source had to be opened again."""
        return (f"{self.source}: opened again {self.reconnects} times",) if self.reconnects else ()

    def _opened(self) -> Any:
        """Open the source; None where that fails."""
        capture = self._opener(self._device)
        if not capture.isOpened():
            capture.release()
            return None
        if self._camera_size is not None:
            import cv2

            capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._camera_size[0])
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._camera_size[1])
        return capture

    def _run(self, capture: Any) -> None:
        """Grab until stopped; reopen a source that fails. The capture is used and released in this thread alone."""
        pause_s = _RETRY_S
        try:
            while not self._stopped:
                ok = False
                if capture is not None:
                    with quiet():
                        ok = bool(capture.grab())
                    t_s = self._clock()
                    if ok:
                        ok, image = capture.retrieve()
                if ok:
                    pause_s = _RETRY_S
                    self._gaps.take(t_s, reopened=self._reopened)
                    self._reopened = False
                    self._put(Raw(image, t_s, self._grabbed, gaps=self._gaps.count))
                    continue
                if capture is not None:
                    capture.release()
                    capture = None
                with self._changed:
                    self._changed.wait_for(lambda: self._stopped, timeout=pause_s)
                pause_s = min(2 * pause_s, _LONGEST_RETRY_S)
                if not self._stopped:
                    capture = self._opened()
                    self._reopened = self._reopened or capture is not None
                    self.reconnects += capture is not None
        except Exception as error:
            with self._changed:
                self._failure = f"{type(error).__name__}: {error}"
                self._changed.notify_all()
        finally:
            if capture is not None:
                with contextlib.suppress(Exception):
                    capture.release()

    def _put(self, raw: Raw) -> None:
        with self._changed:
            self._grabbed += 1
            if not self._newest:
                self._changed.wait_for(lambda: self._stopped or len(self._queue) < _QUEUE_FRAMES)
            self._queue.append(raw)
            self._changed.notify_all()

    def read(self, wanted: bool) -> Raw | None:
        """Wait for a frame, at most the time-out."""
        self._expect_here(self.source)
        with self._changed:
            timeout_s = self._reconnect_s if self._grabbed else self._timeout_s
            self._changed.wait_for(lambda: self._queue or self._failure or self._stopped, timeout=timeout_s)
            if self._queue:
                raw = self._queue.popleft()
                self._changed.notify_all()
                return raw
            if self._stopped:
                return None
            if self._failure is not None:
                raise CaptureError(f"{self.source}: went away: {self._failure}")
        seen = f"after frame {self._grabbed - 1}" if self._grabbed else "and never gave one"
        raise CaptureError(f"{self.source}: gave no frame for {timeout_s:g} s {seen}: it went away or hangs")

    def close(self) -> None:
        """Stop the thread and release the camera."""
        if self._elsewhere:
            # The thread is the parent's, and may have held the lock.
            return
        with self._changed:
            self._stopped = True
            self._queue.clear()
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            # A driver's call that hangs must not hang us: the daemon thread releases the camera when it returns.
            self._thread.join(timeout=1.0)


def _properties(capture: Any) -> tuple[tuple[int, int] | None, float | None]:
    import cv2

    width, height = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    return ((width, height) if width > 0 and height > 0 else None), (rate if 0 < rate < 1e6 else None)


def _there_are(source: int | str) -> str:
    """Say which cameras the machine has, where it tells."""
    if not isinstance(source, int) or not sys.platform.startswith("linux"):
        return ""
    found = sorted(Path("/dev").glob("video*"), key=natural_key)
    if not found:
        return "; this machine has no camera (there is no /dev/video*)"
    return f"; this machine has {', '.join(map(str, found))}, not all of which give pictures"
