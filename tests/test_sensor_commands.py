"""``velocity``, ``extract`` and ``live`` with logs of sensors, on made flights whose truth is known."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import cli
from rsflow.synthetic import Flight, Gyro, RangeFinder, flight
from rsflow.velocity import mounting
from sensor_helpers import table, turning, velocities, written

RATE, FRAMES = 30.0, 16
# The clock of an autopilot runs since it was started.
START_S = 312.4


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Flight]:
    """A flight that rocks and turns, as pictures, with the logs of its instruments in our and in PX4's columns."""
    folder = tmp_path_factory.mktemp("flight")
    f = flight(
        frames=FRAMES, rate_hz=RATE, height_m=1.0, velocity_m_s=(0.4, -0.2, 0.1), rate_rad_s=turning,
        tilt_rad=(0.05, 0.1), seed=5,
    )  # fmt: skip
    for k, image in enumerate(f.images):
        cv2.imwrite(str(folder / f"{k:03d}.png"), image)
    f.camera.save(folder / "cam.json")
    gyro = Gyro(rate_hz=250.0, noise_rad_s=0.001, seed=1).log(f)
    written(folder / "gyro.csv", "t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s", gyro.t_s, *gyro.rate_rad_s.T)
    late = Gyro(rate_hz=250.0, delay_s=0.02, seed=1).log(f)
    written(folder / "late.csv", "t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s", late.t_s, *late.rate_rad_s.T)
    ranges = RangeFinder(rate_hz=50.0, noise_m=0.001, seed=1).log(f)
    written(
        folder / "ranges.csv", "t_s,range_m,range_std_m", ranges.t_s, ranges.range_m, np.full(len(ranges.t_s), 0.001)
    )
    written(folder / "heights.csv", "t_ms,height_m", 1000 * f.t_s, f.height_m)
    written(folder / "down.csv", "t_s,down_x,down_y,down_z", f.t_s, *f.down.T)
    # The same on a vehicle: the camera looks down, the top of its picture to the front; its clock is another.
    R = mounting("x-right")
    us = 1e6 * (gyro.t_s + START_S)
    written(
        folder / "px4_gyro.csv", "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2]", us.round(), *(gyro.rate_rad_s @ R.T).T
    )
    us = 1e6 * (ranges.t_s + START_S)
    written(folder / "px4_range.csv", "timestamp,current_distance", us.round(), ranges.range_m)
    x, y, z = (f.down @ R.T).T
    roll, pitch = np.degrees(np.arctan2(y, z)), np.degrees(np.arcsin(-x))
    us = 1e6 * (f.t_s + START_S)
    written(folder / "ardupilot.csv", "timestamp,TimeUS,Roll,Pitch", us, us.round(), roll, pitch)
    return folder, f


def arguments(folder: Path, command: str, out: Path | None, *more: str) -> list[str]:
    given = [command, str(folder / "*.png"), "--camera", str(folder / "cam.json"), "--rate", str(RATE)]
    given += [] if out is None else ["-o", str(out)]
    return given + [str(folder / text) if text.endswith(".csv") else text for text in more]


LOGS = ("--range-csv", "ranges.csv", "--rates", "gyro.csv", "--rate-std", "0.001", "--attitude", "down.csv")
PX4 = (
    "--range-csv", "px4_range.csv", "--height-std", "0.001", "--rates", "px4_gyro.csv", "--rate-std", "0.001",
    "--attitude", "ardupilot.csv", "--mount", "x-right", "--log-start", str(START_S),
)  # fmt: skip


def expect_true(found: np.ndarray, f: Flight, R: np.ndarray) -> None:
    """All frames but the first, in the axes that `R` leads to, to 2 % of the speed."""
    true = f.velocity_m_s[1:] @ R.T
    assert np.isfinite(found[1:]).all()
    assert np.abs(found[1:, :2] - true[:, :2]).max() < 0.02 * 0.45


@pytest.mark.parametrize(("more", "mount"), [(LOGS, None), (PX4, "x-right")], ids=["own columns", "autopilots'"])
def test_velocity_takes_logs(
    flown: tuple[Path, Flight],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: tuple[str, ...],
    mount: str | None,
) -> None:
    folder, f = flown
    assert cli.main(arguments(folder, "velocity", tmp_path, *more)) == 0
    assert "15 of 16 frames measured" in capsys.readouterr().out
    R = np.eye(3) if mount is None else mounting(mount)
    expect_true(velocities(tmp_path / "velocity.csv"), f, R)
    # Of a range the height above the plane stands in the table.
    heights = [float(row["height_m"]) for row in table(tmp_path / "velocity.csv")]
    assert heights == pytest.approx(f.height_m, rel=0.005)
    path = table(tmp_path / "trajectory.csv")
    assert [row["frame"] for row in path] == [str(k) for k in range(FRAMES)]
    std = np.array([float(row["x_std_m"]) for row in path])
    assert (np.diff(std) > -1e-12).all()
    assert np.array([float(row["cov_xx_m2"]) for row in path]) == pytest.approx(std**2, rel=1e-6)


