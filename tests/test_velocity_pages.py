"""The tutorial and the page on accuracy name what there is; tests/test_docs.py runs them."""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import rsflow
from rsflow import VelocityStatus, synthetic
from rsflow.cli import COMMANDS, Parser

DOCS = Path(__file__).resolve().parent.parent / "docs"
TUTORIAL = (DOCS / "tutorials" / "webcam_to_metres.md").read_text(encoding="utf-8")
ACCURACY = (DOCS / "explanation" / "velocity_accuracy.md").read_text(encoding="utf-8")


def drawing():
    spec = importlib.util.spec_from_file_location("draw_velocity_axes", DOCS / "explanation" / "draw_velocity_axes.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_status_is_explained():
    for status in VelocityStatus:
        assert f"\n| `{status.name}` | " in ACCURACY
        assert f"`{status.word}`" in TUTORIAL


def options_of(command: str) -> set[str]:
    module = importlib.import_module(COMMANDS[command][0])
    parser = Parser(prog=command)
    module.add_arguments(parser)
    return set(parser._option_string_actions)


def test_every_option_that_the_pages_name_is_one_of_the_commands():
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", re.sub(r"`v4l2-ctl[^`]*`", "", TUTORIAL + ACCURACY)))
    assert {"--print-board", "--height-std"} <= named
    assert named - options_of("velocity") - options_of("calibrate") - options_of("bench") == set()


def test_every_part_of_a_budget_is_explained():
    flight = synthetic.flight(frames=3, seed=1)
    camera = flight.camera
    estimator = rsflow.VelocityEstimator(camera, height_m=0.2, height_std_m=0.001, rate_std_rad_s=0.01)
    for frame in flight:
        velocity = estimator.update(frame.image, frame.t_s, rate_rad_s=(0.0, 0.0, 0.0))
    table = ACCURACY[ACCURACY.index("| part | ") : ACCURACY.index("**What the table says")]
    explained = set(re.findall(r"^\| ([a-z ]+)[,|]", table, re.MULTILINE))
    explained = {name.strip() for name in explained} | {"gyro"}
    assert {*velocity.parts, *velocity.unstated} - explained == set()


@pytest.mark.parametrize("number", range(6))
def test_the_drawing_shows_the_flow_of_exact_flights(number):
    module = drawing()
    _, _, velocity, rate = module.MOTIONS[number]
    height, small = 0.2, 1e-3
    flight = synthetic.flight(
        frames=2,
        times_s=(0.0, 1.0),
        height_m=height,
        velocity_m_s=small * height * np.array(velocity),
        rate_rad_s=small * np.array(rate),
    )
    camera = flight.camera
    rows, columns = np.indices(flight.images[0].shape)
    drawn = module.flow((columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, velocity, rate)
    exact = flight.flow(1) / (small * camera.fx)
    assert np.abs(np.moveaxis(drawn, 0, -1) - exact).max() < 2e-3


def test_the_drawing_in_the_folder_is_what_the_script_draws(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["draw_velocity_axes.py", str(tmp_path / "axes.svg")])
    drawing().main()

    def letters(path: Path) -> list[str]:
        return re.findall(r"<text[^>]*>([^<]*)</text>", path.read_text(encoding="utf-8"))

    assert letters(tmp_path / "axes.svg") == letters(DOCS / "explanation" / "velocity_axes.svg")
    assert "rate about z > 0" in "".join(letters(DOCS / "explanation" / "velocity_axes.svg")).replace("&gt;", ">")
