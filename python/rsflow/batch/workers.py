"""The processes of `rsflow.batch`: one that dies, killed or short of memory, takes nothing else with it."""

from __future__ import annotations

import collections
import contextlib
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.context import BaseContext
from signal import SIG_BLOCK, SIG_SETMASK, SIGINT
from typing import Any, TypeVar

__all__ = ["Workers"]

T = TypeVar("T")


class Workers(Executor):
    """An executor whose every process has a pool of its own: a process that dies breaks that pool alone.

    There are as many processes as jobs at once; one is started when none is idle, and kept.

    Parameters
    ----------
    context : multiprocessing context
        How to start a process; not by ``fork``.
    initializer : callable
        Called in each process first; it must see to it that SIGINT does no harm.
    """

    def __init__(self, context: BaseContext, initializer: Callable[[], None]) -> None:
        self._context, self._initializer = context, initializer
        _track_quietly()
        self._pools: list[ProcessPoolExecutor] = []
        self._idle: collections.deque[ProcessPoolExecutor] = collections.deque()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run `fn` in a process that is idle, or in a new one."""
        while self._idle:
            pool = self._idle.pop()
            # One whose process died is known by this alone.
            with contextlib.suppress(BrokenProcessPool):
                return self._given(pool, fn, args, kwargs)
        pool = ProcessPoolExecutor(1, self._context, self._initializer)
        self._pools.append(pool)
        return self._given(pool, fn, args, kwargs)

    def _given(
        self, pool: ProcessPoolExecutor, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> Future[T]:
        with _held_back():
            future = pool.submit(fn, *args, **kwargs)
        future.add_done_callback(lambda _: self._idle.append(pool))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when their jobs have ended."""
        for pool in self._pools:
            pool.shutdown(wait=False, cancel_futures=cancel_futures)
        if wait:
            for pool in self._pools:
                pool.shutdown()


def _track_quietly() -> None:
    """Begin the process of the standard library that removes what a killed process leaves, so that it is silent.

    It would warn of the locks of the pools where this process is killed, though they are removed: nothing has leaked.
    It takes the filters of warnings that this process was started with, and is one for all that begin later.
    """
    try:
        from multiprocessing import resource_tracker
    except ImportError:
        return
    ours = "ignore:resource_tracker:UserWarning"
    sys.warnoptions.append(ours)
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.remove(ours)


@contextlib.contextmanager
def _held_back() -> Iterator[None]:
    """Hold SIGINT back while a process is started: one that gets it before it ignores it would die of it."""
    try:
        from signal import pthread_sigmask
    except ImportError:
        yield
        return
    before = pthread_sigmask(SIG_BLOCK, {SIGINT})
    try:
        yield
    finally:
        pthread_sigmask(SIG_SETMASK, before)
