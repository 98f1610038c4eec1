"""What a live run is shown by: a window, a page for browsers, a recording, or nothing."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from .. import _checks
from .._results.inputs import Inputs
from ..errors import OptionError
from ..extraction.claim import input_files

if TYPE_CHECKING:
    from ..capture.stream import Frames
    from ..extraction.settings import ExtractSettings
    from .frame import LiveFrame
    from .viewing.outputs import FileOutput, ServerOutput
    from .viewing.viewer import Viewer

__all__ = ["Showing"]

# Of the page for browsers, as the viewer's own; its data has the next one.
DEFAULT_PORT = 9090
_EVERYWHERE = "0.0.0.0"
# How long what waits may take to be shown when the run ends, and how often a window is looked after.
_LAST_PICTURE_S, _LOOK_S = 5.0, 0.1


class Showing:
    """What a live run is shown by; made by `watch`.

    Attributes
    ----------
    pages : tuple of str
        Addresses of the page for browsers, the one for other machines first; empty without ``serve``.
    record : Path or None
        The recording.

    Examples
    --------
    >>> told = []
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=2, seed=1)
    >>> done = rsflow.live.watch(flight, on_open=lambda showing: told.append((showing.pages, showing.record)))
    >>> told
    [((), None)]
    """

    def __init__(self, *, view: bool, serve: tuple[str, int] | None, record: Path | None, rate_hz: float) -> None:
        self._view, self._serve, self.record, self._rate_hz = view, serve, record, rate_hz
        self.pages: tuple[str, ...] = ()
        self._server: ServerOutput | None = None
        self._file: FileOutput | None = None
        self._viewer: Viewer | None = None
        self._shown_notes: set[str] = set()
        self._failures: list[str] = []
        self._drained = False

    @classmethod
    def asked(cls, *, view: Any, serve: Any, record: Any, rate_hz: Any) -> Self:
        """Check what is asked for."""
        return cls(
            view=_checks.flag("view", view),
            serve=None if serve is None else _served_at(serve),
            record=None if record is None else _checks.path("record", record),
            rate_hz=_checks.number("view_rate_hz", rate_hz, least=0.01, most=1000, of="pictures per second"),
        )

    def __bool__(self) -> bool:
        return self._view or self._serve is not None or self.record is not None

    def expect_new(self, source: Any, settings: ExtractSettings, *, overwrite: bool) -> None:
        """Raise OptionError where a recording would be written over something, or cannot be one."""
        if self.record is None:
            return
        if self.record.suffix.lower() != ".rrd":
            raise _checks.refused("record", str(self.record), "a name that ends in .rrd, as the viewer reads it")
        Inputs(source, files=input_files(settings)).refuse([self.record])
        if self.record.exists() and not overwrite:
            raise OptionError(f"record: got {self.record}, expected a new file, or overwrite (--overwrite)")

    def start(self, stream: Frames, *, velocity: bool) -> None:
        """Open all of it for the frames of a stream."""
        if not self:
            return
        from .viewing import Viewer
        from .viewing.layout import blueprint
        from .viewing.outputs import FileOutput, ServerOutput, import_rerun

        rr, rrb = import_rerun()
        name = f"rsflow live: {stream.source}"
        parts = {"velocity": velocity, "live": stream.live}
        if self.record is not None:
            self._file = FileOutput(rr, blueprint(rrb, follow=False, **parts), name, self.record)
        if self._view or self._serve is not None:
            self._server = ServerOutput(rr, blueprint(rrb, follow=stream.live, **parts), name, self._serve)
            self.pages = tuple(self._server.pages)
            if self._view:
                self._server.open_viewer()
        outputs = [output for output in (self._file, self._server) if output is not None]
        self._viewer = Viewer(
            rr, outputs, source=stream.source, velocity=velocity, live=stream.live, rate_hz=self._rate_hz
        )

    def offer(self, frame: LiveFrame) -> None:
        """Show a frame, if anything does; never waits for long."""
        if self._viewer is None:
            return
        for note in () if frame.reading is None else frame.reading.notes:
            if note not in self._shown_notes:
                self._shown_notes.add(note)
                self._viewer.note(note)
        if frame.after_gap:
            self._viewer.note(f"frame {frame.measured.frame.index}: the source was away")
        self._viewer.offer(frame)

    @property
    def not_shown(self) -> int:
        """Pictures that were to be shown and that nobody was ready for."""
        return 0 if self._viewer is None else self._viewer.not_shown

    @property
    def notes(self) -> tuple[str, ...]:
        """What happened to it, one sentence each."""
        return (*(() if self._viewer is None else self._viewer.notes), *self._failures)

    def linger(self, goes_on: Callable[[], bool]) -> None:
        """Stay open for who comes late, until the window is closed or `goes_on` says no."""
        if self._server is None or self._viewer is None:
            return
        self._drain()
        self._failures.append("all is measured; it is shown until Ctrl-C" + (" or the window's end" * self._view))
        window = self._server.process
        while goes_on() and (window is None or window.poll() is None):
            time.sleep(_LOOK_S)

    def _drain(self) -> None:
        """Show what waits, once."""
        if self._viewer is None or self._drained:
            return
        self._drained = True
        if not self._viewer.close(_LAST_PICTURE_S):
            self._failures.append("the viewer did not take the last pictures")
        if self._viewer.failure is not None:
            self._failures.append(f"the showing ended early: {self._viewer.failure}")

    def close(self, *, keep: bool = True) -> dict[str, Path]:
        """Show what waits and close all of it; give what was written."""
        self._drain()
        files = self.close_recording(keep=keep)
        if self._server is not None:
            self._server.close()
            self._server = None
        return files

    def close_recording(self, *, keep: bool) -> dict[str, Path]:
        """Show what waits and name the recording; give it."""
        self._drain()
        files = {}
        if self._file is not None:
            if keep:
                try:
                    self._file.close()
                except OSError as error:
                    self._failures.append(f"{error.filename}: {error.strerror}")
                if self._file.kept is not None:
                    files["recording"] = self._file.kept
            else:
                self._file.discard()
            self._file = None
        return files

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(Exception):
            self.close(keep=False)


def _served_at(serve: Any) -> tuple[str, int]:
    """Give address and port of ``PORT`` or ``HOST:PORT``."""
    expected = "a port from 1 to 65534, or HOST:PORT"
    host, port = _EVERYWHERE, serve
    if isinstance(serve, str):
        head, colon, tail = serve.rpartition(":")
        host, port = (head, tail) if colon else (_EVERYWHERE, tail)
        if not (port.isascii() and port.isdigit() and host):
            raise _checks.refused("serve", serve, expected)
        port = int(port)
    return host, _checks.integer("serve", port, least=1, most=65534)
