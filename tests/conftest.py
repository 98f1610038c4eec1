"""Shared by all tests: scenes with exact truth come from rsflow.synthetic; photographs from scikit-image's wheel."""

from __future__ import annotations

import signal
import zlib
from collections.abc import Iterator
from typing import Any

import hypothesis
import numpy as np
import pytest

from browser import opened_browser

# The same examples in every run: a failure can be run again, and a pass means the same everywhere.
hypothesis.settings.register_profile("seeded", derandomize=True, deadline=None)
hypothesis.settings.load_profile("seeded")

# A shell that starts the tests in the background has them ignore SIGINT, and so would every child that tests Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator whose seed follows from the test's name, so that a failure can be run again."""
    seed = zlib.crc32(request.node.name.encode())
    print(f"seed {seed}")
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A Chromium, one for the tests of a file; they are skipped where none is installed."""
    with opened_browser() as opened:
        yield opened
