"""A Dask cluster that is there, as an executor."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from .._extras import require
from ..errors import CaptureError, OptionError

__all__ = ["cluster"]

# How long a scheduler is waited for, and how often the number of its workers is asked for, in seconds.
_WAIT_S = 10.0
_EVERY_S = 2.0

# Steps handed over for each thread of the cluster: one that waits is begun as soon as another ends.
_AHEAD = 2


@contextlib.contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """Connect to the scheduler of a cluster; give an executor, and how many steps to hand to it at once.

    Parameters
    ----------
    address : str
        ``tcp://host:8786`` or the path of a scheduler file.

    Raises
    ------
    OptionError
        If there is no scheduler.
    MissingExtraError
        If Dask is not installed.
    """
    distributed = require("distributed", extra="dask", purpose="working on a Dask cluster")
    if "://" not in address and not Path(address).is_file():
        # Dask would wait for such a file without an end.
        raise OptionError(f"scheduler: got '{address}', expected an address, as tcp://host:8786, or a scheduler file")
    given: dict[str, Any] = {"address": address} if "://" in address else {"scheduler_file": address}
    try:
        client = distributed.Client(**given, timeout=_WAIT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise OptionError(f"scheduler: got '{address}', expected the address of a Dask scheduler: {told}") from None
    asked = 0.0
    steps = _AHEAD

    def at_once() -> int:
        nonlocal asked, steps
        if time.monotonic() - asked > _EVERY_S:
            asked = time.monotonic()
            with contextlib.suppress(OSError, TimeoutError):
                steps = _AHEAD * max(1, sum(client.nthreads().values()))
        return steps

    try:
        # The same call again is done again: a worker may have died of it.
        yield client.get_executor(pure=False), at_once
    finally:
        with contextlib.suppress(OSError, TimeoutError, CaptureError):
            client.close(timeout=5)
