"""Where a live run is shown: a server that viewers connect to, and a recording in a file."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote

from ..._extras import require
from ...errors import CaptureError, OptionError
from ...extraction.file_names import partial_name
from ...io.atomic import Working

__all__ = ["APPLICATION", "FileOutput", "Output", "ServerOutput", "has_screen", "import_rerun", "new_stream"]

APPLICATION = "rsflow_live"
# What late viewers are given of the past, in memory of this process.
_SERVED = "256MiB"
# A recording ends while the disk has so much left, so that tables can be written to their end.
_LEAST_FREE_BYTES = 64 << 20
# How long what is logged may take to be written, and a recording to be closed.
_FLUSH_S = 2.0
_CLOSING_S = 20.0


def import_rerun() -> tuple[Any, Any]:
    """Give ``rerun`` and ``rerun.blueprint``, kept from writing to standard error what is reported here.

    Raises
    ------
    MissingExtraError
        If the viewer is not installed.
    """
    with _quiet_logs():
        rr = require("rerun", extra="viewer", purpose="showing or recording live figures")
        if not hasattr(rr, "GrpcServerSink"):
            # The package `rerun` of the index is another's program.
            raise OptionError(
                "rerun: got a package of that name that is not the viewer's, or too old a one, expected rerun-sdk 0.41 "
                "or newer: pip install 'rsflow-motion[viewer]'"
            )
        return rr, require("rerun.blueprint", extra="viewer", purpose="showing or recording live figures")


@contextlib.contextmanager
def _quiet_logs() -> Iterator[None]:
    """Let the viewer's library log errors alone, unless the user said what to log; it looks once, at its import."""
    set_here = "RUST_LOG" not in os.environ
    if set_here:
        os.environ["RUST_LOG"] = "off"
    try:
        yield
    finally:
        if set_here:
            os.environ.pop("RUST_LOG", None)


def has_screen() -> bool:
    """Whether a window can be opened here."""
    if sys.platform.startswith(("linux", "freebsd")):
        return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return True


def new_stream(rr: Any, name: str, *, lag_s: float) -> Any:
    """Make a stream of log messages, which are sent at least every `lag_s` seconds."""
    stream = rr.RecordingStream(APPLICATION, batcher_config=rr.ChunkBatcherConfig(flush_tick=lag_s))
    with contextlib.suppress(Exception):
        stream.send_recording_name(name)
    return stream


class Output(Protocol):
    """Where messages go. `check` gives what to know of it, once, and `open` is False when nothing more is taken."""

    stream: Any
    open: bool

    def check(self) -> str | None:
        """Look whether it still can be written to."""

    def close(self) -> None:
        """Complete it."""


class ServerOutput:
    """A server in this process: viewers, native or in a browser, come and go, and a slow one is nobody's concern.

    Parameters
    ----------
    rr, layout : modules and values of Rerun
    name : str
        Of the recording.
    serve : (str, int) or None
        Address and port of the page for browsers; the data has the next port. None: for a viewer of this machine.
    """

    def __init__(self, rr: Any, layout: Any, name: str, serve: tuple[str, int] | None) -> None:
        self.open = True
        self.pages: list[str] = []
        self.process: subprocess.Popen[bytes] | None = None
        self._viewer_is_told = False
        host, web_port = ("127.0.0.1", 0) if serve is None else serve
        port = _free_port(host) if serve is None else web_port + 1
        origins = None
        if serve is not None:
            _expect_free(host, web_port)
            _expect_free(host, port)
            origins = [f"http://*:{web_port}"]
        self.stream = new_stream(rr, name, lag_s=0.05)
        sink = rr.GrpcServerSink(
            bind_ip=_address(host), port=port, server_memory_limit=_SERVED, cors_allow_origin=origins
        )
        self.stream.set_sinks(sink, default_blueprint=layout)
        self.uri = f"rerun+http://127.0.0.1:{port}/proxy"
        if serve is not None:
            rr.serve_web_viewer(web_port=web_port, open_browser=False)
            self.pages = [_page(name, web_port) for name in _names(host)]

    def open_viewer(self) -> None:
        """Open a window that shows it.

        Raises
        ------
        OptionError
            If there is no screen.
        """
        if not has_screen():
            raise OptionError(
                "view: got True without a screen, expected one: serve it to a browser of another machine (--serve), or "
                "record it (--record FILE.rrd) and open that elsewhere"
            )
        # What it listens to by itself is nobody's concern elsewhere.
        alone = ["--port", "auto", "--bind", "127.0.0.1"]
        command = [sys.executable, "-m", "rerun", self.uri, *alone, "--memory-limit", "25%"]
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip

    def check(self) -> str | None:
        """Tell once that the window was closed, or did not open."""
        if self.process is None or self._viewer_is_told or self.process.poll() is None:
            return None
        self._viewer_is_told = True
        if self.process.returncode:
            return f"the viewer ended with exit code {self.process.returncode}: try --serve, which needs no window here"
        return "the viewer was closed; the run goes on"

    def close(self) -> None:
        """Send what is left and stop to serve; a window that is open keeps what it has."""
        self.open = False
        _within(lambda: self.stream.flush(timeout_sec=2.0), 3.0)
        _within(self.stream.disconnect, 3.0)


