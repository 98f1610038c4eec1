"""Lines that things cross and metres for each pixel, in `rsflow extract` and `rsflow batch`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import rsflow
from rsflow import synthetic
from rsflow.cli import main


@pytest.fixture(scope="module")
def walk() -> np.ndarray:
    thing = synthetic.Thing(40.0, 60.0, dx=2.0, width=24.0, height=18.0, seed=5)
    return synthetic.moving_things([thing], frames=36, size=(160, 120), seed=2).images


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "objects.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_what_crosses_is_counted_and_speeds_are_in_metres(walk: np.ndarray, tmp_path: Path) -> None:
    done = rsflow.extract(
        walk, tmp_path, frame_rate=10, lines=[(80, 119, 80, 0), (0, 20, 159, 20)], scale_m_per_px=0.05, videos=False
    )
    first, second = done.summary["lines"]
    assert (first["to_right"], first["to_left"]) == (1, 0)
    assert (second["to_right"], second["to_left"]) == (0, 0)
    assert "1 crossed 80,119,80,0 to the right, 0 to the left." in done.summary["answers"][2]
    # 2 px a frame, 10 frames a second, 0.05 m a pixel.
    assert float(rows(tmp_path)[-1]["vx_m_s"]) == pytest.approx(1.0, rel=0.05)
    assert done.summary["thing_speed_unit"] == "m/s"
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "stroke-dasharray" in page
    assert "1 &gt; &lt; 0" in page


def test_lines_are_in_the_whole_picture_whatever_part_is_looked_at(walk: np.ndarray, tmp_path: Path) -> None:
    done = rsflow.extract(
        walk, tmp_path, frame_rate=10, roi=(20, 20, 140, 90), lines=[(80, 119, 80, 0), (60, 119, 60, 80)], videos=False
    )
    assert [line["to_right"] for line in done.summary["lines"]] == [1, 0]
    assert done.summary["lines"][0]["x0_px"] == 80


def test_a_camera_and_a_scale_would_both_say_the_metres() -> None:
    with pytest.raises(rsflow.OptionError, match="scale_m_per_px"):
        rsflow.extract("clip.mp4", "out", camera="cam.yaml", height_m=0.2, scale_m_per_px=0.1)
    for lines in ([(1, 2, 3)], [(1, 2, 1, 2)], [("a", 0, 1, 1)], 5):
        with pytest.raises(rsflow.RsflowError):
            rsflow.extract("clip.mp4", "out", lines=lines)  # type: ignore[arg-type]


def test_the_commands_have_the_same_words(walk: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import cv2

    (tmp_path / "in").mkdir()
    for number, image in enumerate(walk):
        cv2.imwrite(str(tmp_path / "in" / f"{number:03d}.png"), image)
    told = ["--line", "80,119,80,0", "--scale", "0.05", "--rate", "10"]
    assert main(["extract", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--no-videos", "-q", *told]) == 0
    assert main(["batch", str(tmp_path / "in"), "-o", str(tmp_path / "many"), "--jobs", "1", "--no-videos", *told]) == 0
    assert main(["segment", str(tmp_path / "in"), "-o", str(tmp_path / "seg"), "--camera-motion", "static", *told]) == 0
    told_of = capsys.readouterr().out
    assert "1 crossed 80,119,80,0 to the right, 0 to the left." in told_of
    assert "px/s" not in told_of.splitlines()[-3]
    assert " m/s" in told_of.splitlines()[-3]
    counts = [
        json.loads(path.read_text())["lines"][0]["to_right"]
        for path in (tmp_path / "out/summary.json", tmp_path / "many/in/summary.json", tmp_path / "seg/objects.json")
    ]
    assert counts == [1, 1, 1]
    assert main(["extract", "clip.mp4", "-o", "out", "--line", "1,2,3"]) == 2
