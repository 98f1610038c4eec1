"""The report page in a real browser: nothing goes wrong, it is read at every width, in the dark and on paper."""

from __future__ import annotations

import dataclasses
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsflow
from browser import access_faults, layout_faults, watched_page
from extraction_helpers import HEIGHT_M, made_flight
from report_materials import film
from rsflow.extraction.report import build, page, parts


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> rsflow.Extraction:
    """An extraction with everything: a velocity, a thing, a line, videos."""
    flight = made_flight()
    return rsflow.extract(
        list(flight.images), tmp_path_factory.mktemp("page"), frame_rate=30, camera=flight.camera, height_m=HEIGHT_M,
        lines=[(80, 0, 80, 119)],
    )  # fmt: skip


def address(path: Path) -> str:
    return path.resolve().as_uri()


def written(material: Any, folder: Path) -> Path:
    path = folder / "report.html"
    path.write_text(page(build(material)), encoding="utf-8")
    return path


@pytest.mark.parametrize("width", [390, 768, 1280])
def test_it_is_read_at_every_width_without_an_error_or_a_network(
    browser: Any, done: rsflow.Extraction, width: int
) -> None:
    with watched_page(browser, width=width) as seen:
        seen.page.goto(address(done.files["report"]))
        assert layout_faults(seen.page) == []
        seen.page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        assert layout_faults(seen.page) == []
        assert (seen.errors, seen.requests) == ([], [])


@pytest.mark.parametrize("width", [390, 768, 1280])
def test_what_was_not_measured_is_read_whole(browser: Any, tmp_path: Path, width: int) -> None:
    """No column is cut, nor has to be moved to be seen: of frames in many runs, too."""
    made = film(60)
    motion = made.series["motion"]
    words = motion.words("status")
    words[5:40:3] = ["no_match"] * len(words[5:40:3])
    words[45:48] = ["not_converged"] * 3
    with watched_page(browser, width=width) as seen:
        seen.page.goto(address(written(made, tmp_path)))
        table = seen.page.locator("table.stacks")
        inside, wide = table.locator("xpath=..").evaluate("(box) => [box.clientWidth, box.scrollWidth]")
        assert wide <= inside
        assert "no_match" in table.inner_text()
        assert layout_faults(seen.page) == []
        # Each cell has its header: above it, or beside it where the page is narrow.
        assert seen.page.locator("table.stacks th").first.is_visible() == (width > 620)
        label = table.locator("td").nth(2).evaluate("(cell) => getComputedStyle(cell, '::before').content")
        assert label == ('"outcome"' if width < 620 else "none")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_has_contrast_and_names_in_light_and_dark(browser: Any, done: rsflow.Extraction, scheme: str) -> None:
    with watched_page(browser, color_scheme=scheme) as seen:
        seen.page.goto(address(done.files["report"]))
        assert access_faults(seen.page) == []


def test_a_plot_says_its_values_where_the_pointer_is(browser: Any, done: rsflow.Extraction) -> None:
    with watched_page(browser) as seen:
        seen.page.goto(address(done.files["report"]))
        plot = seen.page.locator("#how-fast .box").first
        plot.hover()
        said = plot.locator(".tip").inner_text()
        assert "time 0.2" in said
        value, std = re.search(r"vx, right: (\S+) ± (\S+) m/s", said).groups()
        # True is 0.04 m/s.
        assert float(value) == pytest.approx(0.04, abs=max(3 * float(std), 1e-3))
        path = seen.page.locator("#where .box[data-plane]").first
        path.hover()
        assert "x 0." in path.locator(".tip").inner_text()
        assert seen.errors == []


def test_the_slider_shows_one_picture_after_the_other(browser: Any, done: rsflow.Extraction) -> None:
    with watched_page(browser) as seen:
        seen.page.goto(address(done.files["report"]))
        shown = seen.page.locator(".slider figure:visible")
        assert shown.count() == 1
        seen.page.get_by_label("frame", exact=True).fill("0")
        assert shown.inner_text().startswith("frame 0, 0.00 s")
        seen.page.get_by_label("next picture").click()
        assert shown.inner_text().startswith("frame 1, 0.03 s")
        # A click on a plot goes to that time.
        plot = seen.page.locator("#how-fast .box").first
        size = plot.bounding_box()
        plot.click(position={"x": size["width"] - 1, "y": 50})
        assert shown.inner_text().startswith("frame 14,")
        assert seen.page.evaluate("document.querySelector('.slider figure:not([hidden]) img').naturalWidth") > 100


