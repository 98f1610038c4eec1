"""The wish of `rsflow.batch` that its workers stop: told by the parent alone, whoever else got the signal."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from multiprocessing import connection
from multiprocessing.context import BaseContext

from ..extraction.stopping import tell, told

__all__ = ["StopWish", "stoppable"]


class StopWish:
    """Asks the workers of a pool to stop, and to stop at once.

    At a terminal Ctrl-C reaches every process of the group; a signal sent by a program reaches the parent alone. So
    workers ignore SIGINT, and in both cases it is the parent's wish that counts.

    Each of the two wishes is a pipe that gets a byte, which nobody takes out: all workers see it, without a lock that
    one of them might hold when it dies. It is readable too when the parent is gone.

    Parameters
    ----------
    context : multiprocessing context
        That of the pool.
    """

    def __init__(self, context: BaseContext) -> None:
        pipes = [context.Pipe(duplex=False) for _ in range(2)]
        self._readers = [reader for reader, _ in pipes]
        self._writers = [writer for _, writer in pipes]
        self._wishes = 0

    def ask(self, wishes: int = 1) -> None:
        """Ask every job to end after the frame at hand and keep what it has; with 2 wishes, to end at once."""
        for writer in self._writers[self._wishes : wishes]:
            writer.send_bytes(b"!")
            self._wishes += 1

    def watch(self) -> None:
        """Prepare a worker, as the initializer of the pool: SIGINT is ignored, the wishes are watched for."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        threading.Thread(target=_watch, args=(self._readers,), name="rsflow-stop", daemon=True).start()

    def __getstate__(self) -> list[connection.Connection]:
        # A worker that had the writers would not see that the parent is gone.
        return self._readers

    def __setstate__(self, readers: list[connection.Connection]) -> None:
        self._readers, self._writers, self._wishes = readers, [], 0


# Held while a job is at hand.
_at_work = threading.Lock()


def _watch(readers: list[connection.Connection]) -> None:
    for reader in readers:
        connection.wait([reader])
        tell()
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        # Nobody takes results any more, nor ends this process.
        _at_work.acquire()
        os._exit(1)


@contextlib.contextmanager
def stoppable() -> Iterator[None]:
    """Do a job; raise KeyboardInterrupt instead if the wish to stop has been told already."""
    with _at_work:
        if told():
            raise KeyboardInterrupt
        yield
