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


_TEXTS = """() => {
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode;
    const parent = node.parentElement;
    if (!node.textContent.trim() || ['SCRIPT', 'STYLE', 'TITLE', 'title'].includes(parent.tagName)) continue;
    const look = getComputedStyle(parent);
    if (look.visibility !== 'visible' || !parent.checkVisibility()) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const boxes = parent.closest('svg') ? [parent.getBoundingClientRect()] : [...range.getClientRects()];
    for (const box of boxes) {
      if (box.width < 1 || box.height < 1) continue;
      found.push([node.textContent.trim().slice(0, 40), box.left, box.top, box.right, box.bottom,
                  parseFloat(look.fontSize)]);
    }
  }
  return found;
}"""
# Boxes of letters have room above and below; two lines may share so many pixels of it.
_ROOM_PX = 3.0


def layout_faults(page: Any, *, smallest_px: float = 12.0) -> list[str]:
    """Say what is wrong with a page as wide as it is: it scrolls sideways, letters are small, or lie over others."""
    wide, seen = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    faults = [f"{wide} px wide in {seen}"] if wide > seen else []
    texts = sorted(page.evaluate(_TEXTS), key=lambda text: text[2])
    faults += [f"{text[0]!r} has {text[5]:g} px" for text in texts if text[5] < smallest_px]
    for number, (name, left, top, right, bottom, _) in enumerate(texts):
        for other, other_left, other_top, other_right, other_bottom, _ in texts[number + 1 :]:
            if other_top > bottom - _ROOM_PX:
                break
            deep = min(bottom, other_bottom) - max(top, other_top)
            if deep > _ROOM_PX and min(right, other_right) - max(left, other_left) > 1:
                faults.append(f"{name!r} and {other!r} lie over each other")
    return faults


def access_faults(page: Any) -> list[str]:
    """Say what axe-core finds: contrast, names, structure."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    found = axe.Axe().run(page).response["violations"]
    return [f"{one['id']}: {node['target']} {node['failureSummary']}" for one in found for node in one["nodes"]]
