"""`rsflow bench kinds`: its scenes are what they say, its counts right, and its words follow from the figures."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage

import rsflow
from rsflow import bench, cli
from rsflow.bench import KINDS_MARKS, KindRow, KindsBench, SizeRow, measure_kinds
from rsflow.bench.kinds_methods import REFERENCE, SUBJECTS, Answer, methods_of, missing
from rsflow.bench.kinds_run import _Seen
from rsflow.bench.kinds_scenes import Scene, Shape, kinds
from rsflow.bench.kinds_tables import errors, in_words, times, trust

EVERY = {kind.name: kind for kind in kinds()}
SIZE = (128, 96)
NAN = float("nan")
# Where light, noise or the sensor differ, the grey levels do not follow the motion.
SAME_LEVELS = (
    "still", "shift of 0.3 px", "shift of 12 px", "turn of 5 degrees", "zoom by 1.05", "shear of 0.05", "perspective",
    "several, with edges", "steady", "tiles of 32 px", "stripes", "plain areas, half of it", "overlay, masked",
)  # fmt: skip


@pytest.fixture(scope="module")
def found() -> KindsBench:
    before = rsflow.get_num_threads(), cv2.getNumThreads()
    result = measure_kinds(only=["shift of 3 px", "another scene"], rounds=1, quick=True)
    assert (rsflow.get_num_threads(), cv2.getNumThreads()) == before
    return result


def row_of(bench: KindsBench, kind: str, method: str) -> KindRow:
    rows = [row for row in bench.rows if (row.kind, row.method) == (kind, method)]
    assert len(rows) == 1, (kind, method, sorted({row.method for row in bench.rows}))
    return rows[0]


@pytest.mark.parametrize("name", SAME_LEVELS)
def test_grey_levels_are_found_again_where_the_truth_says(name: str) -> None:
    scene = EVERY[name].make(Shape(SIZE, 1))
    y, x = np.nonzero(scene.seen)
    to = np.stack([x, y], axis=1) + scene.flow[y, x]
    later = ndimage.map_coordinates(scene.next.astype(float), (to[:, 1], to[:, 0]), order=3, mode="nearest")
    # Noise of one level in each frame, and rounding; a few pixels lie at an edge between two motions.
    assert np.median(np.abs(later - scene.prev[y, x])) < 1.6
    assert scene.seen.mean() > 0.6


def test_every_kind_has_two_frames_and_a_truth_for_each_pixel() -> None:
    assert len(EVERY) == len(kinds()) > 30
    assert {subject for kind in kinds() for subject in kind.subjects} == set(SUBJECTS)
    for name in ("several, blurred, in fog", "JPEG, quality 60", "overlay, not told", "particles, vortex of 4 px"):
        scene = EVERY[name].make(Shape(SIZE, 1))
        assert scene.prev.shape == scene.next.shape == scene.seen.shape == scene.flow.shape[:2] == SIZE[::-1]
        assert scene.prev.dtype == scene.next.dtype == np.uint8
        assert np.isfinite(scene.flow[scene.seen]).all()
    overlaid = EVERY["overlay, not told"].make(Shape(SIZE, 1))
    assert overlaid.mask is None
    assert np.isnan(overlaid.flow).any(axis=2).mean() == pytest.approx(0.25, abs=0.02)
    # Without a turn all pixels of a window for one displacement move alike.
    assert np.ptp(EVERY["gamma 0.7"].make(Shape(SIZE, 2, turned=False)).flow, axis=(0, 1)).max() < 1e-9


def test_all_methods_are_measured_and_right_on_an_easy_kind(found: KindsBench) -> None:
    # OpenPIV's second step fails in pictures as small as quick ones.
    assert [method.name for method in methods_of("grid", quick=True)] == ["rsflow displacement_grid", "rsflow, robust"]
    for subject in SUBJECTS:
        names = [method.name for method in methods_of(subject, quick=True)]
        assert names == [row.method for row in found.rows if (row.subject, row.kind) == (subject, "shift of 3 px")]
        ours = row_of(found, "shift of 3 px", REFERENCE[subject])
        assert ours.median_px < 0.03
        assert ours.answered > 0.9
        assert ours.wrong < 0.01
        assert ours.within_2 > 0.8
        assert ours.times == 1.0
    # What is known of rivals, so that a wrong sign or a wrong pair would show.
    for row in found.rows:
        if row.kind == "shift of 3 px":
            assert row.median_px < 0.5, row
            assert row.time_ms > 0


def test_what_answers_where_nothing_is_to_be_found_is_wrong(found: KindsBench) -> None:
    for method in ("OpenCV DIS fast", "OpenCV phaseCorrelate"):
        row = row_of(found, "another scene", method)
        assert (row.answered, row.wrong) == (1.0, 1.0)
        assert math.isnan(row.median_px)
    for method in REFERENCE.values():
        row = row_of(found, "another scene", method)
        assert row.wrong == row.answered < 0.1


def test_slow_rivals_give_the_motion_too() -> None:
    if "scikit-image" in missing():
        pytest.skip("scikit-image is not installed")
    scene = EVERY["shift of 0.3 px"].make(Shape((64, 48), 1))
    for method in methods_of("dense flow")[-2:]:
        answer = method.answer(method.call(scene, np.zeros((0, 2))), scene, np.zeros((0, 2)))
        assert np.median(np.hypot(*(answer.motion - scene.flow.reshape(-1, 2)).T)) < 0.15, method.name


def test_counts_of_answers_that_are_known() -> None:
    flow = np.zeros((1, 6, 2))
    flow[0, 5] = np.nan
    seen = np.array([[True, True, True, True, False, True]])
    scene = Scene(np.zeros((1, 6), np.uint8), np.zeros((1, 6), np.uint8), flow, seen)
    motion = np.zeros((6, 2))
    motion[:, 0] = 0.1, 0.6, 3.0, 3.0, 4.0, 9.0
    std = np.full((6, 2), 0.2)
    answer = Answer(
        np.stack([np.arange(6.0), np.zeros(6)], axis=1), motion, np.array([True, True, True, False, True, True]),
        std, std[:, 0],
    )  # fmt: skip
    counted = _Seen.of(answer, scene, whole=False)
    # The last one has no truth; the one that leaves the picture counts for what is sure and wrong.
    assert counted.wrong.tolist() == [False, False, True, False, True]
    assert counted.counts.tolist() == [True, True, True, True, False]
    assert counted.within.mean(axis=0).tolist() == [1 / 3, 1.0]
    # Half a pixel is none too sure, whatever is stated.
    told = dataclasses.replace(answer, deviation=np.full(6, 0.01))
    assert _Seen.of(told, scene, whole=False).wrong.tolist() == [False, True, True, False, True]
    assert _Seen.of(dataclasses.replace(answer, deviation=None), scene, whole=False).wrong[1]


def made(kind: str, method: str, median: float, p95: float, **more: float) -> KindRow:
    figures = {"answered": 1.0, "wrong": 0.0, "within_2": NAN, "time_ms": 1.0, "times": 1.0} | more
    return KindRow("points", "light", kind, method, median, p95, **figures)


def test_words_follow_from_the_figures() -> None:
    ours, theirs = "rsflow track_points", "OpenCV PyrLK"
    rows = [
        made("steady", ours, 0.010, 0.02, within_2=0.95), made("steady", theirs, 0.009, 0.02, wrong=0.5),
        made("gain", ours, 0.050, 0.20, within_2=0.80), made("gain", theirs, 0.030, 0.30),
        made("ramp", ours, 0.050, 0.20, within_2=0.95), made("ramp", theirs, 0.030, 0.10, answered=0.3),
        made("stripes", ours, NAN, NAN, answered=0.0), made("stripes", theirs, 2.0, 9.0),
        made("shadow", ours, 0.010, 0.02, wrong=0.034, within_2=0.9), made("shadow", theirs, 1.0, 2.0, times=0.25),
    ]  # fmt: skip
    assert in_words(rows).splitlines() == [
        "A rival is ahead:", "", "- gain: rsflow track_points 0.050 (0.20); OpenCV PyrLK 0.030 (0.30)", "",
        "Sure and wrong in more than 1 %:", "", "- shadow: rsflow track_points 3.4 %", "",
        "Fewer than 85 % within two deviations:", "", "- gain: rsflow track_points 80 %",
    ]  # fmt: skip
    quiet = in_words(rows[:2])
    assert quiet == "No rival is ahead in any row.\n\nSure and wrong in no row.\n\nToo sure in no row."
    assert "rival" not in in_words(rows[:1])
    lines = errors(rows).splitlines()
    assert [cell.strip() for cell in lines[4].split("|")[1:4]] == ["gain", "0.050 (0.20)", "**0.030 (0.30)**"]
    # Who answers too little is not the best; what nobody answers has none.
    assert "**0.050 (0.20)**" in lines[5]
    assert "**2.0 (9.0)**" in lines[6]
    assert [cell.strip() for cell in lines[-1].split("|")[1:4]] == ["*time, rsflow track_points = 1*", "1.0", "1.0"]
    assert [cell.strip() for cell in trust(rows).splitlines()[-1].split("|")[2:4]] == ["100; 3.4; 90", "100; 0"]


def test_tables_say_what_ran_and_what_is_missing() -> None:
    rows = (made("steady", "rsflow track_points", 0.01, 0.02),)
    sizes = (SizeRow("points", (64, 48), "rsflow track_points", 2.0, 1.0), SizeRow("points", (64, 48), "x", 1.0, 0.5),
             SizeRow("points", (128, 96), "rsflow track_points", 4.0, 1.0))  # fmt: skip
    result = KindsBench(rows, sizes, "a CPU", "avx2", 2, 3, {"rsflow": "1", "OpenCV": "5"}, ("OpenPIV",))
    text = result.tables()
    assert text.startswith(
        "a CPU, CPU level avx2, 2 threads, times are medians of 3 rounds; rsflow 1, OpenCV 5. "
        "Not installed, and left out: OpenPIV.\n\n### Points\n"
    )
    assert times(sizes).splitlines()[2:] == [
        "| 64 x 48  |           2.0 (1.0) | 1.0 (0.50) |", "| 128 x 96 |           4.0 (1.0) |          - |",
    ]  # fmt: skip


def test_command_prints_rewrites_a_page_and_gives_json(
    found: KindsBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[dict[str, object]] = []

    def measured(**options: object) -> KindsBench:
        asked.append({name: value for name, value in options.items() if name != "progress"})
        return found

    monkeypatch.setattr(bench, "measure_kinds", measured)
    first, last = KINDS_MARKS
    page = tmp_path / "page.md"
    page.write_text(f"{first}\nold\n{last}\n", encoding="utf-8")
    assert cli.main(["bench", "kinds", "--only", "points", "--update", str(page)]) == 0
    assert found.tables() in capsys.readouterr().out
    assert page.read_text(encoding="utf-8") == f"{first}\n\n{found.tables()}\n\n{last}\n"
    assert cli.main(["bench", "kinds", "--quick", "--rounds", "1", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert {row["subject"] for row in figures["rows"]} == set(SUBJECTS)
    assert asked == [
        {"only": ["points"], "rounds": 3, "threads": 1, "quick": False},
        {"only": None, "rounds": 1, "threads": 1, "quick": True},
    ]


def test_times_by_size_are_of_every_method() -> None:
    result = measure_kinds(only=[], rounds=1, quick=True)
    assert (result.rows, result.sizes) == ((), ())
    from rsflow.bench.kinds_run import _by_size

    rows = _by_size("points", methods_of("points"), 1, [(64, 48), (96, 72)], time.perf_counter)
    assert [row.size for row in rows] == [(64, 48)] * 4 + [(96, 72)] * 4
    assert rows[0].times == 1.0
    assert all(row.time_ms > 0 for row in rows)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"rounds": 0}, "rounds: got 0, expected"), ({"threads": 0}, "threads: got 0, expected"),
        ({"quick": 1}, "quick: got 1, expected"), ({"only": "points"}, 'only: got "points", expected a sequence'),
        ({"only": ["no such"]}, 'only: got "no such", expected the beginning of one of: dense flow; points; '),
    ],
)  # fmt: skip
def test_misuse_says_what_was_got(options: dict[str, object], says: str) -> None:
    with pytest.raises(rsflow.OptionError, match=says):
        measure_kinds(**options)  # type: ignore[arg-type]