def test_pictures_with_times_of_their_own_share_the_clock_of_the_logs(
    flown: tuple[Path, Flight], tmp_path: Path
) -> None:
    folder, f = flown
    written(tmp_path / "times.csv", "t_us", 1e6 * (f.t_s + START_S))
    more = [text for text in PX4 if text not in ("--log-start", str(START_S))]
    command = [text for text in arguments(folder, "velocity", tmp_path / "out", *more) if text != str(RATE)]
    command[command.index("--rate")] = "--times"
    command.insert(command.index("--times") + 1, str(tmp_path / "times.csv"))
    assert cli.main(command) == 0
    expect_true(velocities(tmp_path / "out/velocity.csv"), f, mounting("x-right"))
    command[0], command[command.index(str(tmp_path / "out"))] = "extract", str(tmp_path / "all")
    assert cli.main([*command, "--no-videos"]) == 0
    assert (tmp_path / "all/velocity.csv").read_bytes() == (tmp_path / "out/velocity.csv").read_bytes()


def test_without_the_logs_the_rocking_is_taken_for_a_way(flown: tuple[Path, Flight], tmp_path: Path) -> None:
    """What the tests above show is the logs' doing."""
    folder, f = flown
    assert cli.main(arguments(folder, "velocity", tmp_path, "--height", "1", "--json")) == 0
    found = velocities(tmp_path / "velocity.csv")
    off = np.abs(found[1:, :2] - f.velocity_m_s[1:, :2]).max(axis=1)
    assert np.nanmax(off, initial=1.0) > 0.1


