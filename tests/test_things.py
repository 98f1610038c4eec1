"""What is said first: how many things moved, how fast, where; and a camera that stands still is said to."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest

import rsflow
from rsflow.extraction.answers import Fact, answers
from rsflow.extraction.report.map_plot import map_plot
from rsflow.extraction.series import Series
from rsflow.extraction.summary import camera_figures, key_figures
from rsflow.extraction.thing_scale import scales
from rsflow.extraction.things import heading, lasting, thing_figures, thing_text, value_text
from rsflow.plotting.drawing import distinct_color

MOTION = (
    "frame", "t_s", "dt_s", "dx_px", "dy_px", "dx_std_px", "dy_std_px", "flow_median_px", "flow_median_x_px",
    "flow_median_y_px", "flow_valid_share", "moving_share", "objects", "camera_dx_px", "camera_dy_px",
)  # fmt: skip
OBJECTS = (
    "frame",
    "id",
    "x_px",
    "y_px",
    "area_px",
    "vx_px_per_frame",
    "vy_px_per_frame",
    "speed_px_s",
    "speed_std_px_s",
)


def film(shift: float, *, frames: int = 30, noise: float = 0.01, counts: int = 0) -> Series:
    motion = Series(MOTION, ("status", "segmentation_status", "camera_model"))
    rng = np.random.default_rng(1)
    for frame in range(frames):
        row = {"frame": frame, "t_s": frame / 10, "dt_s": 0.1, "moving_share": 0.02, "objects": counts}
        step = rng.normal(0, noise, 2) if frame else (math.nan, math.nan)
        row |= {"dx_px": shift + step[0], "dy_px": step[1], "dx_std_px": noise, "dy_std_px": noise}
        motion.append(row | {"status": "ok", "segmentation_status": "ok", "camera_model": "translation"})
    return motion


def things() -> Series:
    objects = Series(OBJECTS)
    for frame in range(30):
        for number, speed in ((1, 10.0), (2, 20.0), (3, 90.0)):
            row = {"frame": frame, "id": number, "x_px": 5 + speed * frame / 10, "y_px": 50.0, "area_px": 400}
            row |= {"vx_px_per_frame": speed / 10, "vy_px_per_frame": 0, "speed_px_s": speed, "speed_std_px_s": 1.5}
            objects.append(row)
    for frame in (3, 4):
        objects.append({"frame": frame, "id": 9, "x_px": 1, "y_px": 1, "area_px": 20, "speed_px_s": 500})
    return objects


def test_how_many_and_how_fast() -> None:
    figures = thing_figures(things(), film(0, counts=3))
    assert (figures["objects"], figures["lasting_objects"], figures["at_once_max"]) == (4, 3, 3)
    assert (figures["thing_speed_unit"], figures["thing_speed_median"], figures["thing_speed_std_median"]) == (
        "px/s",
        20,
        1.5,
    )
    assert (figures["fastest_thing"], figures["fastest_thing_speed"]) == (3, 90)
    said = thing_text(figures)
    assert said.startswith("3 things moved on their own, 3 at once")
    assert "at 20 ± 2 px/s (median" in said
    assert said.endswith("the fastest, number 3, at 90 ± 2 px/s.")
    assert figures["headings"] == {"right": 3}
    unit, found = lasting(things())
    assert unit == "px/s"
    assert [heading(thing) for thing in found] == ["right", "right", "right"]


def place_of(x: np.ndarray, y: np.ndarray, *, std: float = math.nan) -> str:
    objects = Series((*OBJECTS, "x_std_px", "y_std_px"))
    for frame, (at_x, at_y) in enumerate(zip(x, y, strict=True)):
        row = {"frame": frame, "id": 1, "x_px": at_x, "y_px": at_y, "area_px": 2500, "x_std_px": std, "y_std_px": std}
        objects.append(row)
    (thing,) = lasting(objects)[1]
    return heading(thing)


@pytest.mark.parametrize("seed", range(20))
def test_a_way_counts_against_how_well_places_are_known_not_against_the_size_of_the_thing(seed: int) -> None:
    frames = np.arange(60)
    jitter = np.random.default_rng(seed).normal(0, 0.5, (2, 60))
    # 27 px, of a thing of 50 px.
    assert place_of(100 + 27 * frames / 59 + jitter[0], 50 + jitter[1]) == "right"
    assert place_of(100 + jitter[0], 50 - 27 * np.minimum(frames, 20) / 20 + jitter[1]) == "up"
    assert place_of(100 + jitter[0], 50 + jitter[1]) == "about its place"
    assert place_of(100 + jitter[0] + 27 * np.sin(frames / 8), 50 + jitter[1]) == "to and fro"
    # The jitter of a place that is not known to 10 px, though it does not show.
    assert place_of(100 + 27 * frames / 59, 50.0 + 0 * frames, std=10) == "about its place"
    assert place_of(100 + 27 * frames / 59, 50.0 + 0 * frames, std=2) == "right"


def test_what_went_to_and_fro_or_stood_still_exactly_is_said_to() -> None:
    still = np.full(30, 50.0)
    assert place_of(still, still) == "about its place"
    figures = key_figures(film(0), None, None) | camera_figures(film(0), "static")
    figures |= thing_figures(things(), film(0)) | {"headings": {"to and fro": 2, "about its place": 1}}
    _, where, _, _ = answers(figures | {"camera_motion_reason": "found so"})
    assert Fact("to and fro", "most things: 2 of 3") in where.facts
    assert "Of 3 things 2 went to and fro, 1 stayed about where it was." in where.sentences


def test_nothing_and_what_is_brief() -> None:
    assert thing_text(thing_figures(Series(OBJECTS), film(0))) == "Nothing moved on its own."
    brief = Series(OBJECTS)
    brief.append({"frame": 3, "id": 9, "x_px": 1, "y_px": 1, "area_px": 20})
    assert "1 brief sight " in thing_text(thing_figures(brief, film(0)))


def test_what_is_hidden_is_not_counted_as_seen() -> None:
    objects = Series(OBJECTS)
    for frame in range(20):
        objects.append({"frame": frame, "id": 1, "x_px": frame, "y_px": 0, "area_px": 50 if frame < 8 else 0})
    assert lasting(objects)[1] == []


@pytest.mark.parametrize(
    ("shift", "decided", "still"),
    [(0.0, "static", True), (0.0, "moving", True), (2.0, "moving", False), (2.0, "static", False)],
)
def test_a_camera_that_stands_still_is_said_to(shift: float, decided: str, still: bool) -> None:
    motion = film(shift)
    figures = key_figures(motion, None, None) | camera_figures(motion, decided) | thing_figures(things(), motion)
    figures["camera_motion_reason"] = "found so"
    fast, where, many, sure = answers(figures)
    assert figures["camera_still"] == still
    assert ("The camera stood still (found so)." in fast.sentences) == still
    assert (Fact("stood still", "the camera") in fast.facts) == still
    assert any("px to the right" in sentence for sentence in where.sentences) != still
    if not still:
        assert figures["picture_speed_median"] == pytest.approx(20, abs=0.2)
        assert Fact("20.0 ± 0.1 px/s", "the picture as a whole, median") in fast.facts
    assert Fact("90 ± 2 px/s", "the fastest, number 3") in fast.facts
    assert Fact("to the right", "most things: 3 of 3") in where.facts
    assert many.facts[0].value == "3 things"
    assert "measured in 29 of 29 pairs" in sure.line()
    assert fast.line().startswith("How fast: The camera ")


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (31.26, 2.8, "31 ± 3 m"),
        (31.26, 0.28, "31.3 ± 0.3 m"),
        (312.6, 28.0, "313 ± 28 m"),
        (0.01234, 0.0009, "0.0123 ± 0.0009 m"),
        (31.26, math.nan, "31.3 m"),
        (None, 1.0, "not known"),
        (math.nan, 1.0, "not known"),
    ],
)
def test_a_value_has_the_places_that_its_deviation_allows(value: float | None, std: float, text: str) -> None:
    assert value_text(value, std, "m") == text


def test_ways_over_a_picture() -> None:
    x = np.array([10.0, 20, np.nan, 60, 90])
    drawn = map_plot([("7 & 8", "#ff0000", x, x / 2)], (100, 80), title="ways", picture="data:image/jpeg;base64,AA==")
    assert drawn.aspect == 1.25
    space = "{http://www.w3.org/2000/svg}"
    tree = ElementTree.fromstring(f'<svg xmlns="{space[1:-1]}">{drawn.body}</svg>')
    assert [text.text for text in tree.iter(f"{space}text")] == ["7 & 8"]
    paths = {path.get("d") for path in tree.iter(f"{space}path")}
    assert "M10.0 5.0L20.0 10.0M60.0 30.0L90.0 45.0" in paths
    assert tree.find(f"{space}svg/{space}image") is not None
    assert "<path" not in map_plot([("1", "#000000", x * np.nan, x)], (100, 80), title="ways").body


def test_names_on_the_map_never_lie_over_each_other() -> None:
    ways = [(str(number), "#ffffff", np.array([0.0, 50 + number % 7]), np.array([0.0, 40.0])) for number in range(30)]
    body = map_plot(ways, (100, 80), title="ways").body
    texts = re.findall(r'<text x="([\d.]+)%" y="[\d.]+%" dx="(-?\d+)" dy="(-?\d+)"', body)
    assert 4 <= len(texts) < 30
    for width in (330, 860):
        places = [(float(x) * width / 100 + int(dx), int(dy)) for x, dx, dy in texts]
        if width == 330:
            places = [
                at for at, text in zip(places, re.findall("<text[^>]*>", body), strict=True) if "class" not in text
            ]
        assert len(set(places)) == len(places)


def test_the_scale_of_a_place_is_the_height_over_the_focal_length_in_the_middle_and_unknown_where_it_tilts():
    camera = rsflow.Camera(200.0, 200.0, 79.5, 59.5, width=160, height=120, distortion=(-0.1, 0, 0, 0, 0))
    places = np.array([(79.5, 59.5), (150.0, 110.0)])
    middle, corner = scales(camera, 2.0, 1.0, places)
    assert middle == pytest.approx(0.01, rel=1e-3)
    # The lens shows what is far out smaller.
    assert 1.02 < corner / middle < 1.2
    assert np.isnan(scales(camera, 2.0, 0.9, places)).all()
    assert np.isnan(scales(camera, np.nan, 1.0, places)).all()


def test_paths_go_from_a_ring_to_a_number() -> None:
    statistics = rsflow.objects.ObjectStatistics()
    for frame in range(20):
        box = (40 + 5 * frame, 50, 10, 10)
        thing = rsflow.objects.TrackedObject(7, 45.0 + 5 * frame, 55.0, box, 100, 5.0, 0.0, frame + 1)
        statistics.update(frame, [thing], [], size=(200, 100))
    drawn = statistics.picture(np.full((100, 200, 3), 90, np.uint8))
    assert drawn[55, 45].tolist() == [255, 255, 255]
    assert drawn[55, 140].tolist() == list(distinct_color(7))
    # Its number stands above the end.
    assert (drawn[30:50, 130:160] != 90).any()
    assert (drawn[:30] == 90).all()