def test_it_is_whole_without_a_script(browser: Any, done: rsflow.Extraction) -> None:
    with watched_page(browser, width=390, java_script_enabled=False) as seen:
        seen.page.goto(address(done.files["report"]))
        assert seen.page.locator(".slider figure:visible").count() == 15
        assert seen.page.locator("#how-fast polyline").count() > 2


def test_it_prints(browser: Any, done: rsflow.Extraction) -> None:
    with watched_page(browser, color_scheme="dark") as seen:
        seen.page.goto(address(done.files["report"]))
        seen.page.emulate_media(media="print")
        assert seen.page.locator(".slider figure:visible").count() == 6
        assert seen.page.locator(".bar:visible, nav:visible").count() == 0
        assert seen.page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        assert seen.page.pdf(format="A4").startswith(b"%PDF")


def test_a_video_is_inside_or_said_to_be_beside(
    browser: Any, done: rsflow.Extraction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with watched_page(browser) as seen:
        seen.page.goto(address(done.files["report"]))
        seen.page.wait_for_function("[...document.querySelectorAll('video')].every((one) => one.videoWidth > 0)")
    clip = parts.Clip("Motion", "Arrows.", b"\xff\xd8", done.files["flow"])
    assert 'src="data:video/mp4;base64,' in clip.html()
    monkeypatch.setattr(parts, "EMBED_BYTES", 1_000)
    assert "<video" not in clip.html()
    assert "flow.mp4</a> is beside this page" in clip.html()


def test_an_hour_opens_at_once_with_every_peak(browser: Any, tmp_path: Path) -> None:
    material = film(108_000, things=4)
    step = material.series["motion"]._numbers["dx_px"]
    step[54_321] = 25.0
    begin = time.process_time()
    path = written(material, tmp_path)
    assert time.process_time() - begin < 8
    assert path.stat().st_size < 3e6
    took = []
    with watched_page(browser) as seen:
        # Another program may take the processor: the best of three.
        for _ in range(3):
            seen.page.goto(address(path))
            took.append(seen.page.evaluate("performance.getEntriesByType('navigation')[0].loadEventEnd"))
        assert min(took) < 2000
        plot = seen.page.locator("#more-curves .box").first
        plot.scroll_into_view_if_needed()
        size = plot.bounding_box()
        seen.page.mouse.move(size["x"] + size["width"] * 54_321 / 108_000, size["y"] + 60)
        said = plot.locator(".tip").inner_text()
        assert " to 25.0" in said, said
        assert layout_faults(seen.page) == []
        assert seen.errors == []


@pytest.mark.parametrize(("things", "speed", "frames"), [(0, 0.0, 40), (14, 3.0, 200), (1, 0.0, 2)])
@pytest.mark.parametrize("width", [390, 1280])
def test_other_films_are_read_too(
    browser: Any, tmp_path: Path, things: int, speed: float, frames: int, width: int
) -> None:
    with watched_page(browser, width=width) as seen:
        seen.page.goto(address(written(film(frames, things=things, speed=speed), tmp_path)))
        assert layout_faults(seen.page) == []
        assert seen.errors == []


def test_names_of_files_are_text(browser: Any, tmp_path: Path) -> None:
    material = film(30)
    name = "<script>document.title = 'taken'</script>\"'&<b>.mp4"
    summary = {**material.summary, "source": name, "notes": [name], "problems": [name]}
    summary["settings"] = {**summary["settings"], name: name}
    files = {"motion": Path(name), "flow": Path("x\" onclick='taken'.mp4")}
    posters = {"flow": b"\xff\xd8"}
    with watched_page(browser) as seen:
        changed = dataclasses.replace(material, summary=summary, files=files, posters=posters)
        seen.page.goto(address(written(changed, tmp_path)))
        assert seen.page.title() == f"{name.rpartition('/')[2]}: motion"
        assert seen.page.locator("[onclick], script").count() == 1
        assert np.any([name in text for text in seen.page.locator("li").all_inner_texts()])
