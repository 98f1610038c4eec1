"""A real browser for tests of pages: the system's Chromium, driven through playwright; nothing is ever downloaded.

`conftest.py` has it as the fixture `browser`, one for all tests of a file.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")
# What a page may ask for without asking a network.
_AT_HOME = ("file:", "data:", "blob:", "about:")


def find_browser() -> str | None:
    """Give the program of a Chromium that is installed, None where there is none."""
    return next((found for name in _NAMES if (found := shutil.which(name)) is not None), None)


@contextlib.contextmanager
def opened_browser(*arguments: str) -> Iterator[Any]:
    """Open a browser and close it again, with further `arguments`; the test is skipped where none is installed."""
    program = find_browser()
    if program is None:
        pytest.skip(f"no Chromium is installed: none of {', '.join(_NAMES)} is on the path")
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (group test)")
    # Chromium's sandbox refuses to run as root, as in a container.
    alone = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=program, args=[*alone, *arguments])
        try:
            yield browser
        finally:
            browser.close()


@dataclass
class Watched:
    """A page, and what went wrong in it."""

    page: Any
    #: Errors and warnings of the console, and errors that a script did not catch.
    errors: list[str] = field(default_factory=list)
    #: Addresses that were asked for over a network.
    requests: list[str] = field(default_factory=list)


@contextlib.contextmanager
def watched_page(browser: Any, *, width: int = 1280, height: int = 900, **context: Any) -> Iterator[Watched]:
    """Open an empty page of a width and watch what it does; `context` is for playwright's `Browser.new_context`."""
    with contextlib.closing(browser.new_context(viewport={"width": width, "height": height}, **context)) as opened:
        page = opened.new_page()
        watched = Watched(page)

        def heard(message: Any) -> None:
            if message.type in {"error", "warning"}:
                watched.errors.append(message.text)

        def asked(request: Any) -> None:
            if not request.url.startswith(_AT_HOME):
                watched.requests.append(request.url)

        page.on("console", heard)
        page.on("pageerror", lambda error: watched.errors.append(str(error)))
        page.on("request", asked)
        yield watched
