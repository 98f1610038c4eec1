"""A file, pictures or arrays at their own pace, as a live camera gives them: to rehearse what a camera will need."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from typing import TYPE_CHECKING

from ..errors import OptionError
from ..io.fork_guard import OfProcess
from .reader import Raw, Reader, Timestamps

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["PacedReader"]

# Frames kept for a reader that wants all of them.
_QUEUE_FRAMES = 32
# Of a source that cannot be read as fast as it plays, the rest is played later once it lags by so many seconds.
_LAG_S = 0.1


class PacedReader(OfProcess):
    """Frames of another reader, each when its time has come, read in a thread of their own.

    Parameters
    ----------
    inner : Reader
        What to play; closed by `close`.
    times : array, optional
        Time in seconds of each frame.
    frame_rate : float, optional
        Frames per second, where the frames have no times.
    newest : bool
        Drop the older frames that nobody has taken.

    Raises
    ------
    OptionError
        If nothing says when the frames were taken.
    """

    def __init__(
        self, inner: Reader, *, times: NDArray[np.float64] | None, frame_rate: float | None, newest: bool
    ) -> None:
        if times is None and frame_rate is None and inner.timestamps == "none":
            raise OptionError(
                f"real_time: got True, expected frame_rate= with it: {inner.source} has no times of its own"
            )
        self.source, self.size = inner.source, inner.size
        self.frame_rate = inner.frame_rate if frame_rate is None else frame_rate
        self.count: int | None = inner.count
        self.timestamps: Timestamps = "clock"
        self.live = True
        self.exact = False
        self._inner, self._times, self._rate = inner, times, frame_rate
        self._queue: deque[Raw] = deque(maxlen=1 if newest else None)
        self._newest = newest
        self._changed = threading.Condition()
        self._stopped = self._ended = False
        self._failure: BaseException | None = None
        self._thread: threading.Thread | None = None

    @property
    def lost(self) -> int:
        """Pictures that the decoder could not give, of those read so far."""
        return self._inner.lost

    @property
    def notes(self) -> tuple[str, ...]:
        """Peculiarities of what is played."""
        return self._inner.notes

    def _run(self) -> None:
        """Give each frame at its time; the clock begins with the first one."""
        start_s = math.nan
        try:
            while not self._stopped and (raw := self._inner.read(True)) is not None:
                own_s = self._own_time(raw)
                if math.isnan(start_s):
                    start_s = time.monotonic() - own_s
                due_s = start_s + own_s
                with self._changed:
                    self._changed.wait_for(lambda: self._stopped, timeout=max(0.0, due_s - time.monotonic()))
                late_s = time.monotonic() - due_s
                if late_s > _LAG_S:
                    start_s += late_s
                    due_s += late_s
                self._put(Raw(raw.image, due_s, raw.index, raw.name))
        except BaseException as error:
            self._failure = error
        finally:
            self._inner.close()
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _own_time(self, raw: Raw) -> float:
        if self._rate is not None:
            return raw.index / self._rate
        if self._times is not None:
            if raw.index >= len(self._times):
                raise OptionError(
                    f"times: got {len(self._times)} times, expected one for each frame: {self.source} has a frame "
                    f"{raw.index}"
                )
            return float(self._times[raw.index])
        if not math.isfinite(raw.t_s):
            raise OptionError(f"real_time: {self.source}, frame {raw.index}: got no time, expected one")
        return raw.t_s

    def _put(self, raw: Raw) -> None:
        with self._changed:
            if not self._newest:
                self._changed.wait_for(lambda: self._stopped or len(self._queue) < _QUEUE_FRAMES)
            self._queue.append(raw)
            self._changed.notify_all()

    def read(self, wanted: bool) -> Raw | None:
        """Wait for the next frame; the play begins with the first call."""
        self._expect_here(self.source)
        if self._thread is None and not self._stopped:
            self._thread = threading.Thread(target=self._run, name="rsflow-pace", daemon=True)
            self._thread.start()
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._ended or self._stopped)
            if self._stopped:
                return None
            if self._queue:
                raw = self._queue.popleft()
                self._changed.notify_all()
                return raw
        if self._failure is not None:
            raise self._failure
        return None

    def close(self) -> None:
        """Stop the play."""
        if self._elsewhere:
            return
        with self._changed:
            self._stopped = True
            self._queue.clear()
            self._changed.notify_all()
        if self._thread is None:
            self._inner.close()
        elif threading.current_thread() is not self._thread:
            self._thread.join(timeout=1.0)