class FileOutput:
    """A recording, grown hidden beside its name and given it when it is closed.

    Parameters
    ----------
    rr, layout : modules and values of Rerun
    name : str
        Of the recording.
    path : Path

    Raises
    ------
    OSError
        If the file cannot be written.
    """

    def __init__(self, rr: Any, layout: Any, name: str, path: Path) -> None:
        self.open = True
        self.kept: Path | None = None
        self._rr, self._path = rr, path
        self._late = 0
        self._working = Working(path)
        self.stream = new_stream(rr, name, lag_s=0.25)
        try:
            self.stream.set_sinks(rr.FileSink(str(self._working.path)), default_blueprint=layout)
        except BaseException:
            self._working.discard()
            raise

    def check(self) -> str | None:
        """End the recording where the disk is nearly full or what is written gets lost, and say so."""
        if not self.open:
            return None
        try:
            free = shutil.disk_usage(self._working.path.parent).free
        except OSError:
            free = _LEAST_FREE_BYTES
        if free < _LEAST_FREE_BYTES:
            self._end(whole=True)
            return f"{self._path}: the recording ends here, as the disk is nearly full ({free >> 20} MB left)"
        if self._failed():
            self._end(whole=False)
            return f"{self._path}: the recording broke off: it cannot be written to any more; see {self.kept}"
        return None

    def _failed(self) -> bool:
        """Whether the thread that writes has given up."""
        try:
            # One that is not waited for stays for ever where the writer has ended.
            self.stream.flush(timeout_sec=_FLUSH_S)
        except Exception as error:
            # A slow disk is none that is full, but it is not that slow twice.
            self._late += 1
            return self._late > 1 or "timed out" not in str(error).lower()
        self._late = 0
        return False

    def _end(self, *, whole: bool) -> None:
        """Close the file and name it, as partial one where its end is missing."""
        self.open = False
        ended = _within(self.stream.disconnect, _CLOSING_S if whole else _FLUSH_S)
        if not ended:
            # A writer that has given up may never answer: nobody waits for it, at the interpreter's end either.
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.stream))
            self._rr.unregister_shutdown()
        whole = whole and ended
        try:
            self.kept = self._working.keep(self._path if whole else partial_name(self._path))
        except OSError:
            self._working.discard()

    def close(self) -> None:
        """Complete the recording.

        Raises
        ------
        OSError
            If it could not be written to its end; what is there is kept under its partial name.
        """
        if not self.open:
            return
        failed = False

        def flush() -> None:
            nonlocal failed
            try:
                self.stream.flush(timeout_sec=_CLOSING_S)
            except Exception:
                failed = True

        failed = not _within(flush, _CLOSING_S + 1.0) or failed
        self._end(whole=not failed)
        if failed or self.kept is None:
            raise OSError(errno.EIO, "the recording could not be written to its end", str(self._path))

    def discard(self) -> None:
        """Leave nothing; harmless after `close`."""
        if self.open:
            self.open = False
            _within(self.stream.disconnect, _CLOSING_S)
            self._working.discard()


def _within(call: Callable[[], object], seconds: float) -> bool:
    """Call in a thread that may be left behind; whether it came back in time."""
    done = threading.Event()

    def run() -> None:
        with contextlib.suppress(Exception):
            call()
        done.set()

    threading.Thread(target=run, name="rsflow-live-close", daemon=True).start()
    return done.wait(seconds)


def _address(host: str) -> str:
    """Give the number of an address: names are not taken."""
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise OptionError(f"serve: got {host!r}, expected an address of this machine: {error}") from None


def _free_port(host: str) -> int:
    with socket.socket() as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


def _expect_free(host: str, port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_address(host), port))
        except OSError as error:
            why = "it is in use" if error.errno == errno.EADDRINUSE else os.strerror(error.errno or 0)
            raise CaptureError(
                f"serve: port {port} cannot be had: {why}; choose another (the page has that one, its data the next)"
            ) from None


def _names(host: str) -> list[str]:
    """Under which names browsers reach a server that listens to `host`: this machine's own last."""
    if host != "0.0.0.0":
        return [host]
    return list(dict.fromkeys([socket.gethostname() or "localhost", "localhost"]))


def _page(host: str, web_port: int) -> str:
    data = f"rerun+http://{host}:{web_port + 1}/proxy"
    return f"http://{host}:{web_port}/?url={quote(data, safe='')}"
