"""The programs in examples/ run as they are, and say what they should."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import rsflow

FOLDER = Path(__file__).resolve().parent.parent / "examples"
SAYS = {
    "autopilot.py": (r"1\.000 s: flow [+-]0\.00\d, \+0\.(79|80)\d rad/s, quality 255", {"flow.tlog"}),
    "dense_flow.py": (r"9\d% of the pixels valid", {"arrows.png", "colors.png", "motion.flo"}),
    "displacement.py": (r"\+7\.2\d\d px to the right, -3\.[45]\d\d px down", set()),
    "ground_speed.py": (r"0\.233 s: \+0\.0(199|20\d) m/s to the right, -0\.0(099|10\d) m/s", set()),
    "moving_things.py": (r"frame 11: 1 at \(\d+, \d+\) moves; the camera: translation", {"moving.mp4", "static.mp4"}),
    "points.py": (r"frame 7: 1\d\d tracked", set()),
}


def run(name: str, folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", FOLDER / name, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_here() -> None:
    assert {path.name for path in FOLDER.glob("*.py")} == set(SAYS)


@pytest.mark.parametrize("name", SAYS)
def test_an_example_without_input(name: str, tmp_path: Path) -> None:
    pattern, files = SAYS[name]
    printed = run(name, tmp_path)
    assert re.search(pattern, printed), printed
    assert {path.name for path in tmp_path.iterdir()} == files
    assert all(path.stat().st_size > 1000 for path in tmp_path.iterdir())


def test_the_examples_on_files(tmp_path: Path) -> None:
    flight = rsflow.synthetic.flight(frames=4, height_m=0.2, velocity_m_s=(0.02, -0.01, 0.0))
    with rsflow.VideoWriter(tmp_path / "clip.mp4", frame_rate=30) as video:
        for frame in flight:
            video.write(frame.image)
    flight.camera.save(tmp_path / "camera.yaml")
    assert "0.100 s: +0.0" in run("ground_speed.py", tmp_path, "clip.mp4", "camera.yaml", "0.2")
    assert "frame 3: " in run("points.py", tmp_path, "clip.mp4")
    assert "frame 3: " in run("moving_things.py", tmp_path, "clip.mp4")
