"""`check_scale` against a known velocity, speed or way, and ``rsflow velocity --check-scale``."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

import rsflow
from rsflow import ScaleStatus, VideoWriter, synthetic
from rsflow._rotation import rotation_matrix
from rsflow.cli import main
from scale_clips import LENS, waves

WRONG = dataclasses.replace(LENS, fx=1.07 * LENS.fx, fy=1.07 * LENS.fy)
STATED = {"height_m": 0.5, "height_std_m": 0.0005, "known_std": 0.0002}


def flown(seed, velocity, *, frames=50, readout_s=0.0):
    return synthetic.flight(LENS, frames=frames, height_m=0.5, velocity_m_s=velocity, readout_s=readout_s, seed=seed)


def test_a_known_velocity_tells_axes_yaw_delay_and_readout():
    speed = waves(1, 0.2, (1.0, 1.0, 0.0))
    clip = flown(1, speed, readout_s=0.015, frames=80)
    t = np.arange(-20, 160) / 50
    known = speed(t - 0.05) @ rotation_matrix((0.0, 0.0, 0.1))
    check = rsflow.check_scale(clip, WRONG, t_s=t, velocity_m_s=known[:, [1, 0, 2]], **STATED)
    assert check.axes == ("+y", "+x", "?")
    assert check.focal_px.value == pytest.approx(150.0, rel=0.01)
    assert 150.0 in check.focal_px
    assert check.yaw_rad.value == pytest.approx(0.1, abs=0.01)
    assert check.delay_s.value == pytest.approx(0.05, abs=0.002)
    assert check.readout_s.value == pytest.approx(0.015, abs=0.002)
    said = "\n".join(check.findings)
    assert "x and y are swapped" in said
    assert "the log of the velocity lags by" in said
    assert "or the height is" in said


def test_the_right_velocity_finds_nothing():
    speed = waves(2, 0.2, (1.0, 1.0, 0.0))
    t = np.arange(-20, 120) / 50
    check = rsflow.check_scale(flown(2, speed), LENS, t_s=t, velocity_m_s=speed(t), readout_s=0.0, **STATED)
    assert check.ok, check.findings
    assert check.axes == ("+x", "+y", "?")
    assert 0.0 in check.delay_s
    assert 1.0 in check.focal_ratio


def test_one_direction_does_not_tell_a_turn_from_a_mirror():
    check = rsflow.check_scale(
        flown(3, (0.2, 0.1, 0.0)),
        LENS,
        t_s=np.arange(80) / 30 - 0.3,
        velocity_m_s=np.tile((0.2, 0.1), (80, 1)),
        readout_s=0.0,
        **STATED,
    )
    assert check.axes == ("?", "?", "?")
    assert not check.delay_s.known
    assert math.isnan(check.delay_s.value)
    assert check.findings == ()
    assert 1.0 in check.focal_ratio


@pytest.mark.parametrize("readout_s", [0.0, None])
def test_intervals_of_speed_and_way_hold_the_truth(readout_s):
    inside = []
    for seed in range(20, 28):
        rng = np.random.default_rng(seed)
        angle = rng.uniform(0, 2 * np.pi)
        clip = flown(seed, (0.2 * np.cos(angle), 0.2 * np.sin(angle), 0.0), frames=16)
        speed = 0.2 + 0.001 * rng.standard_normal()
        stated = {"height_m": 0.5 + 0.002 * rng.standard_normal(), "height_std_m": 0.002, "readout_s": readout_s}
        check = rsflow.check_scale(clip, WRONG, speed_m_s=speed, known_std=0.001, **stated)
        way = rsflow.check_scale(clip, WRONG, distance_m=speed * 0.5, known_std=0.0005, **stated)
        inside += [150.0 in check.focal_px, 150.0 in way.focal_px]
        assert check.focal_ratio.std < (0.02 if readout_s == 0.0 else 0.035)
    # Speed and way of a clip share its height: 8 of them, of which 7 or 8 should be inside.
    assert np.sum(inside) >= 13


def test_what_was_not_stated_is_said():
    check = rsflow.check_scale(flown(3, (0.2, 0.1, 0.0)), LENS, speed_m_s=np.hypot(0.2, 0.1), height_m=0.5)
    untold = "\n".join(check.untold)
    assert "how exact the height is was not stated" in untold
    assert "how exact the speed is was not stated" in untold
    assert "the readout time:" in untold


def test_a_speed_of_another_clip_and_a_still_one():
    t = np.arange(-20, 120) / 50
    velocity = waves(30, 0.2, (1.0, 1.0, 0.0))(t)
    other = rsflow.check_scale(flown(2, waves(2, 0.2, (1.0, 1.0, 0.0))), LENS, t_s=t, velocity_m_s=velocity, **STATED)
    assert other.status is ScaleStatus.NO_MATCH
    assert not other.focal_px.known
    still = rsflow.check_scale(flown(4, (0.0, 0.0, 0.0), frames=10), LENS, speed_m_s=0.1, **STATED)
    assert still.status is ScaleStatus.NO_MOTION


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("check")
    turning = waves(5, 0.5, (1.0, 1.0, 1.0))
    clip = synthetic.flight(LENS, frames=60, height_m=1.0, velocity_m_s=(0, 0, 0), rate_rad_s=turning, seed=5)
    log = synthetic.Gyro(rate_hz=200.0, delay_s=0.041, noise_rad_s=0.003, seed=5).log(clip)
    with VideoWriter(where / "turn.mp4", frame_rate=30) as video:
        for frame in clip:
            video.write(frame.image)
    WRONG.save(where / "cam.json")
    rows = [f"{t * 1e3},{x},{-y},{z}" for t, (x, y, z) in zip(log.t_s + 100, log.rate_rad_s, strict=True)]
    (where / "gyro.csv").write_text("t_ms,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s\n" + "\n".join(rows))
    (where / "speed.csv").write_text("t_s,speed_m_s\n" + "\n".join(f"{k / 10},0.2" for k in range(30)))
    with VideoWriter(where / "way.mp4", frame_rate=30) as video:
        for frame in flown(6, (0.2, 0.0, 0.0), frames=20):
            video.write(frame.image)
    return where


def test_command_against_a_gyro(folder, capsys):
    words = [str(folder / "turn.mp4"), "--camera", str(folder / "cam.json"), "--check-scale"]
    words += ["--rates", str(folder / "gyro.csv"), "--log-start", "100"]
    assert main(["velocity", *words]) == 0
    said = capsys.readouterr().out
    assert "wrong: the sign of y is wrong" in said
    assert "wrong: the gyro lags by 4" in said
    assert "wrong: the focal length is 7." in said
    assert main(["velocity", *words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["delay_s"] == pytest.approx(0.041, abs=0.001)
    assert found["axis_y"] == "-y"
    assert found["focal_px"] == pytest.approx(150.0, rel=0.01)
    assert len(found["findings"]) >= 3
    # A delay that was stated is taken off.
    assert main(["velocity", *words, "--rate-delay", "0.041", "--json"]) == 0
    assert abs(json.loads(capsys.readouterr().out)["delay_s"]) < 0.001


@pytest.mark.parametrize(
    "known",
    [["--known-speed", "0.2"], ["--known-distance", str(0.2 * 19 / 30)], ["--known-velocity", "speed.csv"]],
    ids=lambda known: known[0],
)
def test_command_against_what_is_known(folder, capsys, known):
    known = [str(folder / word) if word.endswith(".csv") else word for word in known]
    words = [str(folder / "way.mp4"), "--camera", str(folder / "cam.json"), "--check-scale", "--height", "0.5"]
    assert main(["velocity", *words, *known, "--known-std", "0.0005", "--height-std", "0.001", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["focal_px"] == pytest.approx(150.0, rel=0.01)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--check-scale"], 1, "got --check-scale alone, expected one of them"),
        (["--check-scale", "--known-speed", "1"], 1, "--height: got none"),
        (["--check-scale", "--known-speed", "1", "--rates", "gyro.csv"], 1, "got --rates and --known-speed"),
        (["--known-speed", "1", "--height", "1"], 1, "expected it together with --check-scale"),
        (["--rates", "gyro.csv"], 2, "one of the arguments --height --height-csv --range-csv is required"),
        (["--check-scale", "--known-speed", "1", "--known-distance", "1"], 2, "not allowed with argument"),
    ],
)
def test_command_misused(folder, capsys, words, code, said):
    words = [str(folder / word) if word.endswith(".csv") else word for word in words]
    assert main(["velocity", str(folder / "way.mp4"), "--camera", str(folder / "cam.json"), *words]) == code
    assert said in capsys.readouterr().err
