"""The browser of the tests sees what a page does wrong."""

from __future__ import annotations

from typing import Any

from browser import watched_page


def test_what_goes_wrong_in_a_page_is_seen(browser: Any) -> None:
    with watched_page(browser, width=390) as seen:
        seen.page.set_content("<p>fine</p>")
        assert (seen.errors, seen.requests) == ([], [])
        assert seen.page.evaluate("innerWidth") == 390
        seen.page.set_content(
            "<script>console.error('said')</script><script>nothing()</script><img src='http://localhost:9/none.png'>"
        )
        assert any("said" in error for error in seen.errors)
        assert any("nothing is not defined" in error for error in seen.errors)
        assert seen.requests == ["http://localhost:9/none.png"]
