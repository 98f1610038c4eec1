"""Showing a live run in a thread of its own: the figures never wait for it, and it drops what comes too fast."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from . import plots
from .panel import panel_text
from .paths import Paths
from .scene import Scene

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..frame import LiveFrame
    from .outputs import Output

__all__ = ["Viewer"]

# Plots are sent so often, and the text so often, in seconds.
_PLOTS_S, _TEXT_S, _CHECK_S = 0.1, 0.25, 1.0
# Figures that wait to be plotted where the thread is held up: half an hour at 60 frames a second.
_WAITING = 100_000
# Of a live source, drawing takes at most this share of the time, so that the figures have the rest.
_SHARE = 0.4
# How long a source that is no live one waits for a viewer that is not ready, in seconds.
_PATIENCE_S = 2.0


@dataclass(frozen=True)
class _Shown:
    """A frame to be drawn, with the paths up to it."""

    frame: LiveFrame
    paths: dict[int, NDArray[np.float64]]


class Viewer:
    """Log what is shown of each frame to one or more outputs.

    Parameters
    ----------
    rr : module ``rerun``
    outputs : sequence of Output
    source : str
        What is looked at, in words.
    velocity : bool
        With velocities over the ground.
    live : bool
        The source does not wait: pictures that nobody is ready for are dropped, and counted.
    rate_hz : float
        Pictures a second, at most; plots have every frame.
    """

    def __init__(
        self, rr: Any, outputs: Sequence[Output], *, source: str, velocity: bool, live: bool, rate_hz: float
    ) -> None:
        self._rr, self._outputs, self._source, self._live = rr, outputs, source, live
        self._series = plots.series_of(velocity=velocity)
        self._interval_s = 1.0 / rate_hz
        # From the clock of live frames to the time of day.
        self._epoch_s = time.time() - time.monotonic()
        self._scene, self._paths = Scene(), Paths()
        self._changed = threading.Condition()
        self._next: _Shown | None = None
        self._busy = self._closing = False
        self._due_s = -math.inf
        self._rows: deque[tuple[int, float, tuple[tuple[float, ...], ...]]] = deque(maxlen=_WAITING)
        self._notes: list[str] = []
        self._untold: deque[str] = deque()
        self._told: list[str] = []
        #: Pictures that were to be shown and that nobody was ready for.
        self.not_shown = 0
        #: What ended the showing, if something did: the figures go on.
        self.failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="rsflow-live-view", daemon=True)
        self._thread.start()

    @property
    def notes(self) -> tuple[str, ...]:
        """What happened to the outputs."""
        return tuple(self._notes)

    def note(self, text: str) -> None:
        """Show a sentence."""
        self._untold.append(text)

    def offer(self, frame: LiveFrame) -> None:
        """Take the figures of the next frame, and its picture if it is time for one; a live source does not wait."""
        if self.failure is not None:
            return
        seen, own = frame.measured.segmentation, frame.measured.frame
        self._rows.append((own.index, own.t_s, plots.values_of(frame, self._series)))
        self._paths.follow(seen)
        now_s = own.t_s if math.isfinite(own.t_s) else time.monotonic()
        if now_s < self._due_s - 1e-6:
            return
        # On the beat, unless that is long past.
        self._due_s = (
            max(self._due_s + self._interval_s, now_s - self._interval_s)
            if self._due_s > 0
            else (now_s + self._interval_s)
        )
        with self._changed:
            if not self._live:
                self._changed.wait_for(lambda: self._next is None or self._closing, timeout=_PATIENCE_S)
            if self._next is not None:
                self.not_shown += 1
            self._next = _Shown(frame, self._paths.shown())
            self._changed.notify_all()

    def close(self, timeout_s: float) -> bool:
        """Show what waits and end; False where that takes longer."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        text_s = check_s = -math.inf
        try:
            self._log(self._scene.styles(self._rr) + plots.log_styles(self._rr, self._series), static=True)
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._next is not None or self._closing, timeout=_PLOTS_S)
                    shown, self._next = self._next, None
                    ending = self._closing and shown is None
                    self._changed.notify_all()
                begin_s = time.monotonic()
                if begin_s - check_s > _CHECK_S:
                    check_s = begin_s
                    self._check()
                if shown is not None:
                    with_text = begin_s - text_s > _TEXT_S or self._closing or not self._live
                    text_s = begin_s if with_text else text_s
                    self._draw(shown, with_text)
                self._plot()
                if ending:
                    break
                if self._live and not self._closing:
                    # What this thread takes, the figures have not.
                    rest_s = (time.monotonic() - begin_s) * (1 / _SHARE - 1)
                    with self._changed:
                        self._changed.wait_for(lambda: self._closing, timeout=min(rest_s, 1.0))
        except Exception as error:
            self.failure = error

    def _open(self) -> list[Any]:
        return [output.stream for output in self._outputs if output.open]

    def _log(self, entities: Sequence[tuple[str, Any]], *, static: bool = False) -> None:
        for stream in self._open():
            for entity, archetype in entities:
                stream.log(entity, archetype, static=static)

    def _check(self) -> None:
        for output in self._outputs:
            told = output.check()
            if told is not None:
                self._notes.append(told)
                self.note(told)

    def _draw(self, shown: _Shown, with_text: bool) -> None:
        rr, frame = self._rr, shown.frame
        own = frame.measured.frame
        entities = self._scene.entities(rr, frame, shown.paths)
        while self._untold:
            note = self._untold.popleft()
            self._told.append(note)
            entities.append(("notes", rr.TextLog(note)))
        if with_text:
            text = panel_text(
                frame,
                source=self._source,
                zoom=self._scene.zoom,
                not_shown=self.not_shown,
                notes=self._told,
            )
            entities.append(("figures", rr.TextDocument(text, media_type="text/markdown")))
        for stream in self._open():
            stream.set_time(plots.FRAME, sequence=own.index)
            if math.isfinite(own.t_s):
                stream.set_time(plots.TIME, duration=own.t_s)
                if self._live:
                    stream.set_time(plots.CLOCK, timestamp=self._epoch_s + own.t_s)
            for entity, archetype in entities:
                stream.log(entity, archetype)
            if with_text:
                stream.log("timing/not_shown", rr.Scalars(self.not_shown))

    def _plot(self) -> None:
        """Send the figures that wait: a column for each entity."""
        rows = []
        while self._rows:
            rows.append(self._rows.popleft())
        streams = self._open()
        if not rows or not streams:
            return
        rr = self._rr
        indexes = [rr.TimeColumn(plots.FRAME, sequence=[row[0] for row in rows])]
        if all(math.isfinite(row[1]) for row in rows):
            indexes.append(rr.TimeColumn(plots.TIME, duration=[row[1] for row in rows]))
            if self._live:
                indexes.append(rr.TimeColumn(plots.CLOCK, timestamp=[self._epoch_s + row[1] for row in rows]))
        for place, series in enumerate(self._series):
            columns = plots.columns(rr, series, [row[2][place] for row in rows])
            for stream in streams:
                stream.send_columns(series.entity, indexes=indexes, columns=columns)
