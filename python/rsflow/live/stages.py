"""The two threads of a live run: the motion between frames in one, what moves and the velocity in the other.

docs/how-to/live.md, section "How late the figures are".
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .._beside import share_threads
from ..extraction.probe import enough
from .frame import LiveFrame
from .meter import Delays, Rate
from .reading import reading

if TYPE_CHECKING:
    from ..capture.stream import Frame, Frames
    from ..extraction.pipeline import Measured, Pipeline

__all__ = ["Stages"]


@dataclass(frozen=True)
class _Pair:
    """A frame with its motion since the one before."""

    frame: Frame
    shift: Any
    flow: Any
    after_gap: bool
    # It waited until it was known whether the camera moves.
    held: bool = False


class _Slot:
    """Room for one item between two threads."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._item: _Pair | None = None
        self._closed = False

    def wait_free(self) -> bool:
        """Wait until the last item is taken; False where nothing is taken any more."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is None or self._closed)
            return not self._closed

    def put(self, item: _Pair) -> bool:
        """Put an item when there is room; False where nothing is taken any more."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is None or self._closed)
            if self._closed:
                return False
            self._item = item
            self._changed.notify_all()
            return True

    def take(self) -> _Pair | None:
        """Wait for an item; None after the last one."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None or self._closed)
            item, self._item = self._item, None
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Take no further items; one that is there is still given."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class Stages:
    """Measure the frames of a stream until its end or `stop`.

    A live source is asked for its newest frame when the second thread is free to take it, so that none waits.

    Parameters
    ----------
    stream : Frames
    pipeline : Pipeline
    take : callable
        Called with each `LiveFrame`, in order, in the second thread; False ends the run.
    probe : bool
        Hold the first frames back to see whether the camera moves.
    """

    def __init__(self, stream: Frames, pipeline: Pipeline, take: Callable[[LiveFrame], bool], *, probe: bool) -> None:
        self.done = threading.Event()
        self.failure: BaseException | None = None
        self.delays = Delays()
        self.frames = self.not_measured = self.gaps = 0
        self.last_frame_s = time.monotonic()
        self._stream, self._pipeline, self._take = stream, pipeline, take
        self._held: list[_Pair] = []
        self._settled = False
        self._probe = probe
        self._stopping = False
        self._slot = _Slot()
        self._rate = Rate()
        self._last_index: int | None = None
        self._first = threading.Thread(target=self._measure_all, name="rsflow-live-measure", daemon=True)
        self._second = threading.Thread(target=self._finish_all, name="rsflow-live-separate", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._second.start()
        self._first.start()

    def stop(self) -> None:
        """End after the frame at hand."""
        self._stopping = True
        if self._stream.live:
            # Whoever waits for a camera wakes up.
            self._stream.close()

    def join(self, timeout_s: float) -> bool:
        """Wait until both threads have ended; False where one of them has not."""
        end = time.monotonic() + timeout_s
        for thread in (self._first, self._second):
            thread.join(max(0.0, end - time.monotonic()))
        return not (self._first.is_alive() or self._second.is_alive())

    def _fail(self, error: BaseException) -> None:
        self.failure = self.failure or error
        self._stopping = True

    def _measure_all(self) -> None:
        gaps = 0
        share_threads()
        try:
            for frame in self._stream:
                if self._stopping:
                    break
                self.last_frame_s = time.monotonic()
                after_gap, gaps = self._stream.gaps > gaps, self._stream.gaps
                pair = _Pair(frame, *self._pipeline.measure(frame, after_gap=after_gap), after_gap)
                if not self._hand_over(pair) or not self._slot.wait_free():
                    break
        except BaseException as error:
            self._fail(error)
        try:
            self._settle()
        except BaseException as error:
            self._fail(error)
        finally:
            self._slot.close()

    def _hand_over(self, pair: _Pair) -> bool:
        if self._settled:
            return self._slot.put(pair)
        self._held.append(pair)
        wanted = self._probe and not enough([(held.frame, held.shift, held.flow) for held in self._held])
        return True if wanted else self._settle()

    def _settle(self) -> bool:
        """Decide whether the camera moves, and hand over the frames that waited for it."""
        if self._settled or not self._held:
            return True
        self._settled = True
        held, self._held = self._held, []
        self._pipeline.settle([(pair.shift, pair.flow) for pair in held], held[0].frame.image.shape[1])
        waited = len(held) > 1
        return all(
            self._slot.put(_Pair(pair.frame, pair.shift, pair.flow, pair.after_gap, held=waited)) for pair in held
        )

    def _finish_all(self) -> None:
        share_threads()
        try:
            while (pair := self._slot.take()) is not None:
                measured = self._pipeline.finish(pair.frame, pair.shift, pair.flow, after_gap=pair.after_gap)
                if not self._take(self._told(pair, measured)):
                    self.stop()
                    break
        except BaseException as error:
            self._fail(error)
            self.stop()
        finally:
            self._slot.close()
            self.done.set()

    def _told(self, pair: _Pair, measured: Measured) -> LiveFrame:
        now_s = time.monotonic()
        frame, live = pair.frame, self._stream.live
        delay_s = now_s - frame.t_s if live and not pair.held else math.nan
        self.delays.add(delay_s)
        self.frames += 1
        self.gaps += pair.after_gap
        if live and self._last_index is not None:
            self.not_measured += max(0, frame.index - self._last_index - 1)
        self._last_index = frame.index
        told = None
        if pair.shift is not None:
            dt_s = measured.motion["dt_s"]
            told = reading(frame, dt_s, measured.motion, measured.velocity, self._pipeline.ground)
        return LiveFrame(
            measured=measured,
            reading=told,
            delay_s=delay_s,
            frame_rate_hz=self._rate.add(now_s),
            not_measured=self.not_measured,
            after_gap=pair.after_gap,
        )
