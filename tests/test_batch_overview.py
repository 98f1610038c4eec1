"""The page of a whole batch: what was not done first, figures, links to the reports; read in a real browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import pytest

import rsflow
from browser import access_faults, layout_faults, watched_page
from extraction_helpers import HEIGHT_M, made_flight
from rsflow.batch import BatchItem, BatchStatus, extract_many, folder_names
from rsflow.batch.overview import overview


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[BatchItem]]:
    """A batch of which one source is done, one is not there, and one is no picture after the first ones."""
    folder = tmp_path_factory.mktemp("batch")
    flight = made_flight()
    for name, count in (("a <b>", 16), ("cut short", 6)):
        (folder / name).mkdir()
        for index, image in enumerate(flight.images[:count]):
            cv2.imwrite(str(folder / name / f"{index:03d}.png"), image)
    (folder / "cut short" / "006.png").write_bytes(b"nothing")
    out = folder / "out"
    sources = [folder / "a <b>", folder / "missing.mp4", folder / "cut short"]
    how = {"frame_rate": 30, "camera": flight.camera, "height_m": HEIGHT_M, "videos": False}
    return out, extract_many(sources, out, jobs=1, **how)


@pytest.mark.parametrize("width", [390, 768, 1280])
def test_it_is_read_at_every_width_without_an_error_or_a_network(browser: Any, done: Any, width: int) -> None:
    out, _ = done
    with watched_page(browser, width=width) as seen:
        seen.page.goto((out / "index.html").resolve().as_uri())
        assert layout_faults(seen.page) == []
        for table in seen.page.locator(".scroll").all():
            inside, wide = table.evaluate("(box) => [box.clientWidth, box.scrollWidth]")
            assert wide <= inside
        assert (seen.errors, seen.requests) == ([], [])


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_has_contrast_and_names_in_light_and_dark(browser: Any, done: Any, scheme: str) -> None:
    out, _ = done
    with watched_page(browser, width=390, color_scheme=scheme) as seen:
        seen.page.goto((out / "index.html").resolve().as_uri())
        assert access_faults(seen.page) == []


def test_what_failed_stands_first_with_its_reason_and_every_report_is_a_click_away(browser: Any, done: Any) -> None:
    out, items = done
    assert [item.status.word for item in items] == ["done", "failed", "partial"]
    with watched_page(browser) as seen:
        seen.page.goto((out / "index.html").resolve().as_uri())
        facts = seen.page.locator(".fact b").all_inner_texts()
        assert facts[0].split() == ["1", "of", "3"]
        rows = [row.locator("td").all_inner_texts() for row in seen.page.locator("#not-done tbody tr").all()]
        assert [row[1] for row in rows] == ["failed", "partial"]
        assert rows[0][2] == items[1].error
        listed = [row.locator("td").all_inner_texts() for row in seen.page.locator("#sources tbody tr").all()]
        assert [row[1] for row in listed] == ["failed", "partial", "done"]
        assert listed[2][0].endswith("a <b>")
        assert listed[2][3:5] == ["16", "100 %"]
        assert listed[2][5].endswith("m/s")
        assert listed[2][6] == str(items[0].summary["lasting_objects"])
        links = seen.page.locator("#sources a")
        assert links.count() == 2
        for number in range(2):
            links.nth(number).click()
            assert seen.page.locator("#how-sure").count() == 1
            seen.page.go_back()
        assert seen.errors == []


def test_the_next_batch_writes_over_an_overview_and_over_nothing_else(tmp_path: Path) -> None:
    (item,) = extract_many([tmp_path / "missing.mp4"], tmp_path / "out", jobs=1)
    page = tmp_path / "out" / "index.html"
    assert item.error in page.read_text(encoding="utf-8")
    extract_many([tmp_path / "other.mp4"], tmp_path / "out", jobs=1)
    assert "missing.mp4" not in page.read_text(encoding="utf-8")
    page.write_text("<title>mine</title>", encoding="utf-8")
    with pytest.raises(rsflow.OptionError, match=r"index\.html is something else than an overview"):
        extract_many([tmp_path / "other.mp4"], tmp_path / "out", jobs=1)
    assert page.read_text(encoding="utf-8") == "<title>mine</title>"
    assert folder_names(["index.html.mp4"]) == ["index.html-2"]


def test_a_hundred_thousand_sources_make_a_page_that_opens(browser: Any, tmp_path: Path) -> None:
    summary = {
        "frames": 100,
        "measured": 99,
        "duration_s": 3.3,
        "lasting_objects": 2,
        "files": {"report": "report.html"},
    }
    items = [
        BatchItem(f"clips/{number}.mp4", tmp_path / str(number), BatchStatus.DONE, "", summary)
        for number in range(100_000)
    ]
    items[70_000] = BatchItem("clips/bad.mp4", tmp_path / "bad", BatchStatus.FAILED, "it is damaged", {})
    text = overview(items)
    assert len(text) < 3_000_000
    (tmp_path / "index.html").write_text(text, encoding="utf-8")
    with watched_page(browser) as seen:
        seen.page.goto((tmp_path / "index.html").as_uri())
        assert "it is damaged" in seen.page.locator("#not-done").inner_text()
        assert "The first 5000 of 100000." in seen.page.locator("#sources").inner_text()
        assert "91 h 40 min" in seen.page.locator(".answers").inner_text().replace("\u00a0", " ")
