"""Height over a board on the ground: against exact poses, its deviation, and what it does to a velocity."""

from __future__ import annotations

import dataclasses
import json
from functools import cache

import cv2
import numpy as np
import pytest

import rsflow
from calibration_helpers import BOARD, SQUARE_M, TRUTH, calibration, chessboard, poses, render
from rsflow.calibration import Board, BoardHeight, height_over_board
from rsflow.cli import main

ON_FLOOR = Board(BOARD, SQUARE_M)


def truth_of(pose) -> tuple[float, np.ndarray]:
    """Height over the board, and straight down in the camera's axes."""
    normal = cv2.Rodrigues(pose[0])[0][:, 2]
    distance = float(normal @ pose[1])
    return abs(distance), normal * np.sign(distance)


@cache
def seen() -> list[tuple[BoardHeight, float, np.ndarray]]:
    views = [(pose, render(pose, chessboard(), seed=100 + i)) for i, pose in enumerate(poses(24, seed=9))]
    return [(height_over_board(view, TRUTH, board=ON_FLOOR, square_std_m=0.0), *truth_of(pose)) for pose, view in views]


def test_heights_and_the_way_down_are_those_of_the_scene():
    for found, height, down in seen():
        assert abs(found.height_m / height - 1) < 1e-3
        assert np.arccos(np.clip(found.down @ down, -1, 1)) < 3e-3
        assert found.range_m == pytest.approx(found.height_m / found.down[2])
        assert found.unstated == ("focal length",)


def test_deviations_hold_and_are_not_idle():
    far = np.array([(found.height_m - height) / found.height_std_m for found, height, _ in seen()])
    turned = [np.linalg.norm(found.down - down) / found.down_std_rad for found, _, down in seen()]
    # Of two angles together the square is 2 on average; corners are said to be known no better than to 0.05 px.
    assert 0.3 < np.sqrt(np.mean(far**2)) < 1.3
    assert 0.3 < np.sqrt(np.mean(np.square(turned))) < 1.8


def test_deviations_of_focal_length_and_squares_are_in_it():
    pose = (np.array([0.05, 0.02, 0.1]), np.array([0.01, 0.0, 0.4]))
    view = render(pose, chessboard())
    share = 0.004
    camera = dataclasses.replace(TRUTH, std={"fx": share * TRUTH.fx, "fy": share * TRUTH.fy})
    stated = height_over_board(view, camera, board=ON_FLOOR, square_std_m=0.0)
    plain = height_over_board(view, TRUTH, board=ON_FLOOR)
    assert (stated.unstated, plain.unstated) == ((), ("squares", "focal length"))
    squares = height_over_board(view, TRUTH, board=ON_FLOOR, square_std_m=0.01 * SQUARE_M)
    assert squares.height_std_m == pytest.approx(np.hypot(plain.height_std_m, 0.01 * plain.height_m), rel=1e-3)
    # Seen from above the height is proportional to the focal length.
    expected = np.hypot(plain.height_std_m, share * plain.height_m)
    assert stated.height_std_m == pytest.approx(expected, rel=0.1)


def test_an_error_of_the_focal_length_drops_out_of_a_velocity():
    wrong = dataclasses.replace(TRUTH, fx=1.01 * TRUTH.fx, fy=1.01 * TRUTH.fy)
    pose = (np.array([0.0, 0.0, 0.2]), np.array([0.0, 0.0, 0.4]))
    view = render(pose, chessboard())
    heights = [height_over_board(view, camera, board=ON_FLOOR).height_m for camera in (TRUTH, wrong)]
    assert heights[1] / heights[0] == pytest.approx(1.01, abs=1e-3)
    flight = rsflow.synthetic.flight(TRUTH, frames=3, height_m=0.4, velocity_m_s=(0.1, 0.0, 0.0), seed=3)
    speeds = []
    for camera, height in zip((TRUTH, wrong), heights, strict=True):
        estimator = rsflow.VelocityEstimator(camera, height_m=height)
        measured = [estimator.update(frame.image, frame.t_s, rate_rad_s=(0.0, 0.0, 0.0)) for frame in flight]
        speeds.append(measured[-1].speed_m_s)
    assert speeds[0] == pytest.approx(0.1, rel=3e-3)
    # But for what distortion makes of it: the deviation of a percent becomes a quarter of one.
    assert speeds[1] / speeds[0] == pytest.approx(1.0, abs=3e-3)


def test_what_cannot_be_measured_is_told():
    view = render(poses(1)[0], chessboard())
    with pytest.raises(rsflow.CalibrationError, match="is not seen whole"):
        height_over_board(np.full_like(view, 90), TRUTH, board=ON_FLOOR)
    # A picture that is bent shows what no flat board looks like.
    rows, columns = np.indices(view.shape, np.float32)
    wavy = cv2.remap(view, columns + 6 * np.sin(rows / 20), rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    with pytest.raises(rsflow.CalibrationError, match=r"does not fit: its corners lie \d+\.\d px"):
        height_over_board(wavy, TRUTH, board=ON_FLOOR)
    with pytest.raises(rsflow.ShapeError, match=r"use camera\.scaled"):
        height_over_board(view[:-1], TRUTH, board=ON_FLOOR)
    with pytest.raises(rsflow.DTypeError, match=r"board: got \(8, 6\), expected a Board"):
        height_over_board(view, TRUTH, board=BOARD)


def test_the_command_prints_the_height_and_the_options_of_velocity(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pose = (np.array([0.1, 0.02, 0.1]), np.array([0.01, 0.0, 0.4]))
    cv2.imwrite("floor0.png", render(pose, chessboard()))
    cv2.imwrite("floor1.png", np.full(TRUTH.size[::-1], 90, np.uint8))
    calibration().save("camera.yaml")
    arguments = ["calibrate", "floor*.png", "--board", "8x6", "--square", "0.025", "--height-with", "camera.yaml"]
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert "without the deviation of: squares" in out
    assert "--height-std" not in out
    assert main([*arguments, "--square-std", "0.00005"]) == 0
    out, err = capsys.readouterr()
    assert "picture 1: the board of 8 x 6 is not seen whole" in err
    told = next(line for line in out.splitlines() if line.startswith("rsflow velocity SOURCE --camera camera.yaml "))
    height, std = float(told.split()[6]), float(told.split()[8])
    assert abs(height - truth_of(pose)[0]) < 4 * std < 0.004
    assert "The camera is tilted: straight down is " in out
    assert main([*arguments, "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["picture"] == 0
    assert row["height_m"] == pytest.approx(height, rel=1e-4)
    assert main(["calibrate", "floor1.png", *arguments[2:]]) == 1
    assert "no picture shows the board" in capsys.readouterr().err
    assert main([*arguments, "-o", "c.yaml"]) == 2
    assert "argument -o/--output: not allowed with argument --height-with" in capsys.readouterr().err
    assert main([*arguments[:6], "--square-std", "0.001"]) == 2
    assert "argument --square-std: not allowed without argument --height-with" in capsys.readouterr().err
