"""The search for a board in a process of its own, so that a search without end can be stopped.

OpenCV's search for a chessboard can take minutes on a picture full of squares, and no call into it can be interrupted
(opencv#23558). A process can: it is killed when the time is over, and the next picture gets a new one.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import struct
import subprocess
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from .board import Board
from .detect import Corners, find_corners

_LENGTH = struct.Struct("<Q")

# Time that a new process may take to start and import OpenCV, in seconds; it does not count as search.
_START_S = 60.0


class SearchTimeoutError(Exception):
    """The search took longer than its time; the message says how long."""


class Searcher:
    """Finds boards one picture at a time, within a time."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def find(self, image: NDArray[np.uint8], board: Board, seconds: float) -> Corners | None:
        """Find the corners of a board.

        Raises
        ------
        SearchTimeoutError
            If the search has not ended after `seconds`.
        CalibrationError
            If the search itself fails.
        """
        process = self._started()
        assert process.stdin is not None
        try:
            _send(process.stdin, (np.ascontiguousarray(image), board))
        except OSError:
            self.close()
            raise CalibrationError("the search for the board ended unexpectedly") from None
        try:
            answer = self._answers.get(timeout=max(seconds, 0.001))
        except queue.Empty:
            self.close()
            raise SearchTimeoutError(f"the search took longer than {seconds:.3g} s") from None
        if isinstance(answer, Corners) or answer is None:
            return answer
        self.close()
        raise CalibrationError(f"the search for the board failed: {answer}")

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._process.poll() is None:
            return self._process
        # The same modules as here, wherever they are from; no site of the user's is run twice.
        code = f"import sys; sys.path[:] = {sys.path!r}; from rsflow.calibration.detect_process import serve; serve()"
        # In a session of its own: Ctrl-C is for us to handle.
        process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._process = process
        self._answers = queue.SimpleQueue()
        threading.Thread(target=_receive, args=(process.stdout, self._answers), daemon=True).start()
        try:
            ready = self._answers.get(timeout=_START_S)
        except queue.Empty:
            ready = "it did not start"
        if ready != "ready":
            self.close()
            raise CalibrationError(f"the process that searches for boards cannot run: {sys.executable}: {ready}")
        return process

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _send(pipe: BinaryIO | Any, value: Any) -> None:
    data = pickle.dumps(value, protocol=5)
    pipe.write(_LENGTH.pack(len(data)))
    pipe.write(data)
    pipe.flush()


def _read(pipe: BinaryIO | Any) -> Any:
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    return pickle.loads(pipe.read(_LENGTH.unpack(head)[0]))


def _receive(pipe: Any, answers: queue.SimpleQueue[Any]) -> None:
    """Hand on what the process says, until it ends."""
    try:
        while True:
            answers.put(_read(pipe))
    except (EOFError, OSError, ValueError, pickle.UnpicklingError):
        answers.put("the process ended")


def serve() -> None:
    """Answer searches from standard input until it closes: the body of the process."""
    output = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # Whatever a library prints must not get among the answers.
    with Path(os.devnull).open("wb") as nothing:
        os.dup2(nothing.fileno(), sys.stdout.fileno())
    import cv2

    cv2.setNumThreads(1)
    _send(output, "ready")
    while True:
        try:
            image, board = _read(sys.stdin.buffer)
        except EOFError:
            return
        try:
            answer: Any = find_corners(image, board)
        except Exception as error:
            answer = f"{type(error).__name__}: {error}"
        _send(output, answer)