def test_extract_and_live_take_the_same_words(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, f = flown
    assert cli.main(arguments(folder, "velocity", tmp_path / "velocity", *PX4, "--json")) == 0
    assert cli.main(arguments(folder, "extract", tmp_path / "extract", *PX4, "--no-videos", "--json")) == 0
    assert (tmp_path / "velocity/velocity.csv").read_text() == (tmp_path / "extract/velocity.csv").read_text()
    assert (tmp_path / "velocity/trajectory.csv").read_text() == (tmp_path / "extract/trajectory.csv").read_text()
    page = (tmp_path / "extract/report.html").read_text(encoding="utf-8")
    assert "Where the uncertainty of the speed comes from" in page
    assert "In the axes of the body that the camera is mounted on." in page
    capsys.readouterr()
    video = tmp_path / "clip.avi"
    rsflow.video.write_lossless(video, f.images, frame_rate=RATE)
    live = [
        str(video) if text.endswith("*.png") else text for text in arguments(folder, "live", None, *PX4, "--json-lines")
    ]
    live = [text for k, text in enumerate(live) if text != "--rate" and live[k - 1] != "--rate"]
    assert cli.main(live) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    found = np.array([[np.nan] * 3, *([line[f"v{axis}_m_s"] for axis in "xyz"] for line in lines)])
    assert found[1:] == pytest.approx(velocities(tmp_path / "velocity/velocity.csv")[1:], rel=1e-4)


def test_a_delay_that_is_stated_is_taken_out(flown: tuple[Path, Flight], tmp_path: Path) -> None:
    folder, f = flown
    more = ("--range-csv", "ranges.csv", "--attitude", "down.csv", "--rates", "late.csv", "--rate-std", "0.001")
    assert cli.main(arguments(folder, "velocity", tmp_path, *more, "--rate-delay", "0.02", "--json")) == 0
    expect_true(velocities(tmp_path / "velocity.csv"), f, np.eye(3))


def test_json_lines_are_the_table_and_the_summary(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = flown
    more = ("--height-csv", "heights.csv", "--rates", "gyro.csv", "--parquet")
    assert cli.main(arguments(folder, "velocity", tmp_path, *more, "--json-lines")) == 0
    *lines, summary = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    rows = table(tmp_path / "velocity.csv")
    assert [line["frame"] for line in lines] == list(range(FRAMES))
    assert (lines[0]["vx_m_s"], lines[0]["status"]) == (None, "first_frame")
    assert lines[5]["vx_m_s"] == pytest.approx(float(rows[5]["vx_m_s"]), rel=1e-8)
    assert set(lines[5]) == set(rows[5])
    assert summary["frames"] == FRAMES
    assert sum(summary["variance_shares"].values()) == pytest.approx(1.0)
    import pyarrow.parquet

    found = pyarrow.parquet.read_table(summary["parquet"]).to_pylist()
    assert [row["status"] for row in found] == [row["status"] for row in rows]
    assert found[5]["cov_xy_m2_s2"] == pytest.approx(float(rows[5]["cov_xy_m2_s2"]), rel=1e-8)
    svg = (tmp_path / "velocity.svg").read_text(encoding="utf-8")
    assert svg.startswith("<svg xmlns=")
    assert "velocity over time" in svg


REFUSED = [
    (("--range-csv", "heights.csv"), "got .*heights.csv, which has heights, expected ranges: use --height-csv"),
    (("--height-csv", "ranges.csv"), "which has ranges, expected heights: use --range-csv"),
    (("--height", "1", "--rates", "px4_gyro.csv"), 'mount: got none, expected .*forward, right, down.*"x-right"'),
    (("--height", "1", "--rates", "gyro.csv", "--mount", "x-sideways"), 'mount: got "x-sideways", expected an axis of'),
    (("--height", "1", "--rates", "down.csv"), "expected rate_x_rad_s, rate_y_rad_s, rate_z_rad_s and one of t_s"),
    (("--height", "1", "--attitude", "gyro.csv"), "expected down_x, down_y, down_z or qw, qx, qy, qz or roll_rad"),
    (
        ("--height", "1", "--rates", "px4_gyro.csv", "--mount", "x-right"),
        r"rates: got .* with times from 312\.\d+ to .*, expected rates of the frames.*\(--log-start\) says what",
    ),
    (("--height", "1", "--rates", "gyro.csv", "--log-start", "50"), "no frame has a rate.*source's time 0, 50 s now"),
    (("--range-csv", "ranges.csv", "--height-std", "0.1"), r"got a column range_std_m and 0\.1 m for all rows"),
    (("--height", "1", "--dt-std", "-1"), "--dt-std: got -1.0, expected a finite number of seconds of at least 0"),
]  # fmt: skip


@pytest.mark.parametrize(("more", "message"), REFUSED, ids=[message[:24] for _, message in REFUSED])
@pytest.mark.parametrize("command", ["velocity", "extract"])
def test_what_is_refused_is_said_in_one_line_and_nothing_is_written(
    flown: tuple[Path, Flight],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    command: str,
    more: tuple[str, ...],
    message: str,
) -> None:
    folder, _ = flown
    assert cli.main(arguments(folder, command, tmp_path / "out", *more)) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(message, line)
    assert not list(tmp_path.rglob("*.csv"))


def test_axes_with_the_third_one_up_are_asked_about(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A quaternion of ROS: the identity but for a turn to the north, its body's and the earth's third axis up."""
    folder, f = flown
    one = np.ones(FRAMES)
    written(tmp_path / "q.csv", "t_s,qw,qx,qy,qz", f.t_s, 0 * one, one, 0 * one, 0 * one)
    more = ["--height", "1", "--attitude", str(tmp_path / "q.csv"), "--stop", "4"]
    assert cli.main([*arguments(folder, "velocity", tmp_path / "ned"), *more]) == 0
    printed = capsys.readouterr().out
    assert "0 of 4 frames measured" in printed
    assert "the camera looks 180 degrees away from straight down, at the sky: is it mounted in another way" in printed
    assert cli.main([*arguments(folder, "velocity", tmp_path / "enu"), *more, "--earth", "enu"]) == 0
    printed = capsys.readouterr().out
    assert "3 of 4 frames measured" in printed
    assert "sky" not in printed


def test_a_hole_in_the_heights_is_bridged_by_the_pictures_for_a_while_and_told(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A range finder at 50 Hz that sees nothing from 0.1 to 0.4 s of 0.5."""
    folder, f = flown
    header, *rows = (folder / "ranges.csv").read_text().splitlines()
    log = tmp_path / "hole.csv"
    log.write_text("\n".join([header, *(row for row in rows if not 0.1 < float(row.split(",")[0]) < 0.4)]))
    more = ["--range-csv", str(log), "--rates", str(folder / "gyro.csv"), "--attitude", str(folder / "down.csv")]
    command = [*arguments(folder, "velocity", tmp_path / "out"), *more, "--overwrite"]
    assert cli.main(command) == 0
    printed = capsys.readouterr()
    assert "have a hole of 0.3" in printed.out
    assert "frames: the height is carried on by the pictures alone" in printed.out
    assert "frames have no range" in printed.err
    expect_true(velocities(tmp_path / "out/velocity.csv"), f, np.eye(3))
    rows_out = table(tmp_path / "out/velocity.csv")
    inside = [k for k in range(1, FRAMES) if 0.13 < f.t_s[k] < 0.37]
    std = [float(rows_out[k]["height_std_m"]) for k in inside]
    assert std[-1] > std[0] > 0.001
    for k in inside:
        off = float(rows_out[k]["height_m"]) - f.height_m[k]
        assert abs(off) < 4 * float(rows_out[k]["height_std_m"])
        assert "carried on" in rows_out[k]["doubts"]
    # Not for longer than is wished.
    assert cli.main([*command, "--max-height-gap", "0.1"]) == 0
    statuses = [row["status"] for row in table(tmp_path / "out/velocity.csv")]
    assert "no_height" in statuses
    assert statuses[-1] == "ok"


def test_a_hole_in_the_gyro_is_no_guess(flown: tuple[Path, Flight], tmp_path: Path) -> None:
    """Where the rate is not known it is solved for, with a deviation that says so."""
    folder, f = flown
    header, *rows = (folder / "gyro.csv").read_text().splitlines()
    log = tmp_path / "hole.csv"
    log.write_text("\n".join([header, *(row for row in rows if not 0.2 < float(row.split(",")[0]) < 0.3)]))
    more = ["--range-csv", str(folder / "ranges.csv"), "--rates", str(log), "--rate-std", "0.001"]
    more += ["--attitude", str(folder / "down.csv")]
    assert cli.main([*arguments(folder, "velocity", tmp_path / "out"), *more]) == 0
    rows_out = table(tmp_path / "out/velocity.csv")
    std = np.array([float(row["rate_z_std_rad_s"]) for row in rows_out])
    inside = np.array([0.2 < t < 0.3 for t in f.t_s])
    assert (std[inside] > 1.3 * np.nanmin(std)).all()
    found, true = velocities(tmp_path / "out/velocity.csv"), f.velocity_m_s
    deviation = np.array([[float(row[f"v{axis}_std_m_s"]) for axis in "xy"] for row in rows_out])
    assert (np.abs(found - true)[1:, :2] <= 4 * deviation[1:]).all()


def test_a_run_with_logs_that_was_stopped_goes_on_to_the_byte(
    flown: tuple[Path, Flight], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rsflow.extraction import checkpoint
    from rsflow.velocity import Sensors

    folder, _ = flown
    for name, value in (("_EVERY_S", 0.0), ("_SHARE", 1e9), ("_GROWTH", 0.0)):
        monkeypatch.setattr(checkpoint, name, value)
    sensors = Sensors(rates=folder / "gyro.csv", rate_std_rad_s=0.002, attitude=folder / "down.csv")
    options: dict[str, Any] = {
        "camera": folder / "cam.json", "height_m": folder / "ranges.csv", "sensors": sensors, "frame_rate": RATE,
        "videos": False,
    }  # fmt: skip

    def fail(measured: rsflow.extraction.Measured) -> None:
        if measured.frame.index == 9:
            raise ValueError("the disk is gone")

    rsflow.extract(str(folder / "*.png"), tmp_path / "whole", **options)
    with pytest.raises(rsflow.PartialExtractionError, match="the disk is gone"):
        rsflow.extract(str(folder / "*.png"), tmp_path / "out", **options, on_frame=fail)
    seen: list[int] = []
    done = rsflow.extract(
        str(folder / "*.png"), tmp_path / "out", **options, resume=True, on_frame=lambda m: seen.append(m.frame.index)
    )
    assert done.complete
    assert 0 < seen[0] <= 9
    for name in ("velocity", "trajectory"):
        assert (tmp_path / f"out/{name}.csv").read_bytes() == (tmp_path / f"whole/{name}.csv").read_bytes()


def test_a_log_is_not_written_over_and_counts_among_the_settings(
    flown: tuple[Path, Flight], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = flown
    own = tmp_path / "velocity.csv"
    own.write_text((folder / "gyro.csv").read_text())
    more = ["--height", "1", "--rates", str(own), "--stop", "3"]
    assert cli.main([*arguments(folder, "velocity", tmp_path), *more]) == 1
    assert "which is read" in capsys.readouterr().err
    log = tmp_path / "log.csv"
    log.write_text((folder / "gyro.csv").read_text())
    more = ["--height", "1", "--rates", str(log), "--stop", "3"]
    assert cli.main([*arguments(folder, "velocity", tmp_path / "out"), *more]) == 0
    log.write_text((folder / "late.csv").read_text())
    assert cli.main([*arguments(folder, "velocity", tmp_path / "out"), *more]) == 1
    assert "the result of other settings" in capsys.readouterr().err
