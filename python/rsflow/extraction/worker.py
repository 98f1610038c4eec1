"""A worker thread with a short queue: the stages of the job run beside each other."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

__all__ = ["BackgroundWorker"]

Item = TypeVar("Item")

# Items that may wait. Each holds a picture and its flow: a few smooth the load, many would only fill the memory.
_DEPTH = 4


class BackgroundWorker(Generic[Item]):
    """Call `work(item)` in another thread, in the order of `put`.

    The first error in `work` ends the work: it is raised once, by the next `put`, `wait` or `close`, and all items
    behind it are dropped. At most `depth` items wait. `begin` is called first of all in that thread.
    """

    def __init__(
        self,
        work: Callable[[Item], None],
        *,
        name: str,
        depth: int = _DEPTH,
        begin: Callable[[], None] | None = None,
    ) -> None:
        self._work, self._begin = work, begin
        self._queue: queue.Queue[Item | threading.Event | None] = queue.Queue(depth)
        self._error: BaseException | None = None
        self._failed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        if self._begin is not None:
            self._begin()
        while (item := self._queue.get()) is not None:
            if isinstance(item, threading.Event):
                item.set()
            elif not self._failed:
                try:
                    self._work(item)
                except BaseException as error:
                    self._error = error
                    self._failed = True

    def put(self, item: Item) -> None:
        """Hand over one item; waits while the queue is full."""
        self._raise()
        self._queue.put(item)

    def wait(self) -> None:
        """Wait until all that was put is done."""
        if self._thread.is_alive():
            done = threading.Event()
            self._queue.put(done)
            done.wait()
        self._raise()

    def close(self) -> None:
        """Wait until all is done and end the thread."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        self._raise()

    def _raise(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error
