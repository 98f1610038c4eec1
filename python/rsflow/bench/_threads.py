"""The number of threads of a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .._core import get_num_threads, set_num_threads


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Have rsflow and OpenCV use `count` threads, and what they used before at the end."""
    import cv2

    before = get_num_threads(), cv2.getNumThreads()
    try:
        set_num_threads(count)
        cv2.setNumThreads(count)
        yield
    finally:
        set_num_threads(before[0])
        cv2.setNumThreads(before[1])
