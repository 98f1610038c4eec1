"""`rsflow bench segmentation`: its kinds are what they say, its counts right, and rivals get what users give them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import bench, cli
from rsflow.bench import SEGMENTATION_MARKS, SegmentationBench, SegmentationRow, measure_segmentation
from rsflow.bench.segmentation_kinds import Kind, kinds
from rsflow.bench.segmentation_rivals import Stabiliser, filtered, subtractors, variants
from rsflow.bench.segmentation_run import LEARNING_FRAMES, Counts, _best, counted, rows_of
from rsflow.synthetic import Sensor, Thing, moving_things

EVERY = kinds()
SIZE = (96, 72)


@pytest.fixture(scope="module")
def found() -> SegmentationBench:
    before = rsflow.get_num_threads(), cv2.getNumThreads()
    result = measure_segmentation(only=["10 px/frame, static", "empty, static"], quick=True)
    assert (rsflow.get_num_threads(), cv2.getNumThreads()) == before
    return result


def test_all_methods_are_measured_on_the_same_clips(found: SegmentationBench) -> None:
    methods = ["rsflow", *subtractors()]
    assert [(row.kind, row.method) for row in found.rows] == [
        (kind, method) for kind in ("10 px/frame, static camera", "empty, static camera") for method in methods
    ]
    moving, empty = found.rows[: len(methods)], found.rows[len(methods) :]
    best = {row.method: row for row in moving}
    # A background subtractor finds most of what moves by 10 pixels before a camera that stands.
    assert best["OpenCV KNN"].f > 0.6
    assert best["rsflow"].f > 0.5
    for row in moving:
        assert row.f == pytest.approx(2 / (1 / row.precision + 1 / row.recall))
        assert 0 <= row.far <= row.false <= 1
        assert row.time_ms > 0
    assert all(math.isnan(row.f) and math.isnan(row.recall) for row in empty)
    assert empty[0].false < 0.002


def test_counts_of_masks_that_are_known() -> None:
    truth = np.zeros((LEARNING_FRAMES + 1, 20, 30), np.bool_)
    truth[:, 5:10, 5:10] = True
    called = np.zeros_like(truth)
    # In the first frames all is wrong, and does not count.
    called[:LEARNING_FRAMES] = ~truth[:LEARNING_FRAMES]
    called[-1, 5:10, 6:12] = True
    called[-1, 18, 28] = True
    counts = counted(list(called), list(truth))
    assert counts == Counts(right=20, false=11, missed=5, far=1, still=575)
    row = (counts + counts).row("kind", "method", 1.5, (3, True))
    assert (row.precision, row.recall) == (20 / 31, 0.8)
    assert row.f == pytest.approx(40 / 56)
    assert row.false == pytest.approx(11 / 575)
    assert (row.median_px, row.shadows, row.time_ms) == (3, True, 1.5)


def test_rivals_get_their_best_filter() -> None:
    right = {(0, False): Counts(8, 4, 2, 0, 90), (3, False): Counts(9, 2, 1, 0, 90), (5, False): Counts(7, 0, 3, 0, 90)}
    assert _best(right) == (3, False)
    nothing = {
        (0, False): Counts(0, 4, 0, 0, 90),
        (3, True): Counts(0, 1, 0, 0, 90),
        (5, False): Counts(0, 2, 0, 0, 90),
    }
    assert _best(nothing) == (3, True)
    assert len(variants("OpenCV MOG2")) == 10
    assert len(variants("OpenCV GSOC")) == 5
    levels = np.zeros((20, 20), np.uint8)
    levels[2, 2], levels[10:16, 4:10], levels[10:16, 12:18] = 255, 255, 127
    plain, clean, shaded = (filtered([levels], variant)[0] for variant in ((0, False), (3, False), (3, True)))
    assert plain.sum() == 37
    assert not clean[2, 2]
    assert clean.sum() == 32
    assert shaded.sum() == 64


def test_a_stabilised_rival_sees_still_ground_as_still() -> None:
    """A subtractor that tells of each pixel whether it differs from the first frame: nothing, once laid over it."""

    class Difference:
        def __init__(self) -> None:
            self.first: np.ndarray | None = None

        def apply(self, image: np.ndarray) -> np.ndarray:
            self.first = image if self.first is None else self.first
            return np.where(cv2.absdiff(image, self.first) > 25, np.uint8(255), np.uint8(0))

    thing = Thing(50.0, 60.0, dx=1.5, width=30.0, height=24.0, level=230.0, contrast_levels=0.0)
    sensor = Sensor(noise=0.5, blur_px=0.7)
    for camera in ("pan", "hand_held", "turn"):
        scene = moving_things([thing], frames=14, size=(160, 120), camera=camera, sensor=sensor, seed=1)
        steady = Stabiliser(Difference, 0.5)
        said = [steady.apply(image) > 0 for image in scene.images][-1]
        # What was at the thing's first place differs as well.
        back = cv2.warpPerspective(scene.masks[0].astype(np.uint8), scene.homographies[-1], (160, 120)) > 0
        near = cv2.dilate((scene.masks[-1] | back).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        known = cv2.erode(cv2.warpPerspective(np.ones((120, 160), np.uint8), scene.homographies[-1], (160, 120)),
                          np.ones((7, 7), np.uint8)) > 0  # fmt: skip
        assert said[scene.masks[-1]].mean() > 0.8
        assert said[known & ~near].mean() < 0.03
        raw = cv2.absdiff(scene.images[-1], scene.images[0]) > 25
        assert raw[known & ~near].mean() > 0.1


def test_a_stabilised_rival_starts_anew_where_the_view_leaves_its_canvas() -> None:
    made = []

    class Nothing:
        def __init__(self) -> None:
            made.append(self)

        def apply(self, image: np.ndarray) -> np.ndarray:
            return np.zeros(image.shape, np.uint8)

    scene = moving_things(0, frames=12, size=(160, 120), camera="pan", camera_speed=8.0, seed=1)
    steady = Stabiliser(Nothing, 0.25)
    assert all(steady.apply(image).shape == (120, 160) for image in scene.images)
    # A quarter of 120 to 160 pixels at 8 a frame: 3 to 5 frames each.
    assert 3 <= len(made) <= 5


@pytest.mark.parametrize("kind", EVERY, ids=[kind.name for kind in EVERY])
def test_kinds_are_what_their_names_say(kind: Kind) -> None:
    scene = kind.make(0, 3, SIZE)
    assert scene.images.shape == (3, 72, 96)
    assert scene.masks.any() != kind.empty
    moved = bool(np.abs(scene.homographies - np.eye(3)).max() > 1e-9)
    assert moved != kind.still_camera
    assert moved != ("static" in kind.name)
    if " px/frame, " in kind.name and not kind.name.startswith(("pan", "zoom")):
        speeds = np.hypot(*np.moveaxis(scene.velocities_px, -1, 0))
        np.testing.assert_allclose(speeds[np.isfinite(speeds)], float(kind.name.split()[0]))
    assert (kind.name.startswith("empty")) == kind.empty


def test_names_are_given_once_and_light_changes() -> None:
    names = [kind.name for kind in EVERY]
    assert len(set(names)) == len(names)
    (kind,) = [kind for kind in EVERY if kind.name == "empty, light switch, static camera"]
    means = kind.make(0, 9, SIZE).images.mean(axis=(1, 2))
    assert (means[3:6] < 0.8 * means[0]).all()
    np.testing.assert_allclose(means[[1, 2, 6, 7, 8]], means[0], rtol=0.01)


def test_rows_of_a_tiny_clip() -> None:
    kind = Kind("tiny", {"things": 1, "speed_px": 3.0, "textured": False, "contrast_levels": 5.0})
    rows = rows_of(kind, [kind.make(clip, LEARNING_FRAMES + 4, SIZE) for clip in range(2)])
    assert [row.method for row in rows] == ["rsflow", *subtractors()]
    assert {row.kind for row in rows} == {"tiny"}
    assert max(row.f for row in rows) > 0.5


def test_tables_are_markdown(found: SegmentationBench) -> None:
    table, ground = found.tables().split("\n\n")
    lines = table.splitlines()
    assert {(line.count("|"), line[0], line[-1]) for line in lines} == {(9, "|", "|")}
    assert len(lines) == 2 + len(found.rows)
    assert sum("10 px/frame, static camera" in line for line in lines) == 1
    assert "1 thread, 1 clip of 24 frames of 160 x 120 a kind" in ground
    row = SegmentationRow("a", "OpenCV KNN", math.nan, math.nan, math.nan, 0.01, 0.0, 1.0, 5, True)
    shown = SegmentationBench((row,), "avx2", 2, 3, 90, (320, 240), {}).tables()
    assert "| a    | OpenCV KNN, median 5, shadows | - |" in shown
    assert "2 threads, 3 clips" in shown


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"clips": 0}, "clips: got 0, expected an integer from 1"),
        ({"threads": 0}, "threads: got 0, expected an integer from 1"),
        ({"only": "static"}, 'only: got "static", expected a sequence of names'),
        ({"only": ["no such"]}, 'only: got "no such", expected the beginning of one of: static camera; '),
    ],
)
def test_misuse_says_what_was_got(options: dict[str, object], message: str) -> None:
    with pytest.raises(rsflow.OptionError, match=message):
        measure_segmentation(**options)  # type: ignore[arg-type]


def test_command_prints_the_table_and_rewrites_a_page(
    found: SegmentationBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[dict[str, object]] = []
    monkeypatch.setattr(bench, "measure_segmentation", lambda **options: asked.append(options) or found)
    page = tmp_path / "page.md"
    page.write_text("\n".join(("Before.", *SEGMENTATION_MARKS, "After.", "")), encoding="utf-8")
    assert cli.main(["bench", "segmentation", "--only", "empty", "--clips", "3", "--update", str(page)]) == 0
    assert found.tables() in capsys.readouterr().out
    first, last = SEGMENTATION_MARKS
    assert page.read_text(encoding="utf-8") == f"Before.\n{first}\n\n{found.tables()}\n\n{last}\nAfter.\n"
    assert (asked[0]["only"], asked[0]["clips"], asked[0]["threads"]) == (["empty"], 3, 1)
    assert cli.main(["bench", "segmentation", "--json", "--threads", "2"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["rows"][-1]["f"] is None
    assert figures["size"] == [160, 120]
    assert (asked[1]["only"], asked[1]["clips"], asked[1]["threads"]) == (None, 2, 2)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["bench", "--clips", "2"], "--clips: got 2, expected it with rsflow bench segmentation alone"),
        (["bench", "segmentation", "--flights", "2"], "--flights: got 2, expected it with rsflow bench velocity alone"),
        (["bench", "segmentation", "--rounds", "2"], "--rounds: got 2, expected it without segmentation"),
        (["bench", "segmentation", "--only", "x"], 'only: got "x"'),
    ],
)
def test_command_refuses(line: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(line) == 1
    assert message in capsys.readouterr().err
