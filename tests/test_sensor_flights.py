"""Longer flights with a gyro: the path that it turns, and what is learned of it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import cli
from rsflow.synthetic import Gyro, flight
from sensor_helpers import table, turning, written


@pytest.mark.parametrize("logs", [True, False], ids=["a gyro", "no gyro"])
def test_the_path_of_a_flight_that_turns(tmp_path: Path, logs: bool) -> None:
    """Three quarters of a circle: the heading is the gyro's integral, or what the picture shows of it."""
    f = flight(frames=40, rate_hz=20.0, height_m=1.0, velocity_m_s=(1.0, 0.0, 0.0), rate_rad_s=(0.0, 0.0, 2.4), seed=2)
    for k, image in enumerate(f.images):
        cv2.imwrite(str(tmp_path / f"{k:03d}.png"), image)
    f.camera.save(tmp_path / "cam.json")
    gyro = Gyro(rate_hz=200.0, bias_rad_s=(0.0, 0.0, 0.02), seed=1).log(f)
    written(tmp_path / "gyro.csv", "t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s", gyro.t_s, *gyro.rate_rad_s.T)
    command = ["velocity", str(tmp_path / "*.png"), "--rate", "20", "--camera", str(tmp_path / "cam.json")]
    command += ["--height", "1", "--height-std", "0.01", "-o", str(tmp_path / "out")]
    command += ["--rates", str(tmp_path / "gyro.csv"), "--rate-std", "0.02"] if logs else []
    assert cli.main(command) == 0
    rows = table(tmp_path / "out/trajectory.csv")
    place = np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
    true = f.position_m[:, :2] - f.position_m[0, :2]
    assert np.abs(place - true).max() < 0.04
    assert float(rows[-1]["heading_rad"]) == pytest.approx(2.4 * f.t_s[-1], abs=0.06)
    if logs:
        std = np.array([[float(row["x_std_m"]), float(row["y_std_m"])] for row in rows])
        assert (np.abs(place - true)[1:] <= 2.5 * std[1:]).all()
        off = abs(float(rows[-1]["heading_rad"]) - 2.4 * f.t_s[-1])
        assert off <= 3 * float(rows[-1]["heading_std_rad"])


def test_a_gyro_that_is_late_and_biased_is_learned_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Three seconds of rocking by a gyro that lags by 25 ms and shows 0.03 rad/s at rest."""
    f = flight(frames=120, rate_hz=40.0, height_m=1.0, velocity_m_s=(0.5, 0.0, 0.0), rate_rad_s=turning, seed=4)
    with rsflow.VideoWriter(tmp_path / "clip.mp4", frame_rate=40.0) as video:
        for frame in f:
            video.write(frame.image)
    f.camera.save(tmp_path / "cam.json")
    gyro = Gyro(rate_hz=200.0, delay_s=0.025, bias_rad_s=(0.0, 0.0, 0.03), seed=1).log(f)
    written(tmp_path / "gyro.csv", "t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s", gyro.t_s, *gyro.rate_rad_s.T)
    written(tmp_path / "down.csv", "t_s,down_x,down_y,down_z", f.t_s, *f.down.T)
    written(tmp_path / "heights.csv", "t_s,height_m", f.t_s, f.height_m)
    command = ["velocity", str(tmp_path / "clip.mp4"), "--camera", str(tmp_path / "cam.json"), "--json"]
    for option in ("height-csv", "rates", "attitude"):
        name = {"height-csv": "heights", "rates": "gyro", "attitude": "down"}[option]
        command += [f"--{option}", str(tmp_path / f"{name}.csv")]
    assert cli.main([*command, "-o", str(tmp_path / "out")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["gyro"]["bias_rad_s"][2] == pytest.approx(0.03, abs=0.01)
    learned = summary["gyro"]
    assert abs(learned["delay_s"] - 0.025) < 4.5 * learned["delay_std_s"] < 0.1
    assert cli.main([*command, "-o", str(tmp_path / "told"), "--rate-delay", "0.025", "--rate-delay-std", "0.001"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["gyro"]["delay_s"] == pytest.approx(0.025, abs=0.002)
    assert not any("the rates come" in note for note in summary["notes"])
